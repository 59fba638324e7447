"""What the command line refuses: one line on stderr, the right exit status, and no file left behind."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import irrsplat
from irrsplat.app import grammar
from irrsplat.core.errors import GLError, InputError
from irrsplat.gpu import context

RENDER = ["render", "plain.scene", "-o", "a.png"]


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([], "a command is missing"),
        (["paint"], "paint"),
        (["--nonsense"], "a command is missing"),
        (["render"], "-o/--output"),
        (["render", "plain.scene"], "-o/--output"),
        (["render", "plain.scene", "-o"], "expected one argument"),
        ([*RENDER, "another"], "another"),
        ([*RENDER, "--nonsense"], "--nonsense"),
        ([*RENDER, "--up-axis", "w"], "'w'"),
        ([*RENDER, "--crease-angle", "181"], "crease_angle lies between 0 and 180 degrees, not 181"),
        (["info", "plain.scene", "--time", "-1"], "time is a number of seconds"),
        ([*RENDER, "--siz", "4", "4"], "--siz"),  # no abbreviations
        ([*RENDER, "--path", "x", "--frames", "0:9"], "--path"),
        ([*RENDER, "--cache"], "expected one argument"),
        (["info", "plain.scene", "--cache", "x"], "--cache"),
        ([*RENDER, "--size", "4"], "expected 2 arguments"),
        ([*RENDER, "--size", "0", "4"], "'0'"),
        ([*RENDER, "--size", "-4", "4"], "'-4'"),
        ([*RENDER, "--size", "4.5", "4"], "'4.5'"),
        ([*RENDER, "--size", "four", "4"], "'four'"),
        ([*RENDER, "--size", "4", "9999999999"], "9999999999"),
        ([*RENDER, "--preset", "fast"], "fast"),
        ([*RENDER, "--a", "x"], "0.01..2"),
        ([*RENDER, "--a", "-1"], "0.01..2"),
        ([*RENDER, "--a", "nan"], "0.01..2"),
        ([*RENDER, "--a"], "expected one argument"),
        ([*RENDER, "--blend", "1.5"], "0..1"),
        ([*RENDER, "--tolerance", "often"], "auto"),
        ([*RENDER, "--gather", "photons"], "auto|plane|raster|trace"),
        ([*RENDER, "--smooth=maybe"], "on|off"),
        ([*RENDER, "--bounces", "65"], "takes 0..64 or all"),
        ([*RENDER, "--bounces", "some"], "takes 0..64 or all"),
        ([*RENDER, "--bounces", "-1"], "takes 0..64 or all"),
        ([*RENDER, "--eye", "0", "0", "5"], "go together"),
        ([*RENDER, "--target", "0", "0", "0"], "go together"),
        ([*RENDER, "--up", "0", "1", "0"], "--up needs --eye"),
        ([*RENDER, "--eye", "0", "0", "--target", "0", "0", "0"], "expected 3 arguments"),
        ([*RENDER, "--eye", "0", "0", "nan", "--target", "0", "0", "0"], "finite"),
        ([*RENDER, "--eye", "0", "0", "-inf", "--target", "0", "0", "0"], "finite"),
        ([*RENDER, "--eye", "0", "0", "x", "--target", "0", "0", "0"], "'x'"),
        ([*RENDER, "--eye", "1", "2", "3", "--target", "1", "2", "3"], "eye"),
        ([*RENDER, "--eye", "0", "0", "5", "--target", "0", "0", "0", "--up", "0", "0", "-2"], "parallel"),
        ([*RENDER, "--eye", "0", "0", "5", "--target", "0", "0", "0", "--camera", "top"], "two different"),
        ([*RENDER, "--camera", "top"], "no camera 'top'"),
        ([*RENDER, "--fov", "180"], "between 0 and 180"),
        ([*RENDER, "--fov", "0"], "between 0 and 180"),
        ([*RENDER, "--fov", "wide"], "'wide'"),
        ([*RENDER, "--buffers", "colour"], "'colour'"),
        ([*RENDER, "--buffers", ""], "unknown buffer"),
        ([*RENDER, "-o", "a.avi"], ".png, .exr, .npz"),
        ([*RENDER, "-o", "a.jpeg"], "unknown ending"),
        ([*RENDER, "-o", "missing/a.png"], "does not exist"),
        ([*RENDER, "-o", ""], "empty"),
        ([*RENDER, "--stats", "missing/s.json"], "does not exist"),
        (["render", "-o", "triangle.obj/a.png"], "a.png"),
        (["render", "missing.scene", "-o", "a.png"], "missing.scene"),
        (["render", ".", "-o", "a.png"], "."),
        (["info", "missing.scene"], "missing.scene"),
        (["info", "a", "b"], "b"),
        (["doctor", "now"], "now"),
        (["bench", "--size", "4"], "expected 2 arguments"),
        (["bench", "--json", "missing/b.json"], "does not exist"),
    ],
)
def test_a_wrong_command_line_is_one_line_and_exit_status_2(
    argv: list[str], words: str, refused: Callable[..., str], place: Path, fake: Any
) -> None:
    assert words in refused(argv)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sky 1 1 1\nbrdf diffuse 1 2\n", "plain.scene:2"),
        ("obj none.obj\n", "none.obj"),
        ("", "plain.scene"),
    ],
)
def test_a_wrong_scene_is_one_line_before_any_notice(
    text: str, words: str, refused: Callable[..., str], place: Path, fake: Any
) -> None:
    (place / "plain.scene").write_text(text)
    assert words in refused(RENDER)


def test_outputs_are_tried_before_the_scene_is_loaded(
    refused: Callable[..., str], place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def load(*_: object, **options: object) -> None:
        pytest.fail("the scene was loaded first")

    monkeypatch.setattr(irrsplat, "load", load)
    assert "does not exist" in refused([*RENDER, "-o", "missing/b.exr"])


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (InputError("size 99999x1 is beyond the limit"), 2, "beyond"),
        (GLError("no OpenGL 3.3: run: sudo apt-get install -y libegl1"), 1, "libegl1"),
        (RuntimeError("two\nlines"), 1, "internal error: RuntimeError: two lines"),
        (MemoryError(), 1, "out of memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_the_renderer_raises(
    error: BaseException, status: int, words: str, refused: Callable[..., str], place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(irrsplat, "Renderer", fail)
    assert words in refused(RENDER, status)


@pytest.mark.parametrize(
    ("module", "argv"),
    [
        ("irrsplat.app.bench.bench", ["bench"]),
        ("irrsplat.app.bench.peers", ["bench", "--peers"]),
        ("irrsplat.app.bench.scaling", ["bench", "--growth"]),
        ("irrsplat.app.verify.verify", ["verify"]),
        ("irrsplat.app.viewer", ["view"]),
        ("irrsplat.app.commands.work.info", ["doctor"]),
        ("OpenEXR", ["render", "plain.scene", "-o", "a.exr"]),
    ],
)
def test_a_missing_module_is_one_line(
    module: str, argv: list[str], refused: Callable[..., str], place: Path, fake: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own command ends with its name; the other commands work without it."""
    for name in [module, *(name for name in sys.modules if name.startswith(f"{module}."))]:
        monkeypatch.setitem(sys.modules, name, None)  # which makes importing it fail
    package, _, attribute = module.rpartition(".")
    if package:  # an earlier test may have imported it
        monkeypatch.delattr(import_module(package), attribute, raising=False)
    assert module in refused(argv, 1)
    assert grammar.parse(["info"]).command == "info"


def test_a_machine_without_gl(refused: Callable[..., str], place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> None:
        raise GLError(context.advice("libGL.so not loaded"))

    monkeypatch.setattr(context, "create", none)
    assert "libgl1" in refused(RENDER, 1)


def test_tiles_are_not_for_everything(refused: Callable[..., str], place: Path) -> None:
    tiles = "--tile-size", "64"
    assert "--tile-size and --falsecolor light" in refused([*RENDER, *tiles, "--falsecolor"])
    (place / "a.cache").write_bytes(b"")
    flight = "--turntable", "4", "--cache", "a.cache", "--cache-mode", "frozen", "--on", "tcp://127.0.0.1:9"
    assert "--tile-size and --on" in refused(["render", "plain.scene", "-o", "a.gif", *tiles, *flight])


def test_beyond_the_gl_limit(refused: Callable[..., str], place: Path) -> None:
    assert "limit" in refused([*RENDER, "--size", "1000000", "1", "--tile-size", "0"])
