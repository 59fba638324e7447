"""Determinism: equal runs give equal bytes.

The bytes are those of PNG, EXR, records and every array, with one or several threads, and under other versions of OpenGL.
IRRSPLAT_RUNS=full: all bundled scenes in every circumstance (else one small render in two of them). With -s, the
comparisons are printed.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.scene import bundled
from tests.renderer.test_renderer import FAST, room

FULL = os.environ.get("IRRSPLAT_RUNS") == "full"
CIRCUMSTANCES: dict[str, dict[str, str]] = {
    "one thread": {"LP_NUM_THREADS": "1"},
    "OpenGL 3.3": {"MESA_GL_VERSION_OVERRIDE": "3.3", "MESA_GLSL_VERSION_OVERRIDE": "330"},
    "again": {},
    "two threads": {"LP_NUM_THREADS": "2"},
    "OpenGL 4.1": {"MESA_GL_VERSION_OVERRIDE": "4.1", "MESA_GLSL_VERSION_OVERRIDE": "410"},
    "other hashes": {"PYTHONHASHSEED": "7"},
    "another place and time": {"TZ": "Pacific/Kiritimati", "LC_ALL": "C"},
}
TRIED = list(CIRCUMSTANCES) if FULL else list(CIRCUMSTANCES)[:2]
SIZE = ["120", "90"] if FULL else ["48", "40"]


def test_equal_renders_give_equal_arrays() -> None:
    """The renders are in one process, with separate renderers."""
    one, two = (irrsplat.render(room(), (24, 20), **FAST) for _ in range(2))
    names = [name for name, value in vars(one).items() if isinstance(value, np.ndarray)]
    assert len(names) > 10 and [name for name in names if getattr(one, name).tobytes() != getattr(two, name).tobytes()] == []


def made(folder: Path, scene: str, environment: dict[str, str]) -> dict[str, str]:
    """Return hashes of a process's renders by name: of whole files, and of each array of an NPZ."""
    folder.mkdir(parents=True)
    outputs = ["-o", "a.png", "-o", "a.exr", "-o", "a.npz", "--cache", "a.cache"]
    command = [sys.executable, "-m", "irrsplat", "render", scene, "--size", *SIZE, *outputs]
    subprocess.run(command, cwd=folder, env=os.environ | environment, check=True)
    with np.load(folder / "a.npz") as file:
        arrays = {name: file[name].tobytes() for name in file.files if name != "stats"}
    files = {name: (folder / name).read_bytes() for name in ("a.png", "a.exr", "a.cache")}
    if "MESA_GL_VERSION_OVERRIDE" in environment:  # an EXR stores the OpenGL version
        del files["a.exr"]
    return {name: hashlib.sha256(content).hexdigest() for name, content in (arrays | files).items()}


@pytest.mark.long
@pytest.mark.parametrize("scene", bundled() if FULL else ["furnace"])
def test_equal_runs_give_equal_bytes(scene: str, tmp_path: Path) -> None:
    first = made(tmp_path / "first", scene, {})
    for name in TRIED:
        other = made(tmp_path / name, scene, CIRCUMSTANCES[name])
        different = [key for key, value in other.items() if value != first[key]]
        assert not different, f"{scene}, {name}: {', '.join(different)}"
    print(f"\n{scene}: {len(first)} files and arrays are equal in {len(TRIED) + 1} runs")
