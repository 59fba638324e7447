"""The command line: what it accepts, what it refuses with one line and exit status 2, and what it leaves behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli, parser
from irrsplat.buffers import CHANNELS
from irrsplat.errors import GLError, InputError
from irrsplat.gpu import context
from irrsplat.output import Frame
from irrsplat.settings import SETTINGS

PLAIN = """cam 0 0 5 0 0 0 0 1 0
proj 40 1 0.1 100
sky 1 1 1
obj triangle.obj
"""
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


class FakeRenderer:
    """Stands in for the real one: keeps what it was asked, and hands out a frame of constants."""

    asked: SimpleNamespace
    stats: dict[str, Any]

    def __init__(self, scene: Any, size: tuple[int, int], preset: str, **settings: Any) -> None:
        type(self).asked = SimpleNamespace(scene=scene, size=size, preset=preset, settings=settings)

    def __enter__(self) -> FakeRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def render(self, camera: Any = None, progress: Callable[[Any], None] | None = None, figures: bool = False) -> Frame:
        vars(self.asked).update(camera=camera, figures=figures, progress=progress)
        if progress is not None:
            progress(SimpleNamespace(round=1, records=3, new=3, coverage=0.5))
        width, height = self.asked.size
        arrays = {n: np.ones((height, width, 3) if c.components == 3 else (height, width), "f4") for n, c in CHANNELS.items()}
        records = {f.name: np.ones((1, 3), "f4") for f in fields(Frame) if f.name.startswith("records_")}
        return Frame(**arrays, **records, stats={"rounds": 1, "records": 1, "converged": True, "exposure": 0.0} | self.stats)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> type[FakeRenderer]:
    monkeypatch.setattr(irrsplat, "Renderer", FakeRenderer)
    FakeRenderer.stats = {}
    FakeRenderer.asked = SimpleNamespace()
    return FakeRenderer


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a small scene in it."""
    (tmp_path / "plain.scene").write_text(PLAIN)
    (tmp_path / "triangle.obj").write_text(TRIANGLE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refused(place: Path, capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., str]]:
    """Runs a command line that must fail with `status`, one line on stderr, nothing on stdout, and no new file."""

    def run(argv: list[str], status: int = 2) -> str:
        before = sorted(place.rglob("*"))
        assert cli.main(argv) == status
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1 and err.endswith("\n"), err
        assert err.startswith("irrsplat: ")
        assert "Traceback" not in err
        assert sorted(place.rglob("*")) == before
        return err

    yield run


RENDER = ["render", "plain.scene", "-o", "a.png"]


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([], "COMMAND"),
        (["paint"], "paint"),
        (["view"], "view"),  # not built yet, so not offered
        (["verify"], "verify"),
        (["--nonsense"], "COMMAND"),
        (["render"], "-o/--output"),
        (["render", "plain.scene"], "-o/--output"),
        (["render", "plain.scene", "-o"], "expected one argument"),
        ([*RENDER, "another"], "another"),
        ([*RENDER, "--nonsense"], "--nonsense"),
        ([*RENDER, "--siz", "4", "4"], "--siz"),  # no abbreviations
        ([*RENDER, "--path", "x", "--frames", "0:9"], "--path"),
        ([*RENDER, "--cache", "x"], "--cache"),
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
        ([*RENDER, "--gather", "trace"], "auto|plane|raster"),
        ([*RENDER, "--smooth=maybe"], "on|off"),
        ([*RENDER, "--bounces", "2"], "only 0 and 1 are built yet"),
        ([*RENDER, "--bounces", "all"], "only 0 and 1 are built yet"),
        ([*RENDER, "--bounces", "-1"], "takes 0..1"),
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
        ([*RENDER, "-o", "a.mp4"], ".png, .exr, .npz"),
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
    argv: list[str], words: str, refused: Callable[..., str], fake: type[FakeRenderer]
) -> None:
    assert words in refused(argv)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLAIN + "brdf diffuse 1 2\n", "plain.scene:5"),
        (PLAIN.replace("obj triangle.obj", "obj none.obj"), "none.obj"),
        ("", "plain.scene"),
    ],
)
def test_a_wrong_scene_is_one_line_before_any_notice(
    text: str, words: str, refused: Callable[..., str], place: Path, fake: type[FakeRenderer]
) -> None:
    (place / "plain.scene").write_text(text)
    assert words in refused(RENDER)


