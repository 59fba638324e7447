"""Sites look from places that rays meet, so that narrow gaps send on as much light as they receive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import moderngl
import numpy as np
import pytest
import trimesh

import irrsplat
from irrsplat.core.buffers import HitLight, Sites
from irrsplat.core.vectors import morton_codes, triangle_normals
from irrsplat.gather.look import gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu import context
from irrsplat.indirect.paper_scan import read_back
from irrsplat.records.record_cache import RecordCache
from irrsplat.renderer import Renderer
from irrsplat.scene.change import SceneChange
from irrsplat.scene.looks import in_order
from irrsplat.scene.motion import transformed
from irrsplat.surface_cache import site_layout
from irrsplat.surface_cache.site_places import PLACES, Places, _drawn
from tests.support.worlds import box, floor, scene

CAMERA = irrsplat.Camera(eye=(0.5, 1.2, 1.8), target=(0.0, 0.9, -2.0), up=(0.0, 1.0, 0.0), fov=70.0)
LAMP = irrsplat.Light(position=(0.0, 2.3, 0.0), color=(5.0, 5.0, 5.0))


def grooves() -> irrsplat.Scene:
    """A closed white room whose rear wall has deep grooves: dark at their bottom, bright on what sticks out between them."""
    white = irrsplat.Material(albedo=(0.7, 0.7, 0.7))
    room = trimesh.creation.box(bounds=[(-2.0, 0.0, -2.0), (2.0, 2.5, 2.0)])
    room.invert()
    things = []
    for y in np.arange(0.1, 2.4, 0.12):
        things.append(trimesh.creation.box(bounds=[(-1.9, y, -1.99), (1.9, y + 0.06, -1.9)]))
        things.append(trimesh.creation.box(bounds=[(-1.9, y + 0.06, -1.99), (1.9, y + 0.12, -1.97)]))
    vertices = np.concatenate([one.vertices for one in things])
    faces = np.concatenate([one.faces + 8 * number for number, one in enumerate(things)])
    meshes = [irrsplat.make_mesh(room.vertices, room.faces, white), irrsplat.make_mesh(vertices, faces, white)]
    return irrsplat.make_scene(meshes, [LAMP], [CAMERA])


@pytest.fixture(scope="module")
def made() -> Iterator[Renderer]:
    """That room, with a complete surface cache of one bounce."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(site_layout, "POINTS", (1500, 1500))
        with Renderer(grooves(), (48, 36), bounces=2, gather="trace", shadow_size=512) as renderer:
            renderer.frame()
            yield renderer


@pytest.fixture
def room(made: Renderer) -> Renderer:
    """The same, its context the current one."""
    context.make_current(made.ctx)
    return made


def gathered(renderer: Renderer, sites: Sites) -> np.ndarray:
    """(N, 3) irradiance of one bounce at these sites, by 32² rays each from themselves."""
    with TraceGather(renderer.world, 32) as fine, ReducePass(renderer.ctx, False) as reduce, RecordCache(renderer.ctx) as cache:
        cache.append(sites)
        gather_records(fine, reduce, HitLight(renderer.draw_shadows()), cache, np.arange(len(sites)), seed=0)
        return cache.read()["irradiance"]


def test_what_rays_see_of_narrow_gaps_is_as_bright_as_it_is(room: Renderer) -> None:
    """The light that a view's surfaces receive: by what the surface cache says where rays meet others, within 4 % of what
    gathers there say. From where sites lie, more than 6 % would be lacking, and a
    quarter of the light of the grooves."""
    surface = room.scheduler.gatherer.surface_now
    assert surface is not None and surface.complete and surface.records is not None and surface.result is not None
    seen = read_back(room.draw_gbuffer(room.scene.camera()))
    eyes = seen.sites(np.nonzero(seen.mask))[::97]
    with TraceGather(room.world, 16, surface=True, hits=True, met=True) as gather:
        gather(HitLight(room.draw_shadows(), surface.uniforms()), eyes, np.arange(len(eyes)), 0)
        (values, weights, albedo), (position, normal, triangle) = gather.hits(len(eyes)), gather.met(len(eyes))
        away = position - eyes.position[:, None]
        share = np.broadcast_to(gather.share.ravel(), albedo.shape[:2])
    hit = weights.any(-1)
    upward = triangle_normals(room.world.geometry.corners[triangle[hit]])[0].T
    upward[(upward * away[hit]).sum(1) > 0.0] *= -1.0
    places = Sites(position[hit], normal[hit], upward, triangle[hit])
    assert len(places) > 500
    part = (share[hit] * albedo[hit].mean(-1))[:, None]
    true = part * gathered(room, places)

    def said(E: np.ndarray) -> np.ndarray:
        return part * (weights[hit][..., None] * E[values[hit]]).sum(1)

    E = surface.result.irradiance
    assert said(E).sum() == pytest.approx(true.sum(), rel=0.04)
    alone, used = np.zeros_like(E), np.unique(values[hit])
    alone[used] = gathered(room, replace(surface.records.sites(used), frame_rotation=None))
    small = np.ptp(room.world.geometry.corners[triangle[hit]], axis=1).max(1) < 3.9  # of the grooves
    assert said(alone).sum() < 0.94 * true.sum() and said(alone)[small].sum() < 0.75 * true[small].sum()
    assert said(E)[small].sum() > 0.82 * true[small].sum()


