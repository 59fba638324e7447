"""Installation of irrsplat: wheel and sdist, pipx and uvx, every extra alone, and wheels for other systems.

IRRSPLAT_NET=1: also run the long tests, which need the net and the packages build, twine, pipx and uv.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import irrsplat

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OFFERED: dict[str, list[str]] = PROJECT["optional-dependencies"]
IN_ALL = OFFERED["all"][0].removeprefix("irrsplat[").removesuffix("]").split(",")
SMALL = ("--size", "32", "32", "--gather-size", "8")
NEEDS = {  # extra: Python that fails without it
    "bake": "import xatlas",
    "dev": "import pytest, mypy, hypothesis",
    "docs": "import mkdocs, material, mkdocstrings_handlers.python, latex2mathml.converter",
    "embree": "import embreex.rtcore_scene",
    "gltf": "import DracoPy, meshopt, alktx2",
    "peers": "import matplotlib, pyradiance, mitsuba, pyoidn",
    "reference": "import mitsuba, irrsplat.reference.path_tracer",
    "video": "import av",
}
WINDOWS = ("win32", "AMD64", ("win_amd64",))  # requirement markers, and the tags of its wheels
MAC = ("darwin", "arm64", tuple(f"macosx_{version}_0_arm64" for version in (11, 12, 13, 14)))
GUARDED = ("irrsplat/core/files.py", "irrsplat/renderer/memory.py", "app/viewer/ui/imgui_backend.py")  # files with fallbacks
# Assumptions that fail on other systems, in installed code: a pattern, a description, and the files with a fallback.
ASSUMPTIONS = (
    (r"[\"'](?:/tmp|/usr|/home|/var|/proc|/etc)\b", "a path of Unix", GUARDED),
    (r"\bos\.(?:fork|getuid|setuid|mkfifo|sysconf)\b", "a call that Windows lacks", ()),
    (r"^\s*(?:import|from) (?:fcntl|resource|pwd|termios)\b", "a module that Windows lacks", GUARDED),
    (r"\bsignal\.(?:SIGHUP|SIGKILL|SIGUSR\d)\b", "a signal that Windows lacks", ()),
    (r"\b(?:Xlib|xcb|glfw\.get_x11|DISPLAY)\b", "X11", ()),
)
BEYOND = re.compile(  # beyond GLSL and OpenGL 4.1 core: compute, images, storage buffers, textures by layout
    r"#version (?!330\b)\d+|\blayout\s*\(\s*(?:binding|local_size|std430)|\b(?:imageLoad|imageStore|atomicAdd)\b"
)


def net(test: object) -> object:
    """Mark a test that needs the net."""
    return pytest.mark.long(pytest.mark.skipif("IRRSPLAT_NET" not in os.environ, reason="needs IRRSPLAT_NET=1")(test))


def run(*words: str | Path, cwd: Path = ROOT, **environment: str) -> str:
    """Return a command's output; fail with all of it if the command fails."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("PIP_CONSTRAINT", "PYTHONPATH"))}
    command = [str(word) for word in words]
    done = subprocess.run(command, cwd=cwd, env=clean | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel, made from the sdist of a clone, as for package indices."""
    pytest.importorskip("build.__main__", reason="needs: pip install build twine pipx uv")
    folder = tmp_path_factory.mktemp("dist")
    run("git", "clone", "--quiet", ROOT, folder / "source")
    run(sys.executable, "-m", "build", "--outdir", folder, folder / "source")
    (found,) = folder.glob("*.whl")
    return found


@net
def test_wheel_and_sdist_pass_the_checks_of_an_index(wheel: Path) -> None:
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, *wheel.parent.glob("*.tar.gz"))
    with zipfile.ZipFile(wheel) as archive:
        names = {name.split("/")[0] for name in archive.namelist()}
    assert names == {"irrsplat", f"irrsplat-{PROJECT['version']}.dist-info"}


@net
@pytest.mark.parametrize("tool", ["pipx run --spec", "uv tool run --from"])
def test_the_program_runs_by_pipx_and_uvx(tool: str, wheel: Path, tmp_path: Path) -> None:
    """The tools use new caches and environments in another folder."""
    words = (sys.executable, "-m", *tool.split(), str(wheel), "irrsplat")
    (place := tmp_path / "work").mkdir()
    home = {name: str(tmp_path / name) for name in ("HOME", "PIPX_HOME", "UV_CACHE_DIR", "XDG_CACHE_HOME", "XDG_DATA_HOME")}
    assert run(*words, "--version", cwd=place, **home).strip() == f"irrsplat {PROJECT['version']}"
    run(*words, "render", "furnace", *SMALL, "-o", "furnace.png", cwd=place, **home)


@net
@pytest.mark.parametrize("extra", sorted(OFFERED))
def test_each_extra_installs_alone(extra: str, wheel: Path, tmp_path: Path) -> None:
    """Each extra is installed in a new environment; `all` has the users' extras."""
    run(sys.executable, "-m", "venv", tmp_path)
    run(tmp_path / "bin/pip", "install", "--quiet", "--no-compile", f"{wheel}[{extra}]")
    for one in IN_ALL if extra == "all" else [extra]:
        run(tmp_path / "bin/python", "-c", NEEDS[one], cwd=tmp_path)
    run(tmp_path / "bin/irrsplat", "render", "furnace", *SMALL, "-o", "furnace.png", cwd=tmp_path)
    shutil.rmtree(tmp_path)


@net
@pytest.mark.parametrize(("system", "python"), [*((WINDOWS, f"3.{i}") for i in (11, 12, 13)), (MAC, "3.11"), (MAC, "3.12")])
def test_there_are_wheels_for_other_systems(system: tuple[str, str, tuple[str, ...]], python: str, tmp_path: Path) -> None:
    """All direct and indirect requirements of irrsplat and its extra gltf have wheels."""
    from packaging.requirements import Requirement

    platform, machine, tags = system
    values = {"python_version": python, "sys_platform": platform, "platform_machine": machine}
    needed = [Requirement(one) for one in (*PROJECT["dependencies"], *OFFERED["gltf"])]
    chosen = [str(one).partition(";")[0] for one in needed if one.marker is None or one.marker.evaluate(values)]
    words = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--ignore-installed", "--only-binary=:all:"]
    words += ["--target", str(tmp_path), "--python-version", python, "--implementation", "cp"]
    run(*words, *(word for tag in tags for word in ("--platform", tag)), *chosen)


def test_system_specific_code_has_a_fallback() -> None:
    """Patterns of system-specific code occur only in files with a fallback."""
    found = []
    for path in (*(ROOT / "irrsplat").rglob("*.py"), *(ROOT / "app").rglob("*.py")):
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        for pattern, words, meant in ASSUMPTIONS:
            if name not in meant:
                found += [f"{name}: {words}: {match[0].strip()}" for match in re.finditer(pattern, text, re.M)]
    shaders = [path for path in (ROOT / "shaders").rglob("*") if path.suffix in (".vert", ".frag", ".geom", ".glsl", ".comp")]
    for path in shaders:
        text = re.sub(r"//.*", "", path.read_text(encoding="utf-8"))
        found += [f"{path.relative_to(ROOT).as_posix()}: beyond OpenGL 4.1: {match[0]}" for match in BEYOND.finditer(text)]
    assert found == [] and len(shaders) > 50


def test_every_extra_has_a_test_and_all_has_those_of_users() -> None:
    assert set(OFFERED) - {"all"} <= set(NEEDS)
    assert set(IN_ALL) == set(OFFERED) - {"all", "dev", "docs", "embree"}


def test_the_version_is_unique_and_in_the_changelog() -> None:
    version = PROJECT["version"]
    assert irrsplat.__version__ == version
    assert re.search(rf"^version: {re.escape(version)}$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    log = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"^## (\d+\.\d+\.\d+) - (\d{4}-\d\d-\d\d)$", log, re.M)
    assert released[0][0] == version
    numbers = [tuple(map(int, one.split("."))) for one, _ in released]
    days = [day for _, day in released]
    assert numbers == sorted(numbers, reverse=True) and days == sorted(days, reverse=True)
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}  # from Keep a Changelog
    assert set(re.findall(r"^### (.*)$", log, re.M)) <= kinds
    assert set(re.findall(r"^## (.*)$", log, re.M)) <= {"Unreleased", *(f"{one} - {day}" for one, day in released)}
