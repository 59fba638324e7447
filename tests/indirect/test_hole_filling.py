"""Light of holes: probes of few rays, filtered along the surfaces of a picture (docs/METHOD.md, 8.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer, load
from irrsplat.core.buffers import GBuffer, Sites, SplatBuffer
from irrsplat.core.timing.clock import use_clock
from irrsplat.gpu.target import pixels, table_texture
from irrsplat.indirect.hole_filling import HoleFilling, HoleLight, HoleProbes
from irrsplat.scene.model import Camera
from tests.renderer.test_renderer import FAST, FRONT, room
from tests.support.counted_clock import RayClock
from tests.support.worlds import gbuffer_of, on_plane

SIZE = (64, 48)
FAR, NEAR = 1.0, 9.0  # W/m², irradiance of a wall, and of a board one metre in front of its right half
LEAK = 0.005  # relative: the least weights of other surfaces, times the ratio of both irradiances


@dataclass(frozen=True)
class Seen:
    """A view of the wall and the board: its g-buffer, empty sums, and the irradiance (H, W) of its surfaces, W/m²."""

    camera: Camera
    gbuffer: GBuffer
    empty: SplatBuffer
    irradiance: np.ndarray


def seen(ctx: moderngl.Context, x: float) -> Seen:
    """Return the view from (x, 0.2, 3)."""
    camera = Camera((x, 0.2, 3.0), (x, 0.0, 0.0), fov=50.0)
    (far, far_depth), (near, near_depth) = (on_plane(camera, SIZE, (0, 0, z), (0, 0, 1)) for z in (0.0, 1.0))
    board = near[..., 0] > 0.1
    position, depth = np.where(board[..., None], near, far), np.where(board, near_depth, far_depth)
    gbuffer = gbuffer_of(ctx, position, np.broadcast_to((0.0, 0.0, 1.0), position.shape), depth)
    nothing = table_texture(ctx, np.zeros((*SIZE[::-1], 4)))
    return Seen(camera, gbuffer, SplatBuffer(nothing, nothing), np.where(board, NEAR, FAR))


def probed(sites: Sites, noise: np.ndarray | float = 0.0) -> np.ndarray:
    """Return (N, 4) the values of probes at `sites`: E with a relative `noise`, and R of 10 m."""
    E = np.where(sites.position[:, 2] > 0.5, NEAR, FAR) * (1.0 + noise)
    return np.stack([E, E, E, np.full(len(E), 10.0)], axis=1)


def filled(filling: HoleFilling, view: Seen, probes: HoleProbes | None) -> np.ndarray:
    """Return (H, W) the filled irradiance of a view, W/m²; top row first."""
    sums = pixels(filling(view.gbuffer, view.empty, view.camera, HoleLight(probes, {})).sums)
    return np.asarray(sums[..., 0] / sums[..., 3])


def test_light_stays_on_its_surface_and_serves_other_views(ctx: moderngl.Context) -> None:
    """A mean of equal values is that value: each surface keeps its irradiance, at the edge of the board, too.

    From another place, the probes are found again: only what the board hid has none.
    """
    with HoleProbes(ctx) as probes, HoleFilling(ctx, SIZE) as filling:
        first, second = seen(ctx, 0.0), seen(ctx, 0.3)
        sites = filling.sites(first.gbuffer, first.empty, first.camera, HoleLight(probes, {}))
        assert len(sites) == filling.grid[0] * filling.grid[1], "every cell has a hole"
        some = sites[np.arange(len(sites) // 4)]  # the sparse ones are spread evenly
        probes.cache.append(some, probed(some))
        assert np.abs(filled(filling, first, probes) / first.irradiance - 1.0).max() < LEAK
        probes.cache.append(sites, probed(sites))
        left = filling.sites(second.gbuffer, second.empty, second.camera, HoleLight(probes, {}))
        assert 0 < len(left) < 0.35 * len(sites)
        inner = (slice(4, -4), slice(4, -12))  # the camera went to the right, and sees new parts there
        assert np.abs(filled(filling, second, probes) / second.irradiance - 1.0)[inner].max() < LEAK


def test_the_filter_averages_noise_on_flat_surfaces(ctx: moderngl.Context) -> None:
    """Three steps join more than 16 probes of a flat wall, which leaves at most a quarter of independent noise."""
    view, rng = seen(ctx, -3.0), np.random.default_rng(1)  # the wall alone
    with HoleProbes(ctx) as probes, HoleFilling(ctx, SIZE) as filling:
        sites = filling.sites(view.gbuffer, view.empty, view.camera, HoleLight(probes, {}))
        probes.cache.append(sites, probed(sites, 0.2 * rng.standard_normal(len(sites))))
        wall = view.irradiance == FAR
        found = filled(filling, view, probes)[wall]
        assert wall.mean() > 0.9 and found.std() < 0.05 and abs(found.mean() - FAR) < 0.02


@pytest.mark.parametrize("with_probes", [False, True])
def test_records_keep_their_pixels_and_light_the_holes_around_them(ctx: moderngl.Context, with_probes: bool) -> None:
    """The sums of records stay as they are, and holes around them take the light of records on their surface.

    Without any probe, this light reaches all holes, however far.
    """
    view = seen(ctx, 0.0)
    covered = np.zeros(SIZE[::-1], bool)
    covered[20:28, 4:12] = covered[20:28, 52:60] = True  # on the wall and on the board
    E = np.where(covered, view.irradiance, 0.0)[..., None] * np.ones(3)
    texture = table_texture(ctx, np.concatenate([2.0 * E, 2.0 * covered[..., None]], axis=-1)[::-1])
    view = Seen(view.camera, view.gbuffer, SplatBuffer(texture, texture), view.irradiance)
    with HoleProbes(ctx) as probes, HoleFilling(ctx, SIZE) as filling:
        sums = pixels(filling(view.gbuffer, view.empty, view.camera, HoleLight(probes if with_probes else None, {})).sums)
        assert (sums[covered] == pixels(texture)[covered]).all()
        lit, near = sums[..., 3] > 0.0, np.zeros_like(covered)
        near[17:31, 1:15] = near[17:31, 49:63] = True
        assert lit[near].all() and (with_probes or lit.all())
        assert np.abs(sums[near][:, 0] / sums[near][:, 3] / view.irradiance[near] - 1.0).max() < 0.05


@pytest.mark.few_sites
def test_a_picture_without_the_surface_cache_forgets_its_light(ctx: moderngl.Context) -> None:
    """Without records, probes and surface cache there is no light, whatever the picture before it has shown."""
    with Renderer(room(), SIZE, ctx=ctx, **FAST | {"bounces": 2}) as renderer, HoleFilling(ctx, SIZE) as filling:
        view, _ = renderer.frame(FRONT)
        nothing = table_texture(ctx, np.zeros((*SIZE[::-1], 4)))
        seen = view.gbuffer, SplatBuffer(nothing, nothing), FRONT
        assert pixels(filling(*seen, HoleLight(None, renderer.scheduler.gatherer.surface_uniforms)).sums)[..., :3].any()
        assert not pixels(filling(*seen, HoleLight(None, {})).sums).any()


def test_light_reaches_thin_objects_between_cells_before_the_sky(ctx: moderngl.Context) -> None:
    """The wall ends, and a column of its pixels that no cell samples lies far from the edge: it has the wall's light."""
    view = seen(ctx, -3.0)
    position = pixels(view.gbuffer.position).copy()
    shown = np.zeros(SIZE[::-1], bool)
    shown[:, :20] = shown[:, 50] = True
    position[~shown] = 0.0
    view = replace(view, gbuffer=replace(view.gbuffer, position=table_texture(ctx, position[::-1])))
    with HoleProbes(ctx) as probes, HoleFilling(ctx, SIZE) as filling:
        sites = filling.sites(view.gbuffer, view.empty, view.camera, HoleLight(probes, {}))
        probes.cache.append(sites, probed(sites))
        sums = pixels(filling(view.gbuffer, view.empty, view.camera, HoleLight(probes, {})).sums)[shown]
        assert len(sites) and np.allclose(sums, FAR, rtol=1e-4)


