"""The surface cache in the viewer: its buffer, its value under the cursor, its sites over any buffer, and how far it has come."""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.buffers.buffer_view import BufferView
from irrsplat.app.viewer.buffers.shown_buffer import ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.markers import Markers
from irrsplat.app.viewer.show.screen import clear
from irrsplat.gpu import context
from irrsplat.gpu.target import Target, pixels
from irrsplat.image.tonemap import tonemap
from irrsplat.image.view import View
from irrsplat.renderer import Renderer
from tests.support.viewing import Driver

SIZE = (97, 61)
GROUND = (0.25, 0.5, 0.75)
EXPOSURE = -1.0  # stops


@pytest.fixture(scope="module")
def cornell() -> Iterator[tuple[Renderer, View]]:
    """A view of the box, and its surface cache of all bounces."""
    with context.shared():
        renderer = Renderer(irrsplat.load("cornell"), SIZE, ctx=context.shared(), gather_size=8, shadow_size=128)
        view, _ = renderer.frame()
    yield renderer, view
    with context.shared():
        renderer.release()


@pytest.fixture
def target(ctx: moderngl.Context) -> Iterator[Target]:
    made = Target(ctx, SIZE, (4,))
    clear(made, GROUND)
    yield made
    made.release()


def test_the_buffer_is_what_a_lookup_says(cornell: tuple[Renderer, View], ctx: moderngl.Context, target: Target) -> None:
    """As a white surface sends it out, and its numbers under the cursor."""
    renderer, view = cornell
    seen = renderer.scheduler.gatherer.surface_at(view.gbuffer)
    assert seen is not None and renderer.scheduler.gatherer.surface_at(view.gbuffer) is seen
    found, buffer_view, source = pixels(seen), BufferView(ctx), ViewSource(renderer, view, EXPOSURE)
    buffer_view.draw(target, "surface", source)
    mask = pixels(view.gbuffer.position)[..., 3] > 0.0
    expected = np.where(mask[..., None], tonemap(found[..., :3] / np.pi, EXPOSURE), 0.0)
    assert expected[mask].std() > 0.1 and (found[..., 3] == mask).all()
    assert np.abs(target.read()[..., :3] - expected).max() < 1.0 / 255.0
    for y, x in np.random.default_rng(1).permutation(np.argwhere(mask))[:5]:
        value = buffer_view.value("surface", source, int(x), int(y))
        assert value is not None and np.array_equal(value, found[y, x, :3])
    assert buffer_view.value("surface", source, *np.argwhere(~mask)[0][::-1]) is None
    assert "W/m²" in BUFFERS["surface"].legend(source).text
    buffer_view.release()


def test_sites_are_dots_where_they_lie(cornell: tuple[Renderer, View], ctx: moderngl.Context) -> None:
    """In a picture ten times as large most dots lie apart: their middles have the colour of a white surface there."""
    renderer, view = cornell
    cache, markers, target = renderer.scheduler.gatherer.surface, Markers(ctx), Target(ctx, (10 * SIZE[0], 10 * SIZE[1]), (4,))
    assert cache is not None and cache.result is not None
    clear(target, GROUND)
    markers.sites(target, view, None, exposure=EXPOSURE)
    assert (target.read()[..., :3] == np.array(GROUND, "f4")).all()
    markers.sites(target, view, cache, exposure=EXPOSURE)
    drawn = target.read()[..., :3]
    position, normal = cache.sites.position.astype(float), cache.sites.normal.astype(float)
    x, y, z = view.camera.axes @ (position - view.camera.eye).T
    f = SIZE[1] / view.camera.screen
    column, row = (0.5 * SIZE[0] + f * x / -z), (0.5 * SIZE[1] - f * y / -z)
    inside = (column > 1) & (column < SIZE[0] - 1) & (row > 1) & (row < SIZE[1] - 1) & (z < 0.0)
    at = pixels(view.gbuffer.position)[np.clip(row.astype(int), 0, SIZE[1] - 1), np.clip(column.astype(int), 0, SIZE[0] - 1)]
    inside &= np.linalg.norm(at[:, :3] - position, axis=1) < 0.15  # where a pixel's middle is not far off
    picture = drawn[np.clip(10 * row, 0, 10 * SIZE[1] - 1).astype(int), np.clip(10 * column, 0, 10 * SIZE[0] - 1).astype(int)]
    expected = tonemap(cache.result.irradiance[2:] / np.pi, EXPOSURE)
    own = np.abs(picture - expected).max(1) < 0.01
    facing = ((np.asarray(view.camera.eye) - position) * normal).sum(1) > 0.0
    assert (inside & facing).sum() > 300 and own[inside & facing].mean() > 0.5
    assert (drawn == np.array(GROUND, "f4")).all(-1).mean() > 0.5
    markers.release()
    target.release()


@pytest.mark.slow
def test_the_viewer_makes_it_tick_by_tick(driver: Driver) -> None:
    """More bounces: the old picture stays until the cache is made, then all records follow, and the room is brighter."""
    driver.actions.panels.hud = True
    driver.settle()
    once = driver.session.frame().irradiance.mean()
    driver.session.change(0, bounces="all", budget=10.0)
    shares = []
    for _ in range(2000):
        driver.frame()
        shares.append(driver.session.progress[0].surface)
        if driver.session.at_rest:
            break
    assert driver.session.at_rest and len([s for s in shares if s < 1.0]) > 3 and shares == sorted(shares)
    frame = driver.session.frame()
    assert frame.stats["bounces"] > 2 and frame.stats["bounces_converged"] and frame.irradiance.mean() > 1.1 * once
    bare = driver.canvas()
    driver.actions.show("surface")
    driver.frame()
    assert (driver.canvas() != bare).any(-1).mean() > 0.3
    driver.session.change(0, bounces=1, budget=80.0)
    driver.settle()
    assert np.ptp(driver.canvas().reshape(-1, 3), axis=0).max() == 0, "then there is nothing to show"
    assert driver.session.frame().irradiance.mean() == pytest.approx(once, rel=0.05)
