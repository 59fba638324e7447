"""The pages are right about the tree: every link, anchor and named file is there, and every command line parses."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from irrsplat.app import grammar
from tests.support.programs import FOLDER, program

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted((ROOT / "docs").rglob("*.md"))
FOLDERS = r"(?:\.ci|app|docs|irrsplat|scenes|shaders|tests)/"

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def anchors(page: Path) -> set[str]:
    """The names by which a link may lead to the headings of a page, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pages
def test_links_and_anchors_resolve(page: Path) -> None:
    for target in re.findall(r"\]\((?!https?:)([^)\s]+)\)", page.read_text(encoding="utf-8")):
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        assert file.exists(), f"{page.name} links to {name}, which is not there"
        assert not anchor or anchor in anchors(file), f"{page.name} links to #{anchor}, which {file.name} has not"


@pages
def test_files_named_in_backticks_exist(page: Path) -> None:
    """`path` must exist (a pattern must match a file), and so must the names in `path` (`name`, `name`) in that file."""
    text = page.read_text(encoding="utf-8")
    for path in re.findall(rf"`({FOLDERS}[^`\s]*)`", text):
        assert any(ROOT.glob(path.rstrip("/"))), f"{page.name} names {path}, which is not there"
    for path, names in re.findall(rf"`({FOLDERS}[^`\s*]+\.\w+)`\s\(((?:`[^`]+`(?:,\s)?)+)", text):
        source = (ROOT / path).read_text(encoding="utf-8")
        for name in re.findall(r"`([^`]+)`", names):
            assert name.split(".")[-1] in source, f"{page.name}: {path} has no {name}"


@pages
def test_command_lines_parse(page: Path) -> None:
    """Commands inside sentences and in blocks, which test_readme.py runs. `irrsplat render` alone is the name of a command."""
    text = page.read_text(encoding="utf-8")
    shell = "".join(re.findall(r"```sh\n(.*?)```", text, re.S))
    for command in [*re.findall(r"`irrsplat ([^`]+)`", text), *re.findall(r"^irrsplat (.*)$", shell, re.M)]:
        words = shlex.split(command.replace("\n", " "))
        if len(words) > 1:
            try:
                grammar.parse(words)
            except SystemExit as done:  # --help
                assert done.code == 0


def test_the_check_of_the_hessian_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """The appendix of METHOD.md: the formulas of gradient and Hessian agree with finite differences."""
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/METHOD.md").read_text(encoding="utf-8"), re.S)
    exec(compile(code, "METHOD.md", "exec"), {})
    assert max(map(float, capsys.readouterr().out.split())) < 2e-6


def test_pages_state_the_numbers_of_the_measurements(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables and marked numbers are those of measurements.json; pages of results have no other records, times or errors."""
    monkeypatch.syspath_prepend(str(FOLDER))
    measure = program("measure")
    for page in measure.pages():
        text = page.read_text(encoding="utf-8")
        assert measure.filled(text, measure.kept()) == text, f"{page.name}: run python docs/programs/measure.py fill"
        if page.name in ("README.md", "measurements.md", "techniques.md", "2-what-was-wrong.md", "3-how-it-is-fixed.md"):
            by_hand = re.sub(r"(<!-- n: .*?<!-- n -->)|(<!-- \S+: made by .*?<!-- end -->)", "", text, flags=re.S)
            assert not re.search(r"\d (?:records|m?s|seconds|% (?:error|RMSE))\b", by_hand), page.name


def test_commands_of_the_page_on_trust_choose_tests_that_there_are() -> None:
    """Files exist, and each word of a `-k` stands in the names or cases of the tests there."""
    rows = program("trust").rows((ROOT / "docs/about/trust.md").read_text(encoding="utf-8"))
    for row in rows:
        files = [ROOT / word for word in row.words if word.startswith("tests/")]
        assert all(file.exists() for file in files) and row.words[:1] in ([], ["python"], ["irrsplat"]), row.tried
        sources = [source for file in files for source in ([file] if file.is_file() else [*file.rglob("*.py")])]
        text = "".join(source.read_text(encoding="utf-8") for source in sources).lower()
        chosen = row.words[row.words.index("-k") + 1].split() if "-k" in row.words else []
        assert len(rows) > 50 and all(word.lower() in text for word in chosen if word not in ("and", "or", "not")), row.tried