def test_places_lie_on_what_their_site_speaks_for(room: Renderer) -> None:
    """Each lies on its triangle, its normals are of the side that was met, and others are near its site."""
    surface = room.scheduler.gatherer.surface_now
    assert surface is not None
    laid_out = surface._laid_out
    assert laid_out is not None and laid_out.places is not None
    count = laid_out.records.count
    sites, places = laid_out.records.sites(slice(0, count)), laid_out.places.sites
    assert len(places) == PLACES * count and places.triangle is not None
    normal, _ = triangle_normals(room.world.geometry.corners[places.triangle])
    height = ((places.position - room.world.geometry.corners[places.triangle, 0]) * normal.T).sum(1)
    looked = slice(PLACES * site_layout.FIRST_SITE, None)
    assert np.abs(height[looked]).max() < 1e-3
    assert np.allclose(np.abs((places.geometric * normal.T).sum(1))[looked], 1.0, atol=1e-4)
    assert ((places.normal * places.geometric).sum(1)[looked] > 0.5).all()
    spread = np.linalg.norm(places.position - np.repeat(sites.position, PLACES, axis=0), axis=1)[looked]
    assert np.median(spread) > 0.01 and np.quantile(spread, 0.99) < 1.0


def test_hits_are_drawn_by_their_weights() -> None:
    """Of a site's hits each comes in by its share, give or take one, and those of weight 0 never; -1: there are none."""
    rng = np.random.default_rng(3)
    sites, weight = rng.integers(0, 5, 60), rng.random(60)
    sites[sites == 3], weight[::7] = 4, 0.0
    position = rng.random((60, 3))
    drawn = _drawn(sites, weight, position, 6, seed=1).reshape(6, PLACES)
    assert (drawn[[3, 5]] == -1).all()
    for site in (0, 1, 2, 4):
        assert (sites[drawn[site]] == site).all()
        times = np.bincount(drawn[site], minlength=60)
        expected = PLACES * np.where(sites == site, weight, 0.0) / weight[sites == site].sum()
        assert (np.abs(times - expected) < 1.0).all() and not times[weight == 0.0].any()
    means = np.mean(
        [np.bincount(_drawn(sites, weight, position, 6, seed=seed).reshape(6, PLACES)[0], minlength=60) for seed in range(400)], 0
    )
    expected = PLACES * np.where(sites == 0, weight, 0.0) / weight[sites == 0].sum()
    assert np.abs(means - expected).max() < 0.1


def test_codes_have_the_bits_of_coordinates_in_turn() -> None:
    """By plain loops."""
    at = np.random.default_rng(2).integers(0, 1024, (3, 40))
    codes = [sum((int(at[axis, i]) >> bit & 1) << 3 * bit + axis for bit in range(10) for axis in range(3)) for i in range(40)]
    assert morton_codes(at + 0.5).tolist() == codes


def test_all_parts_of_a_site_come_in_by_their_shares() -> None:
    """Of 1000 hits along a line of 1 m the drawn ones lie about an eighth of it apart."""
    position = np.zeros((1000, 3))
    position[:, 2] = np.random.default_rng(5).random(1000)
    for seed in range(20):
        drawn = np.sort(position[_drawn(np.zeros(1000, np.intp), np.ones(1000), position, 1, seed), 2])
        assert np.abs(np.diff(drawn) - 1.0 / PLACES).max() < 0.05


def test_places_of_chosen_sites_stay() -> None:
    """What `onto` and `of` take is the rows of these sites."""

    def alike(count: int, value: float) -> Places:
        column = np.full((PLACES * count, 3), value, np.float32)
        return Places(Sites(column, column, column, np.full(PLACES * count, int(value))))

    both = alike(3, 1.0).onto(alike(5, 2.0), np.array([0, 2]))
    assert both.sites.position[::PLACES, 0].tolist() == [1.0, 2.0, 1.0, 2.0, 2.0]
    assert both.sites.triangle is not None and both.sites.triangle[::PLACES].tolist() == [1, 2, 1, 2, 2]
    of = both.of(np.array([2, 4]))
    assert of.position[:, 0].tolist() == [1.0] * PLACES + [2.0] * PLACES
    assert of.frame_rotation is not None and of.frame_rotation.tolist() == [*range(16, 24), *range(32, 40)]


