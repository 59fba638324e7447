"""Refusals of the command line: one line on stderr, the exit status, and no new file."""

from __future__ import annotations

import errno
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import irrsplat
from irrsplat.app import cli, grammar
from irrsplat.core.errors import GLError, InputError
from irrsplat.gpu import context
from tests.core.test_rooms import ROOT

RENDER = ["render", "plain.scene", "-o", "a.png"]
EYE, TARGET = ["--eye", "0", "0", "5"], ["--target", "0", "0", "0"]
FLIGHT = ["render", "plain.scene", "--path", "a.path"]
FRAMES = [*FLIGHT, "-o", "f{frame}.png"]
FILL = ["fill", "plain.scene", "--cache", "x.cache"]
MEASURE, VERIFY, BAKE = ["measure", "plain.scene"], ["verify", "plain.scene", "--bounces", "1"], ["bake", "plain.scene", "-o"]
PLANE = [*MEASURE, "--plane", "0", "0", "0", "1", "0", "0", "0", "0", "-1"]
FIELDS = ("{}", "{n}", "{frame", "{frame}{n}", "{frame.real}", "{frame!r}", "{frame:{frame}}", "{frame:s}", "{frame:999d}")


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["render", "plain.scene"], "-o/--output"),
        ([*RENDER, "--crease-angle", "181"], "crease_angle lies between 0 and 180 degrees, not 181"),
        ([*RENDER, "--size", "0", "4"], "'0'"),
        ([*RENDER, "--size", "64x48"], "--size: expected 2 arguments, W H; see irrsplat render --help"),
        ([*RENDER, "--a", "nan"], "0.01..2"),
        ([*RENDER, "--gather", "photons"], "--gather takes auto|"),
        ([*RENDER, "--fill-holes=maybe"], "on|off"),
        ([*RENDER, "--bounces", "65"], "takes 0..64 or all"),
        ([*RENDER, *EYE], "go together"),
        ([*RENDER, "--eye", "0", "0", "nan", *TARGET], "finite"),
        ([*RENDER, *EYE, *TARGET, "--up", "0", "0", "-2"], "parallel"),
        ([*RENDER, *EYE, *TARGET, "--camera", "top"], "two different"),
        ([*RENDER, "--camera", "gallary"], "no camera 'gallary' (did you mean 'gallery'?); the named cameras here: 'gallery'"),
        ([*RENDER, "--fov", "180"], "between 0 and 180"),
        ([*RENDER, "--buffers", ""], "unknown buffer"),
        ([*RENDER, "-o", "a.avi"], ".png, .exr, .npz"),
        ([*RENDER, "-o", "missing/a.png"], "does not exist"),
        ([*RENDER, "--tile-size", "64", "--falsecolor"], "--tile-size and --falsecolor light"),
        ([*RENDER, "--scale", "100"], "--scale is for --falsecolor"),
        (["render", "plain.scene", "--falsecolor", "-o", "a.exr"], "no output is one"),
        (["render", "-o", "triangle.obj/a.png"], "a.png"),
        (["render", "missing.scene", "-o", "a.png"], "missing.scene"),
        ([], f"irrsplat: a command is missing; the commands are {', '.join(grammar.COMMANDS)}; see irrsplat --help\n"),
        (["cache", "x"], "there is no command 'x'; the commands are info, merge, prune; see irrsplat cache --help\n"),
        (["bench", "cornell", "--growth"], "of its own"),
        (["bench", "--profile", "--peers"], "a table of its own"),
        # flights and films
        ([*FRAMES, "--frames", "1:2:3"], "expected A:B"),
        ([*FRAMES, "--frames", "0:5"], "has 4 frames; give A:B within 0:4"),
        ([*FRAMES, *EYE, *TARGET], "leave --path or --eye out"),
        (["render", "plain.scene", "--path", "none.path", "-o", "f{frame}.png"], "--path 'none.path': there is no such file"),
        ([*FLIGHT, "-o", "f.png"], "f.png: 4 frames would go to one name; put {frame} into it"),
        *(([*FLIGHT, "-o", f"f{field}.png"], "the one field in an output's name is {frame}") for field in FIELDS),
        (["render", "plain.scene", "-o", "f{frame}.png"], "give --path"),
        ([*RENDER, "--frames", "0:2"], "give --path"),
        (["render", "plain.scene", "-o", "x.mp4"], "a film needs a flight"),
        ([*FRAMES, "--fps", "24"], "--fps is for a film"),
        ([*FLIGHT, "-o", "x{frame}.mp4"], "no {frame} in its name"),
        ([*FLIGHT, "-o", "x.mp4", "--backdrop", "clear"], "films have no alpha"),
        ([*RENDER, "--cache-mode", "frozen"], "give --cache FILE as well"),
        (FILL, "give --path FILE"),
        # other commands
        (MEASURE, "nothing to measure; give --plane, --height, --line or --point"),
        ([*PLANE, "--height", "1"], "--plane and --height name two different places"),
        ([*PLANE, "--grid", "1e-6"], "at most 1,000,000"),
        ([*PLANE, "--margin", "0.5"], "leaves nothing"),
        ([*PLANE, "-o", "a.exr"], "expected .csv or .npz"),
        ([*PLANE, "-o", "a.csv", "--stats", "a.csv"], "are one file"),
        ([*MEASURE, "--point", "0", "0", "0", "0", "1", "0", "--grid", "1"], "--grid does not go with --point"),
        (["verify", "plain.scene", "--bounces", "0"], "--bounces 0"),
        ([*VERIFY, "-o", "a.exr"], "verify writes a .png"),
        ([*VERIFY, "--samples", "200000"], "131072"),
        ([*BAKE, "a.png"], "a bake is a .glb"),
        ([*BAKE, "a.glb", "--cut", "1"], "--cut is for --to vertices"),
        ([*BAKE, "a.glb", "--size", "8"], "16 to 8192 texels"),
    ],
)
def test_a_wrong_command_line_is_refused_in_one_line(
    argv: list[str], words: str, refused: Callable[..., str], place: Path, fake: Any
) -> None:
    (place / "a.light").write_text("position 0 1 0 1\nintensity 1 1 1\n")
    more = "light a.light\ncam gallery 5 0 0 0 0 0 0 0 1\n"
    (place / "plain.scene").write_text((place / "plain.scene").read_text() + more)
    flight = "frames 4\ncam 0 0 5  0 0 0  0 1 0\ncam 3 0 5  0 0 0  0 1 0\n"
    (place / "a.path").write_text(flight)
    assert words in refused(argv)


