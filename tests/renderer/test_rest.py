"""Viewer in converged views and in flight over known views: samples accumulate, then neither draws nor new objects occur."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.view_options import ViewOptions
from irrsplat.gpu.program import Program
from irrsplat.gpu.target import pixels
from irrsplat.image.tonemap import tonemap
from tests.app.viewer.test_viewer_leaks import CREATORS
from tests.support.counted_clock import CountedClock
from tests.support.viewing import Driver, brighter, viewing, write_room

SAMPLES = 6


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    """A viewer with SAMPLES samples per pixel in a converged view."""
    with viewing(write_room(tmp_path_factory.mktemp("room")), (160, 120), viewer_samples=SAMPLES) as made:
        yield made


@pytest.fixture
def spied(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count draws by program, and new OpenGL objects by kind; clear the counter to start."""
    counts: Counter[str] = Counter()

    def watch(owner: type, name: str, label: Any) -> None:
        plain = getattr(owner, name)

        def call(self: Any, *args: Any, **options: Any) -> Any:
            counts[label(self)] += 1
            return plain(self, *args, **options)

        monkeypatch.setattr(owner, name, call)

    watch(Program, "__call__", lambda program: program.name)
    for name in (*CREATORS, "query"):
        watch(moderngl.Context, name, lambda _, name=name: f"new {name}")
    return counts


def settle(driver: Driver) -> None:
    """Render frames with a budget of 1 ms: one sample per frame."""
    driver.session.change(0, budget=1.0, viewer_samples=SAMPLES)
    driver.settle()


# ---- samples ----------------------------------------------------------------------------------------------------------


def test_samples_add_up_until_the_view_rests(driver: Driver) -> None:
    """A small budget gives at most one sample per frame, none in the first; the final picture is that of a render."""
    settle(driver)
    session = driver.session
    assert session.views[0].samples == SAMPLES and session.renderers[0].timers.milliseconds() == {}
    session.free_camera.camera = replace(session.camera, fov=48.0)
    counts = []
    for _ in range(400):
        driver.frame()
        counts.append(session.views[0].samples)
        if session.at_rest:
            break
    assert counts == sorted(counts) and set(counts) == set(range(1, SAMPLES + 1))
    renderer = session.renderers[0]
    renderer.change(replace(renderer.settings, samples=SAMPLES))
    mine = session.views[0].read()
    frame = renderer.render(session.camera)
    for name in ("image", "direct", "indirect", "emission", "irradiance"):
        assert np.allclose(getattr(mine, name), getattr(frame, name), rtol=1e-5, atol=1e-6), name
    assert mine.stats["samples"] == SAMPLES


def test_what_a_picture_does_not_depend_on_leaves_the_samples(driver: Driver, spied: Counter[str]) -> None:
    """Exposure, buffer, overlays and an inspected record keep the samples; blend, light and camera restart them."""
    settle(driver)
    spied.clear()
    session, actions = driver.session, driver.actions
    for act in (
        lambda: session.change(0, exposure=1.5),
        lambda: actions.show("indirect"),
        lambda: actions.toggle("discs"),
        lambda: actions.toggle("frozen"),
    ):
        act()
        driver.frame()
        assert session.at_rest and session.views[0].samples == SAMPLES
    assert spied["image/accumulate"] == spied["image/gbuffer"] == 0
    actions.toggle("frozen")
    moves: tuple[Any, ...] = (
        lambda: session.change(0, blend=0.7),
        lambda: actions.editor.set_light(0, brighter(actions.editor.scene.lights[0])),
        lambda: setattr(session.free_camera, "camera", replace(session.camera, fov=44.0)),
    )
    for act in moves:
        driver.settle()
        act()
        driver.frame()
        assert not session.at_rest and session.views[0].samples == 1


def test_a_refined_view_follows_the_blend_at_once(driver: Driver, clock: CountedClock) -> None:
    """Without indirect light, the picture of a refined view is its direct light."""
    session = driver.session
    session.change(0, viewer_samples=SAMPLES, viewer_quality=0.5)
    driver.settle()
    assert session.views[0].splats.reach is not None, "a step of refinement is on show"
    session.change(0, blend=0.0)
    driver.frame()
    image, direct = (pixels(texture)[..., :3] for texture in (session.views[0].image, session.views[0].direct))
    assert not session.at_rest and np.allclose(image, direct, rtol=1e-5, atol=1e-6)


def test_edges_are_smooth_before_the_records_are_complete(driver: Driver, clock: CountedClock) -> None:
    """Direct light alone needs no record: the first picture is closer to the final picture than the light at pixel centres."""
    session = driver.session
    session.change(0, blend=0.0, viewer_samples=32)
    driver.settle()
    final = tonemap(pixels(session.views[0].image)[..., :3], session.auto_exposure.stops)
    assert np.abs(driver.canvas() / 255.0 - final).max() < 1.0 / 255.0, "many samples need no smoothing"
    driver.actions.clear()
    driver.frame()
    assert session.views[0].samples == 1 and not session.progress[0].still
    centres = tonemap(pixels(session.views[0].image)[..., :3], session.auto_exposure.stops)
    plain, smooth = (float(np.sqrt(np.mean((one - final) ** 2))) for one in (centres, driver.canvas() / 255.0))
    assert plain > 0.01 and smooth < 0.6 * plain, (plain, smooth)


# ---- no draws, no new objects -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", ["panels", "marks", "split"])
def test_at_rest_nothing_is_drawn_but_the_interface(driver: Driver, spied: Counter[str], case: str) -> None:
    """Each frame copies the existing picture into the window and draws the interface: no object is made."""
    options = driver.session.options
    if case == "panels":
        driver.session.options = ViewOptions(settings=True, lights=True)
    elif case == "marks":
        options.discs = True
    elif case == "split":
        driver.session.split(True)
        driver.quicken()
    driver.frame(3)  # the picture has the size that the panel leaves
    settle(driver)
    driver.frame(2)  # opened panels have their place now
    spied.clear()
    driver.frame(5)
    assert spied == {}


def test_a_flight_over_what_was_seen_makes_nothing(driver: Driver, spied: Counter[str]) -> None:
    """A second flight along the same path, with the cursor on the picture, its value on show, and automatic exposure."""
    driver.session.options.controls = True
    driver.session.change(0, exposure="auto", viewer_samples=0)
    home = driver.session.camera
    cameras = [replace(home, fov=50.0 + step) for step in (1.0, 2.0, 3.0, 4.0)]
    driver.move(80, 60)
    for camera in 3 * cameras:  # later views can shrink a record's radius; the next flight fills the gap
        driver.session.free_camera.camera = camera
        driver.settle()
    spied.clear()
    for camera in cameras:
        driver.session.free_camera.camera = camera
        driver.frame()
        assert driver.session.progress[0].new == 0
    assert spied["lib/nothing"] == len(cameras) and spied["image/composite"] == len(cameras)  # a g-buffer begins with nothing
    new = {name for name in spied if name.startswith("new ")}
    assert new <= {"new framebuffer"}, "by which the value under the cursor is read"
