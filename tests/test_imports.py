"""The floors of the house: a module imports only from floors below its own, and a pass never another pass."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import irrsplat

ROOT = Path(__file__).resolve().parent.parent

# top floor first; a name stands for itself and all that lies in it
FLOORS = (
    ("irrsplat.__main__",),
    ("irrsplat.app",),
    ("irrsplat",),  # the package's own front door, which hands out what lies below
    ("irrsplat.renderer",),
    ("irrsplat.renderer",),
    ("irrsplat.records.cache_file",),
    ("irrsplat.indirect.scheduler", "irrsplat.indirect.splat_buffer", "irrsplat.lighting.gl_limits", "irrsplat.image.antialias"),
    (
        "irrsplat.surface_cache.cache",
        "irrsplat.gather.autotune",
        "irrsplat.records.refresh_order",
        "irrsplat.indirect.change_probe",
    ),
    ("irrsplat.reference",),
    ("irrsplat.reference.fine_gather",),
    (
        "irrsplat.indirect.paper_scan",
        "irrsplat.image.figures.figure1",
        "irrsplat.records.eviction",
        "irrsplat.records.adaptive_radius",
    ),
    ("irrsplat.image.figures.cutaway", "irrsplat.image.view", "irrsplat.records.culling"),
    ("irrsplat.passes", "irrsplat.image.frame"),
    (
        "irrsplat.records.record_cache",
        "irrsplat.lighting.light_table",
        "irrsplat.records.weight",
        "irrsplat.surface_cache.lookup_table",
        "irrsplat.gpu.time_budget",
    ),
    ("irrsplat.scene", "irrsplat.gpu"),
    ("irrsplat.image.tonemap", "irrsplat.image.figures.pen", "irrsplat.records.point_grid", "irrsplat.scene.meshlets"),
    (
        "irrsplat.gather.hemicube",
        "irrsplat.gather.stratified",
        "irrsplat.gather.record_frame",
        "irrsplat.surface_cache.transport",
    ),
    ("irrsplat.core.buffers",),
    ("irrsplat.settings",),
    ("irrsplat.core.errors", "irrsplat.core.paths", "irrsplat.scenes"),
)
OPENGL = ("moderngl", "glcontext", "OpenGL")
WINDOWS = ("imgui_bundle", "imgui", "moderngl_window", "glfw", "pyglet")


def sources() -> Iterator[tuple[str, Path]]:
    """Every module of the distribution by its installed name."""
    for folder, package in ((ROOT / "irrsplat", "irrsplat"), (ROOT / "app", "irrsplat.app")):
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            yield ".".join((package, *(p for p in parts if p != "__init__"))), path


MODULES = dict(sources())


def imports(name: str, path: Path) -> Iterator[str]:
    """The modules that `name` imports, anywhere in it, `from package import module` resolved."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import; write the whole name"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in MODULES else str(node.module)


def floor(name: str) -> int:
    """The number of the floor that `name` lies on, the longest match first; the top floor is 0."""
    found = [
        (len(entry), i)
        for i, entries in enumerate(FLOORS)
        for entry in entries
        if name == entry or (entry != "irrsplat" and name.startswith(entry + "."))
    ]
    assert found, f"{name} lies on no floor; add it to FLOORS"
    return max(found)[1]


def room(name: str) -> str:
    """The subpackage, or the module itself, that `name` belongs to."""
    return ".".join(name.split(".")[:2])


@pytest.mark.parametrize("name", MODULES)
def test_imports_run_down_only(name: str) -> None:
    for imported in imports(name, MODULES[name]):
        if imported.split(".")[0] in ("app", "shaders", "scenes", "tests"):
            pytest.fail(f"{name} imports {imported}: write irrsplat.{imported}")
        if imported.split(".")[0] == "irrsplat" and room(imported) != room(name):
            assert floor(name) < floor(imported), f"{name} imports {imported}, which is not below it"


@pytest.mark.parametrize("name", [n for n in MODULES if n.startswith("irrsplat.passes.")])
def test_a_pass_never_imports_a_pass(name: str) -> None:
    assert not [i for i in imports(name, MODULES[name]) if i.startswith("irrsplat.passes")]


@pytest.mark.parametrize("name", MODULES)
def test_who_may_know_opengl_and_windows(name: str) -> None:
    roots = {imported.split(".")[0] for imported in imports(name, MODULES[name])}
    if room(name) in (
        "irrsplat.scene",
        "irrsplat.image.frame",
        "irrsplat.settings",
        "irrsplat.core.buffers",
        "irrsplat.image.tonemap",
    ):
        assert not roots & set(OPENGL)
    if room(name) != "irrsplat.app":
        assert not roots & set(WINDOWS)


@pytest.mark.parametrize("name", MODULES)
def test_each_file_opens_with_a_sentence_and_fits_three_screens(name: str) -> None:
    text = MODULES[name].read_text(encoding="utf-8")
    if text.strip():
        assert ast.get_docstring(ast.parse(text)), f"{name} does not say what it is"
    assert text.count("\n") < 350, f"{name} is long; look for the second idea in it"


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
