"""The folders: imports run downward without circles, every folder is small, and few modules use OpenGL."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
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
    "irrsplat.app.commands.shared",
    "irrsplat.app.bake",
    "irrsplat.app.bench",
    "irrsplat.app.viewer",
    "irrsplat.app.film",
    "irrsplat.app.work",
    "irrsplat.app.common",
    "irrsplat.app",
)
MOST_ENTRIES = 14  # of a folder, its package markers not counted
MARKERS = {"__init__.py", "__main__.py", "__pycache__", "py.typed", "conftest.py", ".DS_Store", "failures"}
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


@cache
def parsed(name: str) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(MODULES[name].read_text(encoding="utf-8"))


def statements(body: Sequence[ast.AST], for_types: bool) -> Iterator[ast.AST]:
    """Each statement, with those inside it; without `for_types`, none under `if TYPE_CHECKING`."""
    for node in body:
        yield node
        if for_types or not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            for block in ("body", "handlers", "orelse", "finalbody", "cases"):
                yield from statements(getattr(node, block, ()), for_types)


def imports(name: str, for_types: bool = True) -> Iterator[str]:
    """The modules that `name` imports, anywhere in it, `from package import module` resolved; for_types: also those that only
    annotations need, under `if TYPE_CHECKING`."""
    for node in statements(parsed(name).body, for_types):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import; write the whole name"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in MODULES else str(node.module)


@cache
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


def above(name: str, imported: str) -> bool:
    """Return True if the module `imported` lies above `name`, which may not import it."""
    inside = name.startswith("irrsplat.app.") and imported.startswith("irrsplat.app.")
    return any(room(name, rooms) > room(imported, rooms) for rooms in (ROOMS, *([APP_ROOMS] if inside else [])))


def test_imports_run_downward_between_rooms() -> None:
    found = [(name, imported) for name in MODULES for imported in imports(name)]
    outside = ("app", "shaders", "scenes", "tests")
    assert not [f"{name}: irrsplat.{imported}" for name, imported in found if imported.split(".")[0] in outside], "the whole name"
    upward = [f"{name} imports {imported}" for name, imported in found if imported in MODULES and above(name, imported)]
    assert len(found) > 1000 and not upward, "which lies above it"


def test_no_two_modules_import_each_other() -> None:
    found = {(name, imported) for name in MODULES if not name.startswith("irrsplat.app.") for imported in imports(name)}
    assert not [pair for pair in found if pair[0] < pair[1] and pair[::-1] in found]


def folders() -> Iterator[Path]:
    """Every folder of the source, the shaders, the tests and the documents."""
    for top in ("irrsplat", "app", "shaders", "tests", "docs", "scenes"):
        yield ROOT / top
        yield from (path for path in (ROOT / top).rglob("*") if path.is_dir() and path.name not in MARKERS)


def test_a_folder_has_few_entries() -> None:
    entries = {folder: [path for path in folder.iterdir() if path.name not in MARKERS] for folder in folders()}
    full = [f"{folder.relative_to(ROOT)}: {len(found)}" for folder, found in entries.items() if len(found) > MOST_ENTRIES]
    assert len(entries) > 50 and not full, "give some of them a room of their own"


def test_who_may_know_opengl_and_windows() -> None:
    roots = {name: {imported.split(".")[0] for imported in imports(name, for_types=False)} for name in MODULES}
    assert not [name for name in MODULES if name.startswith(WITHOUT_OPENGL) and roots[name] & set(OPENGL)]
    assert not [name for name in MODULES if not name.startswith("irrsplat.app") and roots[name] & set(WINDOWS)]
    assert "moderngl" in roots["irrsplat.gpu.context"] and "imgui_bundle" in roots["irrsplat.app.viewer.ui.imgui_backend"]


def test_each_file_opens_with_a_sentence() -> None:
    assert not [name for name in MODULES if parsed(name).body and not ast.get_docstring(parsed(name))]


def test_a_scene_is_read_without_opengl() -> None:
    command = "import irrsplat; dir(irrsplat); irrsplat.load('cornell'); irrsplat.InputError"
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
