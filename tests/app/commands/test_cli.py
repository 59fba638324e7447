"""The command line: arguments, files and printed output."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.app import cli, grammar
from irrsplat.core.errors import GLError
from irrsplat.core.load_options import LoadOptions
from irrsplat.gpu import context
from irrsplat.image.view import Progress
from irrsplat.settings import SETTINGS

RENDER = ["render", "plain.scene", "-o", "a.png"]
SMALL = ["--size", "2", "2"]


def test_flags_reach_the_renderer(fake: Any, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The renderer receives each flag's value; a flag without a value leaves the next word as the scene."""
    assert cli.main(["render", "-o", "a.npz"]) == 0
    assert (fake.arguments.scene.name, fake.arguments.size, fake.arguments.preset) == ("cornell", (800, 800), "default")
    assert fake.arguments.settings == {} and fake.arguments.figures is False
    assert capsys.readouterr() == ("", "")  # no output without a terminal
    values = {"a": "0.3", "tolerance": "4", "blend": "1", "exposure": "-1.5", "bounces": "0", "gather": "plane", "seed": "7"}
    flags = [word for name, value in values.items() for word in (f"--{name}", value)]
    assert cli.main([*RENDER, "--size", "6", "4", "--preset", "preview", "--gather-size=64", *flags]) == 0
    assert (fake.arguments.size, fake.arguments.preset) == ((6, 4), "preview")
    requested = {"a": 0.3, "tolerance": 4.0, "blend": 1.0, "exposure": -1.5, "bounces": 0, "gather": "plane", "seed": 7}
    assert fake.arguments.settings == {**requested, "gather_size": 64, "samples": 16}, "a picture has 16 samples per pixel"
    for words, value in ((["--fill-holes"], True), (["--fill-holes", "OFF"], False), (["--fill-holes=off"], False)):
        assert cli.main(["render", *SMALL, "-o", "a.png", "--viewer-samples", "5", *words, "plain.scene"]) == 0
        assert fake.arguments.scene.name == "plain" and fake.arguments.settings == {
            "viewer_samples": 5,
            "fill_holes": value,
            "samples": 16,
        }


