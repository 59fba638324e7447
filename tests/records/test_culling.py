"""Records out of view: none that says anything is left out, to the bit, and most of those that say nothing are."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.vertex_layout import vertex_column
from irrsplat.indirect.splat import SplatPass
from irrsplat.records import culling
from irrsplat.records.culling import TILE, reaching, within
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings, preset
from tests.renderer.test_renderer import FAST, room
from tests.support.worlds import box, floor, gbuffer_of, lamp, material, on_plane, scene, sites

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


def cells() -> Scene:
    """Three by three rooms of 2 m side by side, a lamp in the middle one."""
    rooms = [box((i, 0, j), (i + 1.95, 1.5, j + 1.95), material(0.6), outward=False) for i in (-3, -1, 1) for j in (-3, -1, 1)]
    return scene(*rooms, lights=(lamp((0, 1, 0)),))


@pytest.mark.parametrize("name", SETTINGS)
def test_what_is_hidden_would_add_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Records on all walls of many rooms, seen from within them: to the bit as if all were drawn, and few are."""
    monkeypatch.setattr(culling, "_MANY", 0)
    size = (120, 80)  # some tiles
    rng, world, settings = np.random.default_rng(7), cells(), SETTINGS[name]
    vertices, faces, _ = flatten(world)
    face = faces[rng.integers(0, len(faces), COUNT)]
    share = rng.dirichlet((1, 1, 1), COUNT)
    p, n = (np.einsum("nc,ncx->nx", share, vertex_column(vertices, name)[face]) for name in ("position", "normal"))
    drawn = []
    with Renderer(world, size, **FAST) as renderer:
        values = np.column_stack([rng.uniform(0.0, 3.0, (COUNT, 3)), 10.0 ** rng.uniform(-2.0, -0.3, COUNT)])
        renderer.cache.append(sites(p, n), values)
        splats = SplatPass(renderer.ctx, size, settings.gradients)
        for camera in cameras(30, 8):
            eye = rng.uniform((-2.9, 0.05, -2.9), (2.9, 1.45, 2.9))
            camera = replace(camera, eye=tuple(eye), target=tuple(eye + np.subtract(camera.target, camera.eye)))
            gbuffer = renderer.draw_gbuffer(camera)
            found = []
            sight = partial(splats.farthest, gbuffer, camera)
            for numbers in (np.arange(COUNT), reaching(renderer.cache, 0, camera, size, settings, sight)):
                splats.clear(gbuffer)
                splats(renderer.cache.records, numbers, gbuffer, camera, settings)
                found.append((splats.target.read(0).copy(), splats.target.read(1).copy()))
            assert np.array_equal(*(one[0] for one in found)) and np.array_equal(*(one[1] for one in found))
            drawn.append(len(numbers) / max(len(reaching(renderer.cache, 0, camera, size, settings)), 1))
    assert np.mean(drawn) < 0.9 and min(drawn) < 0.3, "of those in the pyramid"


def test_how_far_tiles_see(ctx: moderngl.Context) -> None:
    """The farthest pixel of each tile, bottom row first, those at the border cut short; nothing seen is no distance."""
    size = (2 * TILE + 5, TILE + 3)
    camera = cameras(1, 9)[0]
    position, depth = on_plane(camera, size, (0, -1, 0), (0.1, 1, 0.05))
    seen = (depth > 0.0) & (np.random.default_rng(9).random(depth.shape) < 0.9)
    seen[:3] = False
    position = np.where(seen[..., None], position, 0.0).astype("f4")
    splats = SplatPass(ctx, size, False)
    found = splats.farthest(gbuffer_of(ctx, position, np.ones_like(position), np.where(seen, depth, 0.0)), camera)
    distance = np.where(seen, np.linalg.norm(position - np.asarray(camera.eye), axis=-1), 0.0)[::-1]
    truth = [[distance[y : y + TILE, x : x + TILE].max() for x in range(0, size[0], TILE)] for y in range(0, size[1], TILE)]
    assert seen.any() and np.allclose(found, truth, rtol=1e-5)
    splats.release()


def test_few_are_drawn_that_lie_outside_where_reach_is_bounded(ctx: moderngl.Context) -> None:
    """A sphere of 7 % of the height is seen under one angle from anywhere: all drawn lie in one so much wider, and two pixels."""
    cache = scattered(ctx, 3)
    for camera in cameras(20, 4):
        camera = replace(camera, fov=40.0)
        numbers = reaching(cache, 0, camera, SIZE, Settings(radius_max=7.0, borrow=0))
        wider = replace(camera, fov=46.0 + 2.0 * 1.25 * float(np.degrees(np.arcsin(0.07 * camera.screen))))
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