@pytest.mark.few_sites
def test_objects_between_cells_have_the_light_of_the_surface_cache(ctx: moderngl.Context) -> None:
    """Cells sample odd columns. Surfaces that lie in even columns alone take the surface cache's values there."""
    with Renderer(room(), SIZE, ctx=ctx, **FAST | {"bounces": 2}) as renderer, HoleFilling(ctx, SIZE) as filling:
        view, _ = renderer.frame(FRONT)
        nothing, position = table_texture(ctx, np.zeros((*SIZE[::-1], 4))), pixels(view.gbuffer.position).copy()
        position[:, 1::2] = 0.0
        gbuffer = replace(view.gbuffer, position=table_texture(ctx, position[::-1]))
        empty, surface = SplatBuffer(nothing, nothing), renderer.scheduler.gatherer.surface_uniforms
        found = pixels(filling(gbuffer, empty, FRONT, HoleLight(None, surface)).sums).copy()
        assert found[:, ::2, :3].any() and np.array_equal(found, pixels(filling.by_surface(gbuffer, empty, surface).sums))


@pytest.mark.few_sites
def test_records_change_the_light_of_the_surface_cache_near_them_alone(ctx: moderngl.Context) -> None:
    """With the surface cache, holes at a distance take its light, and not that of far records."""
    with Renderer(room(), SIZE, ctx=ctx, **FAST | {"bounces": 2}) as renderer, HoleFilling(ctx, SIZE) as filling:
        view, _ = renderer.frame(FRONT)
        surface, found = renderer.scheduler.gatherer.surface_uniforms, []
        for E in (0.0, 1000.0):
            texels = np.zeros((*SIZE[::-1], 4))
            texels[:, :4] = E
            sums = table_texture(ctx, texels)
            found.append(pixels(filling(view.gbuffer, SplatBuffer(sums, sums), FRONT, HoleLight(None, surface)).sums)[:, 32:])
        assert found[0].any() and np.array_equal(found[0], found[1])


