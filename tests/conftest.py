"""Fixtures of all tests: one OpenGL context, a check for OpenGL errors after each test, and a viewer to drive."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

# Idle threads of OpenBLAS spin on the cores of the other test processes. OpenBLAS reads this variable when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Freed memory stays with the process: new memory for each texture and array takes a tenth of the tests' time. glibc reads
# these variables when a process starts; the test processes start after this line.
os.environ.setdefault("MALLOC_MMAP_THRESHOLD_", str(1 << 30))
os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", str(1 << 31))
os.environ.setdefault("MALLOC_TOP_PAD_", str(1 << 24))

import moderngl
import pytest

from irrsplat.core.timing.clock import use_clock
from irrsplat.gpu import context
from irrsplat.surface_cache import site_layout, site_rays, tessellation
from tests.support.counted_clock import CountedClock
from tests.support.crashes import pytest_configure, pytest_handlecrashitem  # noqa: F401  hooks
from tests.support.viewing import Driver, fresh, viewing, write_room
from tests.support.worlds import shared

# Each of several test processes draws with llvmpipe, the software renderer, in the calling thread. llvmpipe reads this variable
# when OpenGL starts. With even one thread of llvmpipe, Mesa 22.3 may free a fence during its unlocking and zero freed memory.
# In one of about ten whole runs, malloc then ended a process ("corrupted double-linked list").
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("LP_NUM_THREADS", "0")

# Background jobs of a shell ignore Ctrl-C; programs started by tests would inherit this and could not be interrupted.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Provide a new folder for the caches of all processes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IRRSPLAT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(autouse=True)
def few_sites(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the surface cache a tenth of its sites and rays in tests marked `few_sites`; tests of light do not use the mark.

    No cells are halved near lights, since every light is near at a spacing of a metre.
    """
    if request.node.get_closest_marker("few_sites"):
        monkeypatch.setattr(site_layout, "POINTS", tuple(points // 10 for points in site_layout.POINTS))
        monkeypatch.setattr(site_rays, "RAYS", site_rays.RAYS // 10)
        monkeypatch.setattr(tessellation, "_FINEST", 0)


@pytest.fixture(scope="session", autouse=True)
def clock() -> Iterator[CountedClock]:
    """Provide the clock of frame budgets and notices: it counts work and is independent of load and machine."""
    made = CountedClock()
    with use_clock(made):
        yield made


@pytest.fixture
def ctx() -> Iterator[moderngl.Context]:
    """Make the session's OpenGL context current, because an earlier test may have left another one current."""
    with shared() as made:
        yield made


@pytest.fixture
def software(ctx: moderngl.Context) -> bool:
    """True if OpenGL is Mesa's software renderer.

    Hardware rounds differently: it snaps triangle corners and the weights of texture filters to a grid of 1/256 pixel.
    """
    return bool(context.describe(ctx)["software"])


@pytest.fixture(autouse=True)
def no_gl_errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail a test that leaves an OpenGL error in the shared context or in a context of its own."""
    contexts: list[moderngl.Context] = [shared()] if shared.cache_info().currsize else []
    for one in contexts:
        one.gc_mode = "context_gc"
        with one:
            one.clear_errors()
    found: list[str] = []
    create, release = context.create, moderngl.Context.release

    def watched_create() -> moderngl.Context:
        made = create()
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
    """Free the objects that tests dropped in the shared context; without this a session grows by gigabytes."""
    while one.objects:
        dropped = one.objects.popleft()
        if not isinstance(dropped, moderngl.InvalidObject):  # an invalid object has been released already
            with one:
                dropped.release()


@pytest.fixture(scope="session")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    """Provide a viewer of a small room, shared by all tests without a viewer of their own."""
    with viewing(write_room(tmp_path_factory.mktemp("room"))) as made:
        yield made


@pytest.fixture
def driver(one: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """Provide the shared viewer in its initial converged state; it writes to `tmp_path`."""
    yield from fresh(one, tmp_path, monkeypatch)
