"""What all tests share: one OpenGL context, a watch over OpenGL errors, and a stand-in for the renderer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import CHANNELS
from irrsplat.gather import autotune
from irrsplat.gpu import context
from irrsplat.image.frame import Frame
from irrsplat.scene import Scene, load
from tests.support.viewing import Driver, fresh, viewing, write_room

PLAIN = """cam 0 0 5 0 0 0 0 1 0
proj 40 1 0.1 100
sky 1 1 1
obj triangle.obj
"""
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture(scope="session", autouse=True)
def race(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., autotune.Times]]:
    """What times both gathers; in its place nothing is timed: rasters win up to 100 triangles. The cache folder is a new one."""
    real = autotune.race
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IRRSPLAT_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(autotune, "race", lambda ctx, scene, side: (1.0, 2.0) if scene.triangles <= 100 else (2.0, 1.0))
        yield real


@pytest.fixture
def ctx() -> Iterator[moderngl.Context]:
    """The session's OpenGL context, made current for this test (a Renderer of an earlier test may have left another current)."""
    shared = context.shared()
    with shared:
        yield shared


@pytest.fixture(autouse=True)
def no_gl_errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fails the test that left an OpenGL error in any context that it used: the shared one, or one that it made itself."""
    contexts: list[moderngl.Context] = [context.shared()] if context.shared.cache_info().currsize else []
    for one in contexts:
        with one:
            one.clear_errors()
    found: list[str] = []
    create, release = context.create, moderngl.Context.release

    def watched_create(require: int = context.REQUIRED) -> moderngl.Context:
        made = create(require)
        contexts.append(made)
        return made

    def watched_release(self: moderngl.Context) -> None:
        look(self)
        release(self)

    def look(one: moderngl.Context) -> None:
        if not isinstance(one.mglo, moderngl.InvalidObject):  # not released already
            with one:
                found.append(one.error)

    monkeypatch.setattr(context, "create", watched_create)
    monkeypatch.setattr(moderngl.Context, "release", watched_release)
    yield
    for one in contexts:
        look(one)
    assert set(found) <= {"GL_NO_ERROR"}, f"this test left OpenGL errors: {found}"


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    """A viewer of a small room, shared by the tests of a module."""
    with viewing(write_room(tmp_path_factory.mktemp("room"))) as made:
        yield made


@pytest.fixture
def driver(one: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """The same as at first, at rest; it remembers and writes in `tmp_path`."""
    yield from fresh(one, tmp_path, monkeypatch)


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
            progress(SimpleNamespace(round=1, records=3, new=3, coverage=0.5, sampled=0.0))
        width, height = self.asked.size
        arrays = {n: np.ones((height, width, 3) if c.components == 3 else (height, width), "f4") for n, c in CHANNELS.items()}
        records = {f.name: np.ones((1, 3), "f4") for f in fields(Frame) if f.name.startswith("records_")}
        return Frame(**arrays, **records, stats={"rounds": 1, "records": 1, "converged": True, "exposure": 0.0} | self.stats)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> type[FakeRenderer]:
    """Puts FakeRenderer in the place of the real one; `fake.asked` is what it was asked, `fake.stats` what it adds to its own."""
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
def write(tmp_path: Path) -> Callable[..., Scene]:
    """Writes files beside each other and loads the first of them."""

    def write(text: str | bytes, name: str = "a.scene", **files: str) -> Scene:
        (tmp_path / "t.obj").write_text(TRIANGLE)
        for stem, content in files.items():
            (tmp_path / stem.replace("_", ".")).write_text(content)
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load(path)

    return write