def test_help_lists_all_settings(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Help lists each setting as a flag with its range and default."""
    monkeypatch.setenv("COLUMNS", "1000")
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.split()[0] == "irrsplat"
    for command in ("view", "info", "verify", "bench", "render"):
        assert cli.main([command, "--help"]) == 0
        text = capsys.readouterr().out
        assert f"usage: irrsplat {command}" in text
        args = [command, "a.stl", "--up-axis", "z", "--crease-angle", "25"]
        loading = grammar.parse([*args, "-o", "a.png"] if command == "render" else args).loading
        assert loading == LoadOptions("z", 25.0)
    for declaration in SETTINGS.values():
        assert f"{declaration.flag} " in text and f"({declaration.range}; default: " in text
    assert grammar.parse(["verify", "--samples", "64"]).values == {}, "--samples of verify is no setting of the renderer"


def test_an_added_camera_is_reported_only_if_the_picture_may_show_its_view(
    fake: Any, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (place / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for flags, reported in (([], True), (["--fov", "30"], True), (["--eye", "0", "0", "2", "--target", "0", "0", "0"], False)):
        assert cli.main(["render", "bare.obj", *SMALL, "-o", "a.png", *flags]) == 0
        printed = capsys.readouterr().err
        assert ("no camera" in printed) == reported and "no light" in printed


def test_cameras_from_flags(fake: Any, place: Path) -> None:
    """Negative numbers in all spellings are values, not flags; the scene's camera provides omitted values."""
    (place / "plain.scene").write_text((place / "plain.scene").read_text() + "cam side 5 0 0 0 0 0 0 0 1\n")
    numbers = ["--eye", "-1", "-.5", "-1e-3", "--target", "-2.5E+2", "+3", "-0", "--up", "0", "-1", "-1e0"]
    for words, *requested in (
        ([*numbers, "--fov", "30"], (-1.0, -0.5, -0.001), (-250.0, 3.0, 0.0), (0.0, -1.0, -1.0), 30.0),
        (["--eye", "1", "1", "1", "--target", "0", "0", "0"], (1, 1, 1), (0, 0, 0), (0, 1, 0), 40),
        (["--camera", "side", "--fov", "20"], (5, 0, 0), (0, 0, 0), (0, 0, 1), 20),
    ):
        assert cli.main([*RENDER, *SMALL, *words]) == 0
        camera = fake.arguments.camera
        assert [camera.eye, camera.target, camera.up, camera.fov] == requested


def test_an_unfinished_render_is_written(fake: Any, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Files are written after Ctrl-C, with exit status 130, and after the last allowed round, with a notice."""
    fake.stats = {"converged": False, "interrupted": True, "rounds": 4}
    assert cli.main([*RENDER, "--stats", "s.json", *SMALL]) == 130
    assert capsys.readouterr().err == "irrsplat: interrupted; the files hold what 4 whole rounds gave\n"
    assert (place / "a.png").is_file() and json.loads((place / "s.json").read_text())["converged"] is False
    (place / "plain.scene").write_text("obj triangle.obj\n")  # neither light nor camera
    fake.stats = {"converged": False, "rounds": 64}
    assert cli.main([*RENDER, *SMALL]) == 0
    out, err = capsys.readouterr()
    assert out == "" and [line.split(":")[0] for line in err.splitlines()] == ["notice"] * 3 and "raise --a" in err


# ---- other commands ------------------------------------------------------------------------------------------------------


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


def test_help_loads_no_library() -> None:
    """`--help` loads no library, nor importlib.metadata, which takes a fifth of its time.

    OpenBLAS reads its variable when numpy is loaded, and the program sets it earlier.
    """
    code = (
        "import os, sys; before = set(sys.modules); from irrsplat.app import cli; cli.main(); "
        "print(os.environ['OPENBLAS_THREAD_TIMEOUT'], *{name.split('.')[0] for name in set(sys.modules) - before}"
        " - sys.stdlib_module_names - {'irrsplat'}, *{'importlib.metadata'} & set(sys.modules) - before, file=sys.stderr)"
    )
    plain = {key: value for key, value in os.environ.items() if key != "OPENBLAS_THREAD_TIMEOUT"}
    words = [sys.executable, "-c", code, "render", "--help"]
    done = subprocess.run(words, env=plain, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("usage: irrsplat render")
    assert done.stderr.split() == ["4"]


def test_a_closed_pipe_is_ignored() -> None:
    """`head` in `irrsplat info | head` closes the pipe early; the module then ends with status 0."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-m", "irrsplat", "info"], stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


def test_a_render_writes_all_kinds_of_files(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The real renderer writes each kind of file; pixels of the white sky are exactly 1."""
    outputs = ["-o", "a.exr", "-o", "a.npz", "-o", "b.npz", "-o", "folder/", "--stats", "s.json", "--samples", "3"]
    assert cli.main([*RENDER, *outputs, "--size", "16", "12", "--gather-size", "8", "--bounces", "1"]) == 0
    assert capsys.readouterr() == ("", "")
    with np.load(place / "a.npz") as file:
        assert file["image"].shape == (12, 16, 3)
        assert np.isinf(file["depth"]).any() and np.isfinite(file["depth"]).any()
        np.testing.assert_allclose(file["image"][np.isinf(file["depth"])], 1.0)  # the sky's radiance
        assert file["records_position"].shape == (len(file["records_radius"]), 3)
    assert len(list((place / "folder").glob("figure*.png"))) == 6
    stats = json.loads((place / "s.json").read_text())
    assert stats["converged"] is True and stats["samples"] == 3
    assert cli.main([*RENDER, "-o", "b.npz", *SMALL, "--bounces", "0", "--buffers", "depth, weight"]) == 0
    with np.load(place / "b.npz") as file:
        assert set(file) == {"depth", "weight", "stats"}
    assert cli.main([*RENDER, "--samples", "0"]) == 2


# ---- the progress line and the names of files ----------------------------------------------------------------------------


def test_the_progress_line_is_for_a_terminal_only(
    fake: Any, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line shows progress in coverage, samples or error; the names of the files follow at the end."""
    from rich.progress import Progress as Bar

    assert cli.main([*RENDER, *SMALL]) == 0
    assert fake.arguments.progress is None and capsys.readouterr() == ("", "")
    shown: list[tuple[str, float]] = []
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(Bar, "update", lambda self, task, **what: shown.append((what["description"], what["completed"])))
    for coverage, sampled, error, flags, words, share in (
        (0.25, None, None, [], "coverage", 0.25),
        (1.0, 0.5, None, ["--samples", "4"], "samples", 0.5),
        (1.0, None, 0.04, ["--quality", "2"], "error 4 % to 2 %", 0.25),
    ):
        shown.clear()
        values: dict[str, Any] = {"coverage": coverage, "sampled": sampled, "error": error}
        fake.reported = Progress(round=2, records=9, new=0, **{name: x for name, x in values.items() if x is not None})
        assert cli.main([*RENDER, "-o", "b.npz", "--stats", "s.json", *SMALL, *flags]) == 0
        assert [line for line, _ in shown] == [f"round 2: 9 records, {words}"] and shown[0][1] == pytest.approx(share)
        out, err = capsys.readouterr()
        assert out == "" and re.findall(r"wrote (\S+)\n", err) == ["a.png", "b.npz", "s.json"]
