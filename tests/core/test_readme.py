"""README and docs are right: their commands run, the Python of the README runs, and pictures are there and small."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from irrsplat.app import cli
from irrsplat.app.bench import cases, gather_truth
from irrsplat.app.viewer import viewer
from irrsplat.app.viewer.window import open_window

pytestmark = pytest.mark.few_sites
ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SOURCES = (ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))
PAGES = [README] + [page.read_text(encoding="utf-8") for page in SOURCES]
LEARNED_FROM = [page for page in SOURCES if page.parent.name in ("tutorial", "how-to") and "```python" in page.read_text("utf-8")]
COMMANDS = [line for page in PAGES for block in re.findall(r"```sh\n(.*?)```", page, re.S) for line in block.splitlines()]
BEFORE = {line: before for before, line in pairwise(COMMANDS)}
IRRSPLAT = list(dict.fromkeys(line for line in COMMANDS if line.startswith("irrsplat ")))


def files_of(page: str, folder: Path) -> None:
    """Write the files that a page shows, ```text title="NAME", into a folder, for the commands and the Python below them."""
    for name, text in re.findall(r'^```text title="([^"]+)"\n(.*?)^```', page, re.S | re.M):
        (folder / name).write_text(text, encoding="utf-8")


def small(words: list[str]) -> list[str]:
    """Return the command with a small picture, since the test is about the command and not about its result."""
    if words[0] == "bake":  # tests/app/bake checks its result
        words = ["64" if before == "--size" else word for before, word in zip(["", *words], words, strict=False)]
        coarse = ["--a", "2", "--radius-min", "20", "--tolerance", "0.1", "--spread", "0"]
        most = ["--most", "200"] if "vertices" in words else []
        return [*words, "--bounces", "1", "--gather-size", "8", "--shadow-size", "64", *coarse, *most]
    if words[0] not in ("view", "render", "fill", "bench"):
        return words
    if "--size" in words:
        i = words.index("--size")
        words = words[:i] + words[i + 3 :]
    quick = ["--gather-size", "8", "--warmup", "20", "--shadow-size", "64", *([] if "--bounces" in words else ["--bounces", "1"])]
    if words[0] == "bench":  # tests/app/bench has all presets
        quick = [] if "--preset" in words else ["--preset", "default"]
    return [*words, "--size", "24", "24", *quick]


def test_there_is_a_quick_start_of_two_commands() -> None:
    """`make test` is what CI itself runs (.ci/run), and `make demo` is render commands as below: so neither is run from here."""
    assert COMMANDS[:2] == ["make demo", "make test"]
    assert set(COMMANDS) == {"make demo", "make test", *IRRSPLAT}
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make (\w+)`", "".join(PAGES)):
        assert re.search(rf"^{target}:", makefile, re.M), f"the Makefile has no {target}"


@pytest.mark.parametrize("command", [c if c in README else pytest.param(c, marks=pytest.mark.long) for c in IRRSPLAT])
def test_the_commands_run(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))
    # a window in memory that closes after some frames (tests/app/viewer/interface/test_window.py opens a real one)
    monkeypatch.setattr(viewer, "open_window", lambda size: open_window(size, headless=True))
    monkeypatch.setattr(viewer.Viewer, "loop", lambda self: [self.frame(0.1) for _ in range(5)])
    monkeypatch.setattr(cases, "REPETITIONS", 1)
    monkeypatch.setattr(gather_truth, "truth", lambda renderer, camera: None)  # tests/app/bench has the errors
    files_of(next(page for page in PAGES if command in page), tmp_path)
    if "--cache-mode frozen" in command:  # by the cache that the line before it makes
        assert cli.main(small(shlex.split(BEFORE[command])[1:])) == 0
    words = shlex.split(command)[1:]
    assert cli.main(small(words)) == 0, capsys.readouterr().err
    if words[0] == "view":
        assert (tmp_path / "config" / "viewer.json").is_file()
    for flag, name in pairwise(words):
        if flag in ("-o", "--stats", "--json"):
            assert (tmp_path / name.format(frame=0)).exists()


def test_the_demo_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The render commands of `make demo`, at small size."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    commands = re.findall(r"^\t\.venv/bin/irrsplat (render .*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    assert len(commands) == 2
    for command in commands:
        assert cli.main(small(shlex.split(command))) == 0
    assert len(list((tmp_path / "out/figures").glob("figure*.png"))) == 6
    assert (tmp_path / "out/cornell.png").is_file()


def test_the_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    exec(compile(code.replace("size=(200, 200)", "size=(24, 24), gather_size=8, shadow_size=64"), "README.md", "exec"), {})
    assert "(24, 24, 3)" in capsys.readouterr().out
    assert (tmp_path / "out.exr").is_file()


@pytest.mark.parametrize("page", LEARNED_FROM, ids=lambda page: page.stem)
def test_the_python_of_tutorial_and_how_to_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A block that is followed by a block of text prints that."""
    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    files_of(text, tmp_path)
    for code, printed in re.findall(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", text, re.S):
        quick = code.replace("size=(200, 200)", "size=(24, 24), gather_size=8, shadow_size=64").replace("[150, 100]", "[18, 12]")
        exec(compile(quick, page.name, "exec"), {})
        out = capsys.readouterr().out
        assert out == printed if printed else out


def test_the_pictures_are_small() -> None:
    """Their existence is tested in test_docs.py."""
    pictures = list((ROOT / "docs/images").rglob("*.*"))
    assert pictures
    for picture in pictures:
        most = 1_000_000 if picture.suffix == ".gif" else 200_000
        assert picture.stat().st_size <= most, f"{picture.name} is too large; run: make figures"
