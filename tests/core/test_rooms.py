"""The house: imports run downward between rooms, every folder is small enough to read at a glance, and who may know OpenGL."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import irrsplat

ROOT = Path(__file__).resolve().parents[2]

# The rooms, top first: a module imports only from rooms below its own, or from its own room.
ROOMS = (
    "irrsplat.__main__",
    "irrsplat.app",
    "irrsplat",  # the package's front door, which hands out what lies below
    "irrsplat.renderer",
    "irrsplat.reference",
    "irrsplat.image",
    "irrsplat.meter",
    "irrsplat.indirect",
    "irrsplat.surface_cache",
    "irrsplat.gather",
    "irrsplat.records",
    "irrsplat.lighting",
    "irrsplat.gpu",
    "irrsplat.scene",
    "irrsplat.sky",
    "irrsplat.settings",
    "irrsplat.core",
)
APP_ROOMS = (
    "irrsplat.app.cli",
    "irrsplat.app.grammar",
    "irrsplat.app.commands",
    "irrsplat.app.commands.work",
    "irrsplat.app.commands.shared",
    "irrsplat.app.farm",
    "irrsplat.app.bake",
    "irrsplat.app.bench",
    "irrsplat.app.film",
    "irrsplat.app.viewer",
    "irrsplat.app.verify",
    "irrsplat.app.common",
    "irrsplat.app",
)
MOST_ENTRIES = 14  # of a folder, its package markers not counted
MARKERS = {"__init__.py", "__main__.py", "__pycache__", "py.typed", "conftest.py", ".DS_Store"}
WITHOUT_OPENGL = ("irrsplat.core", "irrsplat.settings", "irrsplat.scene", "irrsplat.sky")
OPENGL = ("moderngl", "glcontext", "OpenGL")
WINDOWS = ("imgui_bundle", "imgui", "moderngl_window", "glfw", "pyglet")


def sources() -> Iterator[tuple[str, Path]]:
    """Every module of the distribution by its installed name."""
    for folder, package in ((ROOT / "irrsplat", "irrsplat"), (ROOT / "app", "irrsplat.app")):
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            yield ".".join((package, *(p for p in parts if p != "__init__"))), path


MODULES = dict(sources())


def imports(name: str, path: Path, for_types: bool = True) -> Iterator[str]:
    """The modules that `name` imports, anywhere in it, `from package import module` resolved; for_types: also those that only
    annotations need, under `if TYPE_CHECKING`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    if not for_types:
        tree.body = [node for node in tree.body if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import; write the whole name"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in MODULES else str(node.module)


def room(name: str, rooms: tuple[str, ...]) -> int:
    """The number of the room that module `name` lies in, the longest match first; the top room is 0."""
    found = [
        (len(entry), i)
        for i, entry in enumerate(rooms)
        if name == entry
        or (
            (entry not in ("irrsplat", "irrsplat.app") or (rooms is ROOMS and entry == "irrsplat.app"))
            and name.startswith(entry + ".")
        )
    ]
    assert found, f"{name} lies in no room; add it to ROOMS"
    return max(found)[1]


@pytest.mark.parametrize("name", MODULES)
def test_imports_run_downward_between_rooms(name: str) -> None:
    for imported in imports(name, MODULES[name]):
        if imported.split(".")[0] in ("app", "shaders", "scenes", "tests"):
            pytest.fail(f"{name} imports {imported}: write irrsplat.{imported}")
        if imported in MODULES:
            assert room(name, ROOMS) <= room(imported, ROOMS), f"{name} imports {imported}, which lies above it"
            if name.startswith("irrsplat.app.") and imported.startswith("irrsplat.app."):
                assert room(name, APP_ROOMS) <= room(imported, APP_ROOMS), f"{name} imports {imported}, which lies above it"


def folders() -> Iterator[Path]:
    """Every folder of the source, the shaders, the tests and the documents."""
    for top in ("irrsplat", "app", "shaders", "tests", "docs", "scenes"):
        yield ROOT / top
        yield from (path for path in (ROOT / top).rglob("*") if path.is_dir() and path.name not in MARKERS)


@pytest.mark.parametrize("folder", [str(path.relative_to(ROOT)) for path in folders()])
def test_a_folder_has_few_entries(folder: str) -> None:
    entries = sorted(path.name for path in (ROOT / folder).iterdir() if path.name not in MARKERS)
    assert len(entries) <= MOST_ENTRIES, f"{folder} has {len(entries)}: give some of them a room of their own"


@pytest.mark.parametrize("name", MODULES)
def test_who_may_know_opengl_and_windows(name: str) -> None:
    roots = {imported.split(".")[0] for imported in imports(name, MODULES[name], for_types=False)}
    if name.startswith(WITHOUT_OPENGL):
        assert not roots & set(OPENGL)
    if not name.startswith("irrsplat.app"):
        assert not roots & set(WINDOWS)


@pytest.mark.parametrize("name", MODULES)
def test_each_file_opens_with_a_sentence(name: str) -> None:
    text = MODULES[name].read_text(encoding="utf-8")
    if text.strip():
        assert ast.get_docstring(ast.parse(text)), f"{name} does not say what it is"


@pytest.mark.parametrize(
    "command",
    [
        "import irrsplat.scene; irrsplat.load('cornell'); irrsplat.InputError",
        "import irrsplat; dir(irrsplat)",
    ],
)
def test_a_scene_is_read_without_opengl(command: str) -> None:
    loaded = "import sys; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", f"{command}; {loaded}"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {*OPENGL, *WINDOWS, "trimesh", "OpenEXR"}


def test_every_public_name_is_there() -> None:
    assert set(irrsplat.__all__) <= set(dir(irrsplat))
    for name in irrsplat.__all__:
        assert getattr(irrsplat, name).__name__ == name
        assert getattr(irrsplat, name).__module__.startswith("irrsplat.")
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = irrsplat.nonsense