def test_the_black_outside_of_a_lit_box_stays_black_while_it_comes_into_view(ctx: moderngl.Context) -> None:
    """No light reaches the outside of the left wall (x = 0), and automatic exposure meters lit surfaces alone."""
    with use_clock(RayClock(1e8)), Renderer(load("cornell"), (96, 64), ctx=ctx, gather_size=8) as renderer:  # 10 000 rays a tick
        renderer.converge(renderer.scene.cameras[0])
        outside, stops = list[float](), list[float]()
        for share in np.linspace(0.0, 1.0, 12):
            camera = Camera((0.4 - 1.8 * float(share), 3.1, -6.3 + 1.1 * float(share)), (2.78, 2.4, 2.0), fov=39.3)
            view, _ = renderer.frame(camera, 1e-4)
            frame = view.read()
            wall = (np.abs(frame.position[..., 0]) < 1e-4) & (frame.normal[..., 0] < 0.0) & np.isfinite(frame.depth)
            outside += frame.irradiance[wall].max(axis=1).tolist()
            stops.append(renderer.stops(view))
    lit = np.array(outside) > 1e-3  # W/m²; about 1 W/m² inside
    assert len(lit) > 3000 and lit.mean() < 0.002
    assert max(stops) - min(stops) < 0.1


def test_blotches_of_records_by_coarse_light_are_filtered(ctx: moderngl.Context) -> None:
    """The records' light differs by a fifth from cell to cell. A pixel takes half of its light from the filter, which is smooth.

    No light crosses the edge of the board, and records by the full surface cache stay as they are.
    """
    view = seen(ctx, 0.0)
    with HoleProbes(ctx) as probes, HoleFilling(ctx, SIZE) as filling:
        sites, shape = filling.sites(view.gbuffer, view.empty, view.camera, HoleLight(probes, {})), filling.grid[::-1]
        probes.cache.append(sites, probed(sites))
        blotches = np.random.default_rng(1).choice([-0.2, 0.2], shape).repeat(filling.side, 0).repeat(filling.side, 1)
        E = view.irradiance * (1.0 + blotches[: SIZE[1], : SIZE[0]])
        sums = table_texture(ctx, np.stack([E, E, E, np.ones_like(E)], axis=-1)[::-1])
        records, off = SplatBuffer(sums, sums), []
        for coarse in (False, True):
            found = pixels(filling(view.gbuffer, records, view.camera, HoleLight(probes, {}, coarse)).sums)
            off.append(found[..., 0] / found[..., 3] / view.irradiance - 1.0)
        assert np.abs(off[0]).max() == pytest.approx(0.2, abs=1e-4)
        assert off[1].std() < 0.7 * off[0].std() and np.abs(off[1]).max() < 0.2 + LEAK


def test_probes_hold_while_the_light_does_and_the_oldest_go(ctx: moderngl.Context) -> None:
    """Another light voids all probes; a flight keeps a bounded number of them."""
    place, up = np.zeros((20_000, 3), "f4"), np.tile(np.array([0.0, 1.0, 0.0], "f4"), (20_000, 1))
    with HoleProbes(ctx) as probes:
        light, bounced = object(), object()
        assert probes.follow(light, bounced)
        for number in range(1, 6):
            values = np.full((len(place), 4), 1.0 * number)
            probes.cache.append(Sites(place, up, up), values)
            assert probes.follow(light, bounced) == (number > 1), "the second 20 000 are too many, and so are all later ones"
        held = probes.cache.records.read("radius")["radius"]
        assert len(held) <= 1 << 15 and held[-1] == 5.0 and (np.diff(held) >= 0.0).all()
        assert probes.follow(light, object()) and not probes.cache.count
