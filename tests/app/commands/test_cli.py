"""The command line: what it accepts, what it refuses with one line and exit status 2, and what it leaves behind."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat.scene
from irrsplat.app import cli, grammar
from irrsplat.app.common import terminal
from irrsplat.core.errors import GLError
from irrsplat.core.load_options import LoadOptions
from irrsplat.gpu import context
from irrsplat.image.view import Progress
from irrsplat.scene.model import Camera, Light, Scene
from irrsplat.settings import SETTINGS
from tests.support.luminaires import ies_text, isotropic
from tests.support.worlds import material, quad

RENDER = ["render", "plain.scene", "-o", "a.png"]


def test_the_defaults(fake: Any, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["render", "-o", "a.npz"]) == 0
    assert (fake.asked.scene.name, fake.asked.size, fake.asked.preset) == ("cornell", (800, 800), "default")
    assert fake.asked.settings == {}
    assert fake.asked.figures is False
    assert capsys.readouterr() == ("", "")  # piped: silence


def test_flags_reach_the_renderer(fake: Any, place: Path) -> None:
    values = {"a": "0.3", "tolerance": "4", "blend": "1", "exposure": "-1.5", "bounces": "0", "gather": "plane", "seed": "7"}
    flags = [word for name, value in values.items() for word in (f"--{name}", value)]
    assert cli.main([*RENDER, "--size", "6", "4", "--preset", "preview", "--gather-size=64", *flags]) == 0
    assert fake.asked.size == (6, 4)
    assert fake.asked.preset == "preview"
    wanted = {"a": 0.3, "tolerance": 4.0, "blend": 1.0, "exposure": -1.5, "bounces": 0, "gather": "plane", "seed": 7}
    assert fake.asked.settings == {**wanted, "gather_size": 64}


def test_former_flags_of_settings_still_work_and_are_not_advertised(
    fake: Any, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["render", "--size", "2", "2", "-o", "a.png", "--rest", "5", "--overture", "plain.scene"]) == 0
    assert fake.asked.settings == {"viewer_samples": 5, "fill_holes": True}
    assert cli.main(["render", "--help"]) == 0
    assert not re.search("--(rest|overture)", capsys.readouterr().out)


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
def test_a_switch_never_swallows_the_scene(words: list[str], value: bool, fake: Any, place: Path) -> None:
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
        args = grammar.build().parse_args([*RENDER, declaration.flag, "x"])
        assert getattr(args, "set_" + declaration.name) == "x"


@pytest.mark.parametrize("command", ["view", "render", "info", "verify", "bench"])
def test_how_a_file_is_read_is_told_wherever_a_scene_is_given(command: str) -> None:
    output = ["-o", "a.png"] if command == "render" else []
    args = grammar.parse([command, "a.stl", "--up-axis", "z", "--crease-angle", "25", "--time", "1.5", *output])
    assert args.loading == LoadOptions("z", 25.0, 1.5)
    assert grammar.parse([command, "a.stl", *output]).loading == LoadOptions()


def test_negative_numbers_of_every_spelling(fake: Any, place: Path) -> None:
    eye, target, up = ["-1", "-.5", "-1e-3"], ["-2.5E+2", "+3", "-0"], ["0", "-1", "-1e0"]
    assert cli.main([*RENDER, "--eye", *eye, "--target", *target, "--up", *up, "--fov", "30", "--size", "2", "2"]) == 0
    camera = fake.asked.camera
    assert camera.eye == (-1.0, -0.5, -0.001)
    assert camera.target == (-250.0, 3.0, 0.0)
    assert camera.up == (0.0, -1.0, -1.0)
    assert camera.fov == 30.0


def test_what_a_camera_lacks_comes_from_the_scene(fake: Any, place: Path) -> None:
    (place / "plain.scene").write_text((place / "plain.scene").read_text() + "cam side 5 0 0 0 0 0 0 0 1\n")
    small = ["--size", "2", "2"]
    assert cli.main([*RENDER, *small, "--eye", "1", "1", "1", "--target", "0", "0", "0"]) == 0
    assert (fake.asked.camera.eye, fake.asked.camera.up, fake.asked.camera.fov) == ((1, 1, 1), (0, 1, 0), 40)
    assert cli.main([*RENDER, *small, "--camera", "side", "--fov", "20"]) == 0
    assert (fake.asked.camera.eye, fake.asked.camera.up, fake.asked.camera.fov) == ((5, 0, 0), (0, 0, 1), 20)


def test_outputs_may_be_repeated_and_restricted(fake: Any, place: Path) -> None:
    outputs = ["-o", "b.npz", "-o", "folder/", "--buffers", "depth, weight", "--stats", "s.json"]
    assert cli.main([*RENDER, *outputs, "--size", "3", "2"]) == 0
    assert fake.asked.figures is True
    assert (place / "a.png").is_file()
    with np.load(place / "b.npz") as file:
        assert set(file) == {"depth", "weight", "stats"}
    assert {"depth.png", "weight.png", "figure2_direct.png"} <= {p.name for p in (place / "folder").iterdir()}
    assert json.loads((place / "s.json").read_text())["converged"] is True


def test_an_interrupted_render_is_written_and_exits_with_130(fake: Any, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fake.stats = {"converged": False, "interrupted": True, "rounds": 4}
    assert cli.main([*RENDER, "--stats", "s.json", "--size", "2", "2"]) == 130
    assert capsys.readouterr().err == "irrsplat: interrupted; the files hold what 4 whole rounds gave\n"
    assert (place / "a.png").is_file()
    assert json.loads((place / "s.json").read_text())["converged"] is False


def test_notices_and_an_unfinished_render_are_said(fake: Any, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "plain.scene").write_text("obj triangle.obj\n")  # neither light nor camera
    fake.stats = {"converged": False, "rounds": 64}
    assert cli.main([*RENDER, "--size", "2", "2"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert [line.split(":")[0] for line in err.splitlines()] == ["notice"] * 3
    assert "--max-rounds" in err


def test_progress_on_a_terminal_only(fake: Any, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_info_says_what_a_file_holds_and_what_stands_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 0.5 0.1 0.1\nmap_Kd red.png\n")
    Image.new("RGB", (300, 200), (255, 0, 0)).save(tmp_path / "red.png")
    (tmp_path / "a.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl red\nf 1/1 2/1 3/1\n")
    assert cli.main(["info", str(tmp_path / "a.obj"), "--up-axis", "z"]) == 0
    text = capsys.readouterr().out
    assert "up (0 0 1)" in text and "materials  1\n" in text and "textures   1, 0.06 megapixels" in text
    assert "red.png 300x200" in text and "'key', stands in" in text and "W/m² (lux)" in text
    assert "brighter above by" in text and text.count("stands in") == 3, "sky, key and, in a notice, the camera"


def test_info_tells_lenses_and_units(place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    lights = (Light((0, 1, 0), (2, 2, 2), physical=True), Light((0, 1, 0), (1, 1, 1), directional=True))
    cameras = (Camera((0, 0, 5), (0, 0, 0), fov=40.0), Camera((0, 0, 2000.0), (0, 0, 0), fov=0.1, name="flat"))
    mesh = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), material(0.5, 3.0))
    monkeypatch.setattr(irrsplat.scene, "load", lambda *_, **__: Scene((mesh,), lights, cameras))
    assert cli.main(["info", "plain.scene"]) == 0
    text = capsys.readouterr().out
    assert "intensity (2 2 2) W/sr (candela)" in text and "irradiance (3.142 3.142 3.142) W/m² (lux)" in text
    assert "fov 40°" in text and "'flat': eye (0 0 2000), target (0 0 0), orthographic, 3.491 m high" in text
    assert "materials  1: 1 emits" in text and "emission (3 3 3) W/(m² sr)" in text


def test_info_tells_what_luminaires_send_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """100 cd all around are 400π = 1257 lm; dimmed to a half on all channels, half of both. Downwards 0 is turned towards z."""
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "round.ies").write_text(ies_text([0, 90, 180], [0], isotropic, units=1))
    (tmp_path / "dim.light").write_text(
        "ies round.ies\nposition 0 2 0 1\nspotDirection 0 0 0\nzeroDirection 0 0 1\nintensity 0.5 0.5 0.5\n"
    )
    (tmp_path / "a.scene").write_text("obj t.obj\ntrans 1 2 3\nlight round.ies\nlight dim.light\n")
    assert cli.main(["info", str(tmp_path / "a.scene")]) == 0
    text = capsys.readouterr().out
    first, second = (line.strip() for line in text.splitlines() if line.startswith("    luminaire"))
    assert first == (
        "luminaire at (1 2 3), aimed along (0 0 -1), 0° towards (1 0 0), 1257 lm, at most 100 cd, "
        "0.152 x 0.152 m (taken as a point) 'round'"
    )
    assert "at (0 2 0), aimed along (0 -1 0), 0° towards (0 0 1), 628.3 lm, at most 50 cd, intensity (0.5 0.5 0.5)" in second


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


def test_waiting_threads_of_openblas_sleep() -> None:
    """It reads that when numpy is loaded: so the program says it before; a user's own word counts, and programs that import
    irrsplat keep theirs."""
    name = "OPENBLAS_THREAD_TIMEOUT"
    code = f"import os, sys; from irrsplat.app import cli; {{}}; print('numpy' in sys.modules, os.environ.get('{name}'))"
    plain = {key: value for key, value in os.environ.items() if key != name}
    for call, environment, expected in (
        ("cli.main()", plain, "4"),
        ("cli.main()", plain | {name: "20"}, "20"),
        ("cli.main(['--version'])", plain, "None"),
    ):
        words = [sys.executable, "-c", code.format(call), "--version"]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=60, check=True)
        assert done.stdout.splitlines()[-1] == f"False {expected}"


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


def test_the_command_line_has_samples(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["plain.scene", "--size", "16", "12", "--gather-size", "8", "--samples", "3", "--stats", "s.json"]
    assert cli.main(["render", *small, "-o", "one.png"]) == 0, capsys.readouterr().err
    assert json.loads(Path("s.json").read_text())["samples"] == 3
    Path("f.path").write_text("cam 0 0 5 0 0 0 0 1 0\ncam 1 0 5 0 0 0 0 1 0\nframes 2\n")
    assert cli.main(["render", *small, "--path", "f.path", "-o", "f{frame}.png"]) == 0, capsys.readouterr().err
    assert [frame["samples"] for frame in json.loads(Path("s.json").read_text())["frames"]] == [3, 3]
    assert cli.main(["render", *small, "-o", "one.png", "--samples", "0"]) == 2


def test_verify_s_samples_are_the_path_tracer_s() -> None:
    args = grammar.parse(["verify", "--samples", "64"])
    assert args.samples == 64 and args.values == {}


# ---- the progress line, and what is said of files ----------------------------------------------------------------------------


def lines_shown(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float]]:
    """What the progress line is told from now on: words, and the share done."""
    from rich.progress import Progress as Bar

    said: list[tuple[str, float]] = []
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(Bar, "update", lambda self, task, **what: said.append((what["description"], what["completed"])))
    return said


@pytest.mark.parametrize(
    ("state", "flags", "words", "share"),
    [
        ({"coverage": 0.25}, [], "round 2: 9 records, coverage", 0.25),
        ({"coverage": 1.0, "sampled": 0.5}, ["--samples", "4"], "round 2: 9 records, samples", 0.5),
        ({"coverage": 1.0, "error": 0.04}, ["--quality", "2"], "round 2: 9 records, error 4 % to 2 %", 0.25),
        ({"coverage": 1.0, "error": 0.01}, ["--quality", "2"], "round 2: 9 records, error 1 % to 2 %", 1.0),
    ],
)
def test_each_stage_says_what_is_done(
    state: dict[str, Any], flags: list[str], words: str, share: float, fake: Any, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = lines_shown(monkeypatch)
    fake.told = Progress(**{"round": 2, "records": 9, "new": 0, **state})
    assert cli.main([*RENDER, "--size", "2", "2", *flags]) == 0
    assert [line for line, _ in said] == [words] and said[0][1] == pytest.approx(share)


def test_what_is_written_is_said_on_a_terminal_only(
    fake: Any, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = [*RENDER, "-o", "b.npz", "--stats", "s.json", "--size", "2", "2"]
    assert cli.main(argv) == 0
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert cli.main(argv) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert re.findall(r"wrote (\S+)\n", err) == ["a.png", "b.npz", "s.json"]


def test_the_time_left_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A quarter of a stage each second: two seconds are left after the second quarter. Of a stage that has just begun, none are
    known."""
    from rich import progress as bars

    seconds = [0.0]
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(bars, "Progress", partial(bars.Progress, get_time=lambda: seconds[0], auto_refresh=False))
    for stages, left in (("aaa", True), ("aab", False)):
        with terminal.progress("first") as line:
            assert line is not None
            for i, stage in enumerate(stages):
                seconds[0] = float(i)
                line(0.25 * i, "words", stage)
        shown = capsys.readouterr().err
        assert "words" in shown and ("0:02 left" in shown) == left