def test_outputs_are_tried_before_the_scene_is_loaded(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    def load(_: object) -> None:
        pytest.fail("the scene was loaded first")

    monkeypatch.setattr(irrsplat, "load", load)
    assert "does not exist" in refused([*RENDER, "-o", "missing/b.exr"])


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (InputError("size 99999x1 is beyond the limit"), 2, "beyond"),
        (GLError("no OpenGL 3.3: run: sudo apt-get install -y libegl1"), 1, "libegl1"),
        (RuntimeError("two\nlines"), 1, "internal error: RuntimeError: two lines"),
        (MemoryError(), 1, "MemoryError"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_the_renderer_raises(
    error: BaseException, status: int, words: str, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(irrsplat, "Renderer", fail)
    assert words in refused(RENDER, status)


def test_the_defaults(fake: type[FakeRenderer], place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["render", "-o", "a.npz"]) == 0
    assert (fake.asked.scene.name, fake.asked.size, fake.asked.preset) == ("cornell", (800, 800), "default")
    assert fake.asked.settings == {}
    assert fake.asked.figures is False
    assert capsys.readouterr() == ("", "")  # piped: silence


def test_flags_reach_the_renderer(fake: type[FakeRenderer], place: Path) -> None:
    values = {"a": "0.3", "tolerance": "4", "blend": "1", "exposure": "-1.5", "bounces": "0", "gather": "plane", "seed": "7"}
    flags = [word for name, value in values.items() for word in (f"--{name}", value)]
    assert cli.main([*RENDER, "--size", "6", "4", "--preset", "preview", "--gather-size=64", *flags]) == 0
    assert fake.asked.size == (6, 4)
    assert fake.asked.preset == "preview"
    wanted = {"a": 0.3, "tolerance": 4.0, "blend": 1.0, "exposure": -1.5, "bounces": 0, "gather": "plane", "seed": 7}
    assert fake.asked.settings == {**wanted, "gather_size": 64}


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (["--smooth", "plain.scene"], True),
        (["--smooth", "on", "plain.scene"], True),
        (["--smooth", "OFF", "plain.scene"], False),
        (["--smooth=off", "plain.scene"], False),
        (["plain.scene", "--smooth"], True),
        (["plain.scene", "--smooth", "off"], False),
    ],
)
def test_a_switch_never_swallows_the_scene(words: list[str], value: bool, fake: type[FakeRenderer], place: Path) -> None:
    assert cli.main(["render", "--size", "2", "2", "-o", "a.png", *words]) == 0
    assert fake.asked.scene.name == "plain"
    assert fake.asked.settings == {"smooth": value}


def test_every_setting_is_a_flag_with_range_and_default(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    assert cli.main(["render", "--help"]) == 0
    text = capsys.readouterr().out
    for declaration in SETTINGS.values():
        assert f"{declaration.flag} " in text
        assert f"({declaration.range}; default: " in text
        args = parser.build().parse_args([*RENDER, declaration.flag, "x"])
        assert getattr(args, "set_" + declaration.name) == "x"


def test_negative_numbers_of_every_spelling(fake: type[FakeRenderer], place: Path) -> None:
    eye, target, up = ["-1", "-.5", "-1e-3"], ["-2.5E+2", "+3", "-0"], ["0", "-1", "-1e0"]
    assert cli.main([*RENDER, "--eye", *eye, "--target", *target, "--up", *up, "--fov", "30", "--size", "2", "2"]) == 0
    camera = fake.asked.camera
    assert camera.eye == (-1.0, -0.5, -0.001)
    assert camera.target == (-250.0, 3.0, 0.0)
    assert camera.up == (0.0, -1.0, -1.0)
    assert camera.fov == 30.0


def test_what_a_camera_lacks_comes_from_the_scene(fake: type[FakeRenderer], place: Path) -> None:
    (place / "plain.scene").write_text(PLAIN + "cam side 5 0 0 0 0 0 0 0 1\n")
    small = ["--size", "2", "2"]
    assert cli.main([*RENDER, *small, "--eye", "1", "1", "1", "--target", "0", "0", "0"]) == 0
    assert (fake.asked.camera.eye, fake.asked.camera.up, fake.asked.camera.fov) == ((1, 1, 1), (0, 1, 0), 40)
    assert cli.main([*RENDER, *small, "--camera", "side", "--fov", "20"]) == 0
    assert (fake.asked.camera.eye, fake.asked.camera.up, fake.asked.camera.fov) == ((5, 0, 0), (0, 0, 1), 20)


def test_outputs_may_be_repeated_and_restricted(fake: type[FakeRenderer], place: Path) -> None:
    outputs = ["-o", "b.npz", "-o", "folder/", "--buffers", "depth, weight", "--stats", "s.json"]
    assert cli.main([*RENDER, *outputs, "--size", "3", "2"]) == 0
    assert fake.asked.figures is True
    assert (place / "a.png").is_file()
    with np.load(place / "b.npz") as file:
        assert set(file) == {"depth", "weight", "stats"}
    assert {"depth.png", "weight.png", "figure2_direct.png"} <= {p.name for p in (place / "folder").iterdir()}
    assert json.loads((place / "s.json").read_text())["converged"] is True


def test_an_interrupted_render_is_written_and_exits_with_130(
    fake: type[FakeRenderer], place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fake.stats = {"converged": False, "interrupted": True, "rounds": 4}
    assert cli.main([*RENDER, "--stats", "s.json", "--size", "2", "2"]) == 130
    assert capsys.readouterr().err == "irrsplat: interrupted; the files hold what 4 whole rounds gave\n"
    assert (place / "a.png").is_file()
    assert json.loads((place / "s.json").read_text())["converged"] is False


def test_notices_and_an_unfinished_render_are_said(
    fake: type[FakeRenderer], place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (place / "plain.scene").write_text("obj triangle.obj\n")  # neither light nor camera
    fake.stats = {"converged": False, "rounds": 64}
    assert cli.main([*RENDER, "--size", "2", "2"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert [line.split(":")[0] for line in err.splitlines()] == ["notice"] * 3
    assert "--max-rounds" in err


def test_progress_on_a_terminal_only(fake: type[FakeRenderer], place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cli.main([*RENDER, "--size", "2", "2"]) == 0
    assert fake.asked.progress is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert cli.main([*RENDER, "--size", "2", "2"]) == 0
    assert fake.asked.progress is not None


def test_info(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info", "plain.scene"]) == 0
    text = capsys.readouterr().out
    assert "1 in 1 mesh: 0 closed, 1 open" in text
    assert "eye (0 0 5)" in text and "fov 40°" in text
    assert cli.main(["info"]) == 0
    assert {"cornell", "cornell-paper", "furnace"} <= {line.split()[0] for line in capsys.readouterr().out.splitlines()}


def test_doctor(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert cli.main(["doctor"]) == 0
    out, err = capsys.readouterr()
    assert "moderngl" in out and "renderer" in out and "enough" in out
    assert err == ""

    def none(*_: object) -> None:
        raise GLError(context.advice("libEGL.so not loaded"))

    monkeypatch.setattr(context, "create", none)
    assert cli.main(["doctor"]) == 1
    assert (
        capsys.readouterr().err
        == "irrsplat: no OpenGL 3.3: the library libEGL is missing; run: sudo apt-get install -y libegl1\n"
    )


def test_a_machine_without_gl(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> None:
        raise GLError(context.advice("libGL.so not loaded"))

    monkeypatch.setattr(context, "create", none)
    assert "libgl1" in refused(RENDER, 1)


def test_version_help_and_module_are_fast(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.split()[0] == "irrsplat"
    for argv in (["--help"], ["render", "--help"], ["bench", "--help"], ["info", "--help"], ["doctor", "--help"]):
        assert cli.main(argv) == 0
        assert "usage: irrsplat" in capsys.readouterr().out
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "irrsplat", "--version"], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert time.monotonic() - start < 5.0


def test_a_closed_pipe_is_no_error() -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "irrsplat", "info"], stdout=write, stderr=subprocess.PIPE, timeout=60, check=False
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


def test_end_to_end(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The real renderer, a triangle before a white sky, from the command line to every kind of file."""
    outputs = ["-o", "a.exr", "-o", "a.npz", "-o", "folder", "--stats", "s.json"]
    assert cli.main([*RENDER, *outputs, "--size", "16", "12", "--gather-size", "8"]) == 0
    assert capsys.readouterr() == ("", "")
    with np.load(place / "a.npz") as file:
        assert file["image"].shape == (12, 16, 3)
        assert np.isinf(file["depth"]).any() and np.isfinite(file["depth"]).any()
        np.testing.assert_allclose(file["image"][np.isinf(file["depth"])], 1.0)  # the sky's radiance
        assert file["records_position"].shape == (len(file["records_radius"]), 3)
    assert len(list((place / "folder").glob("figure*.png"))) == 6
    assert json.loads((place / "s.json").read_text())["converged"] is True


def test_beyond_the_gl_limit(refused: Callable[..., str]) -> None:
    assert "limit" in refused([*RENDER, "--size", "1000000", "1"])
