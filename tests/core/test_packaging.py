"""A wheel, installed away from the checkout: it brings shaders and scenes along, and no other package."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.long  # building and installing a wheel
SETUPTOOLS = 77  # the first that reads pyproject.toml's licence


def run(*command: str, **environment: str) -> str:
    """Return the output of `command`, run from the root folder; the test fails with that output if the command fails."""
    done = subprocess.run(
        command, cwd="/", env={**os.environ, **environment}, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that a wheel of this checkout was installed into, alone."""
    work = tmp_path_factory.mktemp("wheel")
    skip = shutil.ignore_patterns(".*", "build", "dist", "out", "*.egg-info", "__pycache__", "tests")
    shutil.copytree(ROOT, work / "source", ignore=skip)  # a build writes into its source
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "-q")
    try:
        here = int(metadata.version("setuptools").split(".")[0]) >= SETUPTOOLS
    except metadata.PackageNotFoundError:
        here = False
    isolation = ("--no-build-isolation",) if here else ()  # without, pip fetches setuptools
    run(*pip, "wheel", "--no-deps", *isolation, "--wheel-dir", str(work), str(work / "source"))
    (wheel,) = work.glob("irrsplat-*.whl")
    run(*pip, "install", "--no-deps", "--target", str(work / "site"), str(wheel))
    return work / "site"


def test_nothing_but_irrsplat_is_importable(installed: Path) -> None:
    names = {path.name for path in installed.iterdir()} - {"bin"}
    assert {name for name in names if not name.endswith(".dist-info")} == {"irrsplat"}


@pytest.mark.parametrize(("folder", "inside"), [("irrsplat", ""), ("app", "app"), ("shaders", "shaders"), ("scenes", "scenes")])
def test_every_module_shader_and_scene_is_in_the_wheel(installed: Path, folder: str, inside: str) -> None:
    files = {path.relative_to(ROOT / folder) for path in (ROOT / folder).rglob("*") if path.is_file()}
    requested = {path for path in files if "__pycache__" not in path.parts and not path.name.startswith(".")}
    assert len(requested) > 5
    missing = {str(path) for path in requested if not (installed / "irrsplat" / inside / path).is_file()}
    assert not missing, f"setup.py does not package these: {missing}"
    assert (installed / "irrsplat" / "py.typed").is_file(), "without it, type checkers ignore the annotations"


def test_it_runs_from_anywhere(installed: Path, tmp_path: Path) -> None:
    where = run(
        sys.executable, "-c", "import irrsplat.app; print(irrsplat.__file__, irrsplat.app.__file__)", PYTHONPATH=str(installed)
    )
    assert all(path.startswith(str(installed)) for path in where.split())
    command = (sys.executable, "-m", "irrsplat")
    assert "cornell" in run(*command, "info", PYTHONPATH=str(installed))
    output = tmp_path / "a.png"
    options = ("--size", "16", "16", "--gather-size", "8", "-o", str(output))
    assert run(*command, "render", "furnace", *options, PYTHONPATH=str(installed)) == ""
    assert output.is_file()