def test_a_wrong_scene_is_refused_without_notices(refused: Callable[..., str], place: Path, fake: Any) -> None:
    for text, words in (("sky 1 1 1\nbrdf diffuse 1 2\n", "plain.scene:2"), ("obj none.obj\n", "none.obj"), ("", "plain.scene")):
        (place / "plain.scene").write_text(text)
        assert words in refused(RENDER)


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (InputError("size 99999x1 is beyond the limit"), 2, "beyond"),
        (GLError(context.advice("libGL.so not loaded")), 1, "libgl1"),
        (OSError(errno.ENOSPC, "No space left on device"), 1, "the disk is full; free some space, or write to another place"),
        (RuntimeError("two\nlines"), 1, "internal error: RuntimeError: two lines"),
        (MemoryError(), 1, "out of memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_errors_of_the_renderer_are_one_line(
    error: BaseException, status: int, words: str, refused: Callable[..., str], place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(irrsplat, "Renderer", fail)
    assert words in refused(RENDER, status)


@pytest.mark.parametrize(
    ("module", "argv"), [("irrsplat.app.bench.bench", ["bench"]), ("OpenEXR", ["render", "plain.scene", "-o", "a.exr"])]
)
def test_a_missing_module_is_one_line(
    module: str, argv: list[str], refused: Callable[..., str], place: Path, fake: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only commands that need the module fail, with its name."""
    for name in [module, *(name for name in sys.modules if name.startswith(f"{module}."))]:
        monkeypatch.setitem(sys.modules, name, None)  # makes its import fail
    package, _, attribute = module.rpartition(".")
    if package:  # an earlier test may have imported the module
        monkeypatch.delattr(import_module(package), attribute, raising=False)
    assert module in refused(argv, 1)
    assert grammar.parse(["info"]).command == "info"


def test_escape_sequences_in_names_are_printed_as_text(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Escape sequences in names of cameras and files are printed as text; each print goes through `terminal.py`."""
    scene = place / "\x1b[31mred.scene"
    scene.write_text((place / "plain.scene").read_text() + "cam \x1b]0;title\x07 0 0 5  0 0 0  0 1 0\n")
    assert cli.main(["info", scene.name]) == 0 and cli.main(["info", scene.name + "\u202e"]) == 2
    printed = "".join(capsys.readouterr())
    assert printed.replace("\n", "").isprintable() and r"\x1b[31mred" in printed and r"'\x1b]0;title\x07'" in printed
    printing = {path.name for path in ROOT.glob("app/**/*.py") if re.search(r"(?<![\w.])print\(", path.read_text("utf-8"))}
    assert printing == {"terminal.py"}


def test_closed_streams_and_a_locale_without_utf_8_are_supported(place: Path) -> None:
    """A shell closes streams by `>&-`; in the locale C, names of files and scenes keep their bytes."""
    (place / "ä.scene").write_text("obj ö.obj\n", encoding="utf-8")
    (place / "triangle.obj").rename(place / "ö.obj")
    run = f"'{sys.executable}' -m irrsplat render ä.scene --size 4 4 --gather-size 8 --bounces 1 -o ü.exr --stats ß.json"
    old = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    for streams in (">&-", "2>&-", ">&- 2>&-"):
        done = subprocess.run(["sh", "-c", f"{run} {streams}"], env=os.environ | old, capture_output=True, check=True)
        assert (place / "ü.exr").stat().st_size and b"irrsplat:" not in done.stdout + done.stderr
    assert json.loads((place / "ß.json").read_text("utf-8"))["scene"] == "ä"


# ---- misspelled words ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "meant"),
    [
        (["rendr"], "did you mean 'render'?"),
        ([*RENDER, "--exposre=auto"], "unknown flag --exposre (did you mean --exposure?)"),
        ([*RENDER, "--preset", "papr"], "did you mean 'paper'?"),
        ([*RENDER, "--exposure", "aut"], "did you mean 'auto'?"),
        ([*RENDER, "--buffers", "depth,irradiancee"], "'irradiancee' (did you mean 'irradiance'?)"),
        (["render", "cornel", "-o", "a.png"], "did you mean 'cornell'?"),
        ([*RENDER, "--xyzzy"], ""),
        (["info", "xyzzy"], ""),
        ([*RENDER, "--overtur"], ""),  # a former flag
    ],
)
def test_a_message_suggests_the_right_spelling(argv: list[str], meant: str, refused: Callable[..., str], place: Path) -> None:
    line = refused(argv)
    assert meant in line and line.count("did you mean") == bool(meant)


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([*RENDER, "--eye", "0", "0", "x", *TARGET], "not 'x'"),  # not that --target lacks --eye
        ([*RENDER, *EYE, "--targt", "0", "0", "0"], "unknown flag --targt"),  # not that --eye lacks --target
        (["render", "--outpt", "a.png"], "unknown flag --outpt"),  # not that -o is missing
        (["render", "cornel", "--fill-hols", "plain.scene"], "unknown flag --fill-hols"),  # the grammar comes before the scene
    ],
)
def test_a_mistake_is_reported_without_its_consequences(argv: list[str], words: str, refused: Callable[..., str]) -> None:
    assert words in refused(argv)


def test_a_missing_package_of_the_viewer_is_reported(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("irrsplat.app.commands.view.find_spec", lambda name: None)
    assert cli.main(["view", "cornell"]) == 1
    assert "needs the package imgui-bundle" in capsys.readouterr().err
