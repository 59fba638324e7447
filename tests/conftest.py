"""Fixtures of all tests: one OpenGL context, a check for OpenGL errors after each test, and a viewer to drive."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

# Threads of OpenBLAS wait by turning round and round, on the cores that the other test processes need. Read when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Freed memory stays with the process: to get it anew for each texture and array takes a tenth of the tests' time. Read when a
# process starts, as test processes do after this.
os.environ.setdefault("MALLOC_MMAP_THRESHOLD_", str(1 << 30))
os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", str(1 << 31))
os.environ.setdefault("MALLOC_TOP_PAD_", str(1 << 24))

import moderngl
import pytest

from irrsplat.core.timing.clock import use_clock
from irrsplat.gpu import context
from irrsplat.surface_cache import site_layout, site_rays
from tests.support.counted_clock import CountedClock
from tests.support.crashes import pytest_configure, pytest_handlecrashitem  # noqa: F401  hooks
from tests.support.viewing import Driver, fresh, viewing, write_room

# Of several test processes each has llvmpipe, the software renderer, draw in the thread that calls it; it reads this when OpenGL
# starts. With threads of its own, even one, Mesa 22.3 may free a fence that one of them is still unlocking: a few bytes of freed
# memory become 0, and in one of some ten whole runs malloc ended a process for it ("corrupted double-linked list").
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("LP_NUM_THREADS", "0")

# A shell's jobs in the background ignore Ctrl-C, and so would the programs that tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A new folder for what processes keep."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IRRSPLAT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(autouse=True)
def few_sites(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the surface cache a tenth of its sites and rays in tests marked `few_sites`. Tests of light never have that mark."""
    if request.node.get_closest_marker("few_sites"):
        monkeypatch.setattr(site_layout, "POINTS", tuple(points // 10 for points in site_layout.POINTS))
        monkeypatch.setattr(site_rays, "RAYS", site_rays.RAYS // 10)


@pytest.fixture(scope="session", autouse=True)
def clock() -> Iterator[CountedClock]:
    """The clock of frame budgets and notices: it counts work, so that load and machine do not matter."""
    made = CountedClock()
    with use_clock(made):
        yield made


@pytest.fixture
def ctx() -> Iterator[moderngl.Context]:
    """The session's OpenGL context, made current for this test (a Renderer of an earlier test may have left another current)."""
    shared = context.shared()
    with shared:
        yield shared


@pytest.fixture
def software(ctx: moderngl.Context) -> bool:
    """True if OpenGL is Mesa's software renderer.

    Hardware rounds otherwise: corners of triangles lie on a grid of 1/256 pixel, and so do the weights of texture filters.
    """
    return bool(context.describe(ctx)["software"])


@pytest.fixture(autouse=True)
def no_gl_errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fails the test that left an OpenGL error in any context that it used: the shared one, or one that it made itself."""
    contexts: list[moderngl.Context] = [context.shared()] if context.shared.cache_info().currsize else []
    for one in contexts:
        one.gc_mode = "context_gc"
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
        free_dropped(one)
    assert set(found) <= {"GL_NO_ERROR"}, f"this test left OpenGL errors: {found}"


def free_dropped(one: moderngl.Context) -> None:
    """Free what tests made in the shared context and dropped: moderngl leaves that to its maker, and a session would grow by
    gigabytes. Contexts that are made anew are released whole, and those of the product show what it does not free."""
    while one.objects:
        dropped = one.objects.popleft()
        if not isinstance(dropped, moderngl.InvalidObject):  # it was released before it was dropped
            with one:
                dropped.release()


@pytest.fixture(scope="session")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    """A viewer of a small room, shared by all tests that do not open their own."""
    with viewing(write_room(tmp_path_factory.mktemp("room"))) as made:
        yield made


@pytest.fixture
def driver(one: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """The same as when it was opened, at rest; what it writes goes to `tmp_path`."""
    yield from fresh(one, tmp_path, monkeypatch)
