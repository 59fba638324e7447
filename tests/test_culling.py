"""Records out of view: none that says anything is left out, to the bit, and most of those that say nothing are."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.cache import RecordCache
from irrsplat.culling import reaching, within
from irrsplat.passes.splat import SplatPass
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings, preset
from tests.test_renderer import FAST, room
from tests.worlds import floor, gbuffer_of, lamp, on_plane, scene, sites

SIZE = (45, 30)
COUNT = 3000


def scattered(ctx: moderngl.Context, seed: int) -> RecordCache:
    """Records all over a floor of 20 m, from tiny ones to such as reach across half of it."""
    rng = np.random.default_rng(seed)
    cache = RecordCache(ctx)
    p = rng.uniform(-10.0, 10.0, (COUNT, 3)) * (1.0, 0.0, 1.0)
    values = np.column_stack([rng.uniform(0.0, 3.0, (COUNT, 3)), 10.0 ** rng.uniform(-2.0, 1.0, COUNT)])
    cache.append(sites(p, (0.0, 1.0, 0.0)), values)
    return cache


def cameras(count: int, seed: int) -> list[Camera]:
    """Close over the floor, looking anywhere, with any field of view."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        eye = rng.uniform((-9, 0.05, -9), (9, 3.0, 9))
        target = eye + rng.normal(size=3) * (1.0, 0.7, 1.0)
        made.append(Camera(tuple(eye), tuple(target), (0.1, 1.0, 0.0), float(rng.uniform(5.0, 150.0))))
    return made


SETTINGS = {
    "default": Settings(),
    "paper": preset("paper", a=0.4),
    "no least radius": Settings(radius_min=0.0, radius_max=30.0),
    "radii by gradients": Settings(radius_max=0.0, radius_min=1.0),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_what_is_left_out_would_add_nothing(ctx: moderngl.Context, name: str) -> None:
    """Every sum is the same to the bit as with all records drawn, from cameras that have them all around."""
    settings, cache = SETTINGS[name], scattered(ctx, 1)
    splats, drawn = SplatPass(ctx, SIZE, settings.gradients), []
    for camera in cameras(40, 2):
        position, depth = on_plane(camera, SIZE, (0, 0, 0), (0, 1, 0))
        seen = (depth > 0.01) & (depth < 30.0)
        normal = np.broadcast_to((0.0, 1.0, 0.0), position.shape)
        gbuffer = gbuffer_of(ctx, np.where(seen[..., None], position, 0.0), normal, np.where(seen, depth, 0.0))
        found = []
        for numbers in (np.arange(COUNT), reaching(cache, 0, camera, SIZE, settings)):
            splats.clear(gbuffer)
            splats(cache.records, numbers, gbuffer, camera, settings)
            found.append((splats.target.read(0).copy(), splats.target.read(1).copy(), len(numbers)))
        (all_sums, all_weight, _), (sums, weight, count) = found
        assert np.array_equal(sums, all_sums) and np.array_equal(weight, all_weight)
        drawn.append(count)
    assert np.median(drawn) < 0.6 * COUNT and min(drawn) < 0.15 * COUNT, "and they are left out"
    splats.release()
    cache.release()


def test_few_are_drawn_that_lie_outside_where_reach_is_bounded(ctx: moderngl.Context) -> None:
    """A sphere of 7 % of the height is seen under one angle from anywhere: all drawn lie in a pyramid so much wider."""
    cache = scattered(ctx, 3)
    for camera in cameras(20, 4):
        camera = replace(camera, fov=40.0)
        numbers = reaching(cache, 0, camera, SIZE, Settings(radius_max=7.0))
        wider = replace(camera, fov=40.0 + 2.0 * 1.25 * float(np.degrees(np.arcsin(0.07 * camera.screen))))
        assert np.isin(np.flatnonzero(within(cache.positions, camera, SIZE)), numbers).all()
        assert within(cache.positions, wider, SIZE)[numbers].all()
    cache.release()


def test_within_is_what_the_projection_says() -> None:
    """A point lies in the pyramid where its clip coordinates do."""
    points = np.random.default_rng(5).normal(size=(5000, 3)).astype("f4") * 3.0
    for camera in cameras(10, 6):
        clip = np.column_stack([points, np.ones(5000)]) @ (camera.clip_from_view(1.5, 1e-4, 1e4) @ camera.view_from_world).T
        sure = np.abs(np.abs(clip[:, :2]) - clip[:, 3:]).min(1) > 1e-4
        truth = (np.abs(clip[:, :2]) < clip[:, 3:]).all(1)
        assert np.array_equal(within(points, camera, SIZE)[sure], truth[sure])


def test_a_picture_is_the_same_with_many_records_elsewhere() -> None:
    """What lies behind the camera is neither seen nor felt, to the bit."""
    with Renderer(room(), (40, 40), **FAST | {"preset": "paper", "a": 0.4, "warmup": 60}) as renderer:
        before = renderer.render()
        camera = renderer.scene.camera()
        behind = np.asarray(camera.eye) + 20.0 * camera.axes[2] + np.random.default_rng(0).normal(size=(5000, 3))
        renderer.cache.append(sites(behind, (0.0, 1.0, 0.0)), np.full((5000, 4), 0.5, "f4"))
        renderer.forget(records=False)
        after = renderer.render()
    assert after.stats["records"] == before.stats["records"] + 5000
    assert np.array_equal(after.weight, before.weight) and np.array_equal(after.irradiance, before.irradiance)


def test_without_bounces_none_is_drawn() -> None:
    with Renderer(scene(floor(), lights=(lamp((0, 1, 0)),)), (8, 8), **FAST | {"bounces": 0}) as renderer:
        renderer.cache.append(sites((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), np.ones((1, 4), "f4"))
        assert (renderer.render().weight == 0.0).all()