def test_places_ride_along_with_their_triangles() -> None:
    """On a box that is turned about its axis and lifted; those on the floor stay."""
    ground, block = floor(), box((-0.5, 0.0, -0.5), (0.5, 1.0, 0.5))
    matrix = np.array([[0.0, -1.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
    before = scene(ground, block)
    change = SceneChange.between(before, scene(ground, transformed(block, matrix)))
    corners = np.concatenate([mesh.positions[mesh.faces] for mesh in in_order(before)])
    middle, normal = corners.mean(1), triangle_normals(corners)[0].T
    moved = Places(Sites(middle, normal, -normal, np.arange(len(corners)))).moved(change).sites
    on_block = np.repeat([mesh is block for mesh in in_order(before)], [len(mesh.faces) for mesh in in_order(before)])
    linear = matrix[:3, :3]
    assert np.allclose(moved.position[on_block], middle[on_block] @ linear.T + matrix[:3, 3], atol=1e-5)
    assert np.allclose(moved.normal[on_block], normal[on_block] @ linear.T, atol=1e-5)
    assert np.allclose(moved.geometric[on_block], -normal[on_block] @ linear.T, atol=1e-5)
    assert np.array_equal(moved.position[~on_block], middle[~on_block]) and on_block.sum() == 12


@pytest.mark.parametrize("light_samples", [0, 64])
def test_a_gather_from_places_is_made_of_gathers_from_each(ctx: moderngl.Context, light_samples: int) -> None:
    """Texel by texel each of 8 places has its turn: the same bits as in a gather from that place alone. From 8 times the same
    place, the sums are those of one; from 8 others, about the mean of theirs: a panel shines, which few of the rays find."""
    panel = irrsplat.Material(albedo=(0.0, 0.0, 0.0), emission=(4.0, 3.0, 2.0))
    lamp = irrsplat.make_mesh(
        [(-0.5, 2.4, -0.5), (0.5, 2.4, -0.5), (0.5, 2.4, 0.5), (-0.5, 2.4, 0.5)], [(0, 1, 2), (0, 2, 3)], panel
    )
    room = grooves()
    with Renderer(
        irrsplat.make_scene([*room.meshes, lamp], cameras=room.cameras),
        (48, 36),
        bounces=1,
        gather="trace",
        shadow_size=256,
        ctx=ctx,
    ) as renderer:
        light = HitLight(renderer.draw_shadows())
        seen = read_back(renderer.draw_gbuffer(room.camera()))
        sites: Sites = replace(seen.sites(np.nonzero(seen.mask))[::50], frame_rotation=None)
        count = len(sites) // PLACES * PLACES
        sites = replace(sites[np.arange(count)], frame_rotation=np.arange(count))
        numbers = np.arange(count // PLACES)
        with (
            TraceGather(renderer.world, 16, 128, places=PLACES, light_samples=light_samples) as many,
            TraceGather(renderer.world, 16, 128, light_samples=light_samples) as one,
            ReducePass(ctx, False, PLACES) as sums_of_many,
            ReducePass(ctx, False) as sums_of_one,
            RecordCache(ctx) as cache,
        ):
            radiance = cells(many(light, sites, np.repeat(numbers, PLACES), 0).radiance.read(), many, len(numbers))
            each = cells(one(light, sites, np.arange(count), 0).radiance.read(), one, count)
            each = each.reshape(len(numbers), PLACES, -1, 4)
            turns = each[:, many.places_of_texels, np.arange(each.shape[2])]
            assert radiance.any() and np.array_equal(radiance, turns)

            same = sites[np.repeat(PLACES * numbers, PLACES)]
            cache.append(sites[PLACES * numbers])
            gather_records(many, sums_of_many, light, cache, numbers, 0, where=lambda rows: sites)
            together = cache.read()["irradiance"]
            with RecordCache(ctx) as apart:
                apart.append(sites)
                gather_records(one, sums_of_one, light, apart, np.arange(count), 0)
                mean = apart.read()["irradiance"].reshape(-1, PLACES, 3).mean(1)
            assert np.sqrt(np.mean((together - mean) ** 2)) < (0.05 if light_samples else 0.5) * mean.mean()

            gather_records(many, sums_of_many, light, cache, numbers, 0, where=lambda rows: same)
            E = cache.read()["irradiance"]
            gather_records(one, sums_of_one, light, cache, numbers, 0, where=lambda rows: sites[PLACES * numbers])
            assert E.any() and np.array_equal(E, cache.read()["irradiance"])


def cells(data: bytes, gather: TraceGather, count: int) -> np.ndarray:
    """(count, R, 4) the first cells of an atlas."""
    width, height = gather.cell
    values = np.frombuffer(data, "f4").reshape(-1, height, gather.columns, width, 4)
    return values.swapaxes(1, 2).reshape(-1, width * height, 4)[:count]


def test_rays_are_gathered_from_places(room: Renderer) -> None:
    """The gathers of a surface cache look from places, its survey from the sites themselves."""
    surface = room.scheduler.gatherer.surface_now
    assert surface is not None
    rays = surface._rays
    assert rays.gather_for(100).places == rays.finer_gather(100).places == rays.linking_gather(100).places == PLACES
    assert rays.survey_gather().places == 1
