"""Does irrsplat install: wheel and sdist, pipx and uvx, every extra alone, wheels for other systems, and what would hinder those.

    python tests/trust/supply/distribution.py build       wheel and sdist, and the sdist's wheel; `twine check --strict` on all
    python tests/trust/supply/distribution.py run         pipx run and uvx, from the wheel, in fresh ones: --version, a render
    python tests/trust/supply/distribution.py extras      each extra in a fresh environment, with something that needs it
    python tests/trust/supply/distribution.py systems     are there wheels of all that is needed for Windows and macOS
    python tests/trust/supply/distribution.py assumptions in the code: paths, X11, OpenGL beyond 4.1 core

Without a word, all of them. A name of an extra after `extras` tries that one alone. The packages build, twine, pipx and uv are
needed. Exit status: 0 if all is well.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SMALL = ("--size", "32", "32", "--gather-size", "8")
NEEDS = {  # extra: Python that fails without it
    "bake": "import xatlas",
    "cluster": "import distributed",
    "dev": "import pytest, mypy, hypothesis",
    "docs": "import mkdocs, material, mkdocstrings_handlers.python, latex2mathml.converter",
    "embree": "import embreex.rtcore_scene",
    "gltf": "import DracoPy, meshopt, alktx2",
    "peers": "import pyradiance, mitsuba",
    "reference": "import mitsuba, irrsplat.reference.path_tracer",
    "video": "import av",
}
SYSTEMS = {  # of pip download: what a user of each has
    "Windows": ("win_amd64",),
    "macOS, Apple silicon": ("macosx_11_0_arm64", "macosx_12_0_arm64", "macosx_13_0_arm64", "macosx_14_0_arm64"),
    "macOS, Intel": ("macosx_10_15_x86_64", "macosx_11_0_x86_64", "macosx_12_0_x86_64", "macosx_13_0_x86_64"),
}
PYTHONS = ("3.11", "3.12", "3.13")
SOURCE_ONLY = ("glcontext",)  # has no wheel for some of these systems; told, and not counted, where it can be built
GUARDED = ("irrsplat/core/files.py", "irrsplat/lighting/memory.py", "app/bench/machine.py")  # they do without
# What would not work elsewhere, in code that is installed: a pattern, what it is, and the files in which it is meant.
ASSUMPTIONS = (
    (r"[\"'](?:/tmp|/usr|/home|/var|/proc|/etc)\b", "a path of Unix", GUARDED),
    (r"\bos\.(?:fork|getuid|setuid|mkfifo|sysconf)\b", "a call that Windows lacks", ()),
    (r"^\s*(?:import|from) (?:fcntl|resource|pwd|termios)\b", "a module that Windows lacks", GUARDED),
    (r"\bsignal\.(?:SIGHUP|SIGKILL|SIGUSR\d)\b", "a signal that Windows lacks", ()),
    (r"\b(?:Xlib|xcb|glfw\.get_x11|DISPLAY)\b", "X11", ()),
)
BEYOND = re.compile(  # of GLSL and OpenGL 4.1 core: compute, images, storage buffers, textures by layout
    r"#version (?!330\b)\d+|\blayout\s*\(\s*(?:binding|local_size|std430)|\b(?:imageLoad|imageStore|atomicAdd)\b"
)


def run(*words: str | Path, cwd: Path = ROOT, **environment: str) -> str:
    """What a command prints; RuntimeError with all of it where it fails."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("PIP_CONSTRAINT", "PYTHONPATH"))}
    done = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=clean | environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, words))}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


def source(folder: Path) -> Path:
    """A copy of what git has, for builds, which write beside what they build."""
    target = folder / "source"
    target.mkdir()
    names = run("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard").split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    return target


def built(folder: Path) -> tuple[Path, Path]:
    """The wheel and the sdist; the wheel is made from the sdist, as package indices do."""
    run(sys.executable, "-m", "build", "--outdir", folder / "dist", source(folder))
    (wheel,), (sdist,) = (folder / "dist").glob("*.whl"), (folder / "dist").glob("*.tar.gz")
    return wheel, sdist


def build(folder: Path) -> Iterator[str]:
    """Wheel and sdist, as an index would take them."""
    wheel, sdist = built(folder)
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, sdist)
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    strays = {name.split("/")[0] for name in names} - {"irrsplat", f"irrsplat-{PROJECT['version']}.dist-info"}
    if strays:
        raise RuntimeError(f"the wheel has {', '.join(sorted(strays))} as well")
    yield f"{wheel.name} ({wheel.stat().st_size >> 10} KiB, {len(names)} files) and {sdist.name}: twine check --strict passes"


def run_anywhere(folder: Path) -> Iterator[str]:
    """pipx and uvx, each with caches and environments of its own, from another folder."""
    wheel, _ = built(folder)
    home, picture = folder / "home", folder / "furnace.png"
    home.mkdir()
    starts: dict[str, Sequence[str | Path]] = {
        "pipx run": (sys.executable, "-m", "pipx", "run", "--spec", wheel, "irrsplat"),
        "uvx": (sys.executable, "-m", "uv", "tool", "run", "--from", wheel, "irrsplat"),
    }
    for name, words in starts.items():
        places = {
            "HOME": str(home),
            "PIPX_HOME": str(home / "pipx"),
            "UV_CACHE_DIR": str(home / "uv"),
            "XDG_CACHE_HOME": str(home),
        }
        told = run(*words, "--version", cwd=folder, **places).strip()
        if told != f"irrsplat {PROJECT['version']}":
            raise RuntimeError(f"{name}: --version says {told}")
        run(*words, "render", "furnace", *SMALL, "-o", picture, cwd=folder, **places)
        size = picture.stat().st_size
        picture.unlink()
        run(*words, "desktop", "install", cwd=folder, XDG_DATA_HOME=str(home / name), **places)
        (entry,) = (home / name).rglob("*.desktop")
        if shutil.which("desktop-file-validate"):
            run("desktop-file-validate", entry)
        yield f"{name}: {told}, a picture of {size} bytes, and an entry of the desktop"


def extras(folder: Path, only: Sequence[str] = ()) -> Iterator[str]:
    """Each extra in an environment of its own; `all` has what the others of users have."""
    wheel, _ = built(folder)
    offered = PROJECT["optional-dependencies"]
    for extra in only or sorted(offered):
        place = folder / extra
        run(sys.executable, "-m", "venv", place)
        run(place / "bin/pip", "install", "--quiet", "--no-compile", f"{wheel}[{extra}]")
        tried = [NEEDS[extra]] if extra != "all" else [NEEDS[one] for one in in_all()]
        for code in tried:
            run(place / "bin/python", "-c", code, cwd=folder)
        run(place / "bin/irrsplat", "render", "furnace", *SMALL, "-o", folder / f"{extra}.png", cwd=folder)
        yield f"irrsplat[{extra}]: {'; '.join(tried)}; renders"
        shutil.rmtree(place)


def in_all() -> list[str]:
    """The extras that `all` names."""
    (text,) = PROJECT["optional-dependencies"]["all"]
    found = re.fullmatch(r"irrsplat\[([\w,]+)\]", text)
    assert found is not None, text
    return found[1].split(",")


def systems(folder: Path) -> Iterator[str]:
    """Whether pip finds wheels of all dependencies for other systems; what has none is told by name."""
    missing: list[str] = []
    for system, tags in SYSTEMS.items():
        for python in PYTHONS:
            needed = wanted(system, python)
            together = has_wheels(needed, tags, python, folder)
            lacking = [] if together else [one for one in needed if not has_wheels([one], tags, python, folder)]
            missing += [f"{one} ({system}, {python})" for one in lacking if one not in SOURCE_ONLY]
            yield f"{system}, Python {python}: {'no wheel of ' + ', '.join(lacking) if lacking else 'wheels of everything'}"
    if missing:
        raise RuntimeError(f"no wheels: {', '.join(missing)}")


def wanted(system: str, python: str) -> list[str]:
    """The requirements of irrsplat itself and of the extra gltf on a system, without markers."""
    from packaging.requirements import Requirement

    platform = {"Windows": ("win32", "AMD64"), "macOS, Intel": ("darwin", "x86_64")}.get(system, ("darwin", "arm64"))
    values = {"python_version": python, "sys_platform": platform[0], "platform_machine": platform[1]}
    found = [Requirement(one) for one in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["gltf"])]
    chosen = [one for one in found if one.marker is None or one.marker.evaluate(values)]
    return [f"{one.name}{'[' + ','.join(one.extras) + ']' if one.extras else ''}{one.specifier}" for one in chosen]


def has_wheels(requirements: Sequence[str], tags: Sequence[str], python: str, folder: Path) -> bool:
    """Whether pip can resolve requirements, and all that they need in turn, by wheels alone."""
    words = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--ignore-installed", "--only-binary=:all:"]
    words += ["--target", str(folder / "none"), "--python-version", python, "--implementation", "cp"]
    words += [word for tag in tags for word in ("--platform", tag)]
    try:
        run(*words, *requirements)
    except RuntimeError as error:
        if "No matching distribution" not in str(error) and "Could not find a version" not in str(error):
            raise
        return False
    return True


def assumptions(folder: Path | None = None) -> Iterator[str]:
    """What the installed code takes for granted of a system, by patterns; each is to be met where it is meant alone."""
    found = []
    for path in sorted((*(ROOT / "irrsplat").rglob("*.py"), *(ROOT / "app").rglob("*.py"))):
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        for pattern, words, meant in ASSUMPTIONS:
            for match in re.finditer(pattern, text, re.M):
                if not name.startswith(meant or ("-",)):
                    found.append(f"{name}:{text.count(chr(10), 0, match.start()) + 1}: {words}: {match[0].strip()}")
    shaders = [path for path in (ROOT / "shaders").rglob("*") if path.suffix in (".vert", ".frag", ".geom", ".glsl")]
    for path in shaders:
        text = re.sub(r"//.*", "", path.read_text(encoding="utf-8"))
        found += [f"{path.relative_to(ROOT).as_posix()}: beyond OpenGL 4.1: {match[0]}" for match in BEYOND.finditer(text)]
    if any(path.suffix == ".comp" for path in (ROOT / "shaders").rglob("*")):
        found.append("shaders/: there are compute shaders")
    if found:
        raise RuntimeError("\n".join(found))
    yield f"{len(shaders)} shaders keep to GLSL 330; no path, module, signal or display of one system beyond where it is meant"


PARTS: dict[str, Callable[[Path], Iterator[str]]] = {
    "build": build,
    "run": run_anywhere,
    "extras": extras,
    "systems": systems,
    "assumptions": assumptions,
}


def main(arguments: Sequence[str]) -> int:
    """Run the command line; the exit status."""
    if arguments and arguments[0] not in PARTS:
        print(__doc__, file=sys.stderr)
        return 2
    status = 0
    for name in arguments[:1] or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            try:
                lines = extras(Path(folder), arguments[1:]) if name == "extras" else PARTS[name](Path(folder))
                for line in lines:
                    print(f"{name}: {line}", flush=True)
            except RuntimeError as error:
                print(f"{name}: FAILED: {error}", flush=True)
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
