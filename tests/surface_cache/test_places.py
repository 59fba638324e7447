"""Gather positions of sites at ray hits, so that narrow gaps emit as much light as they receive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import irrsplat
from irrsplat.core.buffers import HitLight, Sites
from irrsplat.core.vectors import morton_codes, triangle_normals
from irrsplat.gather.hemisphere import gather_records
from irrsplat.gather.record_frame import PLACES
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.paper_scan import read_back
from irrsplat.records.motion import moved_sites
from irrsplat.records.record_cache import RecordCache
from irrsplat.renderer import Renderer
from irrsplat.scene.appearance import in_order
from irrsplat.scene.change import SceneChange
from irrsplat.scene.motion import transformed
from irrsplat.surface_cache import site_layout
from irrsplat.surface_cache.site_layout import COARSE
from irrsplat.surface_cache.site_level import SiteLevel
from irrsplat.surface_cache.site_places import _drawn
from tests.support.viewing import write_room
from tests.support.worlds import box, floor, material, quad, scene

CAMERA = irrsplat.Camera(eye=(0.5, 1.2, 1.8), target=(0.0, 0.9, -2.0), up=(0.0, 1.0, 0.0), fov=70.0)
LIGHT = irrsplat.Light(position=(0.0, 2.3, 0.0), color=(5.0, 5.0, 5.0))


def grooves() -> irrsplat.Scene:
    """Return a closed white room with deep grooves in its rear wall: dark at the bottom, bright on the ridges."""
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
    return irrsplat.make_scene(meshes, [LIGHT], [CAMERA])


def gathered(renderer: Renderer, sites: Sites) -> np.ndarray:
    """Return one-bounce irradiance (N, 3) at these sites, by 32² rays each."""
    with TraceGather(renderer.world, 32) as fine, ReducePass(renderer.ctx, False) as reduce, RecordCache(renderer.ctx) as cache:
        cache.append(sites)
        gather_records(fine, reduce, HitLight(renderer.draw_shadows()), cache, np.arange(len(sites)), seed=0)
        return cache.read()["irradiance"]


@pytest.mark.long
def test_what_rays_see_of_narrow_gaps_is_as_bright_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lookups give a view's surfaces light within 4 % of gathers at the hit points.

    With gathers at the sites alone, more than 6 % and a quarter of the grooves' light would be missing.
    """
    monkeypatch.setattr(site_layout, "POINTS", (1500, 1500))
    with Renderer(grooves(), (48, 36), bounces=2, gather="trace", shadow_size=512) as renderer:
        renderer.frame()
        surface = renderer.scheduler.gatherer.surface_now
        assert surface is not None and surface.level.complete and surface.in_use.shown is not None and surface.result is not None
        seen = read_back(renderer.draw_gbuffer(renderer.scene.camera()))
        eyes = seen.sites(np.nonzero(seen.mask))[::97]
        with TraceGather(renderer.world, 16, hits=True) as gather:
            gather(HitLight(renderer.draw_shadows(), surface.uniforms()), eyes, np.arange(len(eyes)), 0)
            (values, share), (position, normal, triangle) = gather.hits(len(eyes)), gather.met(len(eyes))
            away = position - eyes.position[:, None]
        hit = values >= 0
        upward = triangle_normals(renderer.world.geometry.corners[triangle[hit]])[0].T
        upward[(upward * away[hit]).sum(1) > 0.0] *= -1.0
        places = Sites(position[hit], normal[hit], upward, triangle[hit])
        assert len(places) > 500
        part = share[hit].mean(-1)[:, None]
        true = part * gathered(renderer, places)

        def reflected(E: np.ndarray) -> np.ndarray:
            return part * E[values[hit]]

        E = surface.result.irradiance
        assert reflected(E).sum() == pytest.approx(true.sum(), rel=0.04)
        alone, used = np.zeros_like(E), np.unique(values[hit])
        alone[used] = gathered(renderer, replace(surface.in_use.shown.records.sites(used), frame_rotation=None))
        small = np.ptp(renderer.world.geometry.corners[triangle[hit]], axis=1).max(1) < 3.9  # of the grooves
        assert reflected(alone).sum() < 0.94 * true.sum() and reflected(alone)[small].sum() < 0.75 * true[small].sum()
        assert reflected(E)[small].sum() > 0.82 * true[small].sum()


def test_hits_are_drawn_by_their_weights() -> None:
    """Each hit of a site is drawn in proportion to its weight, give or take one, never with weight 0; -1: no hits."""
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
    """Plain loops give the same codes."""
    at = np.random.default_rng(2).integers(0, 1024, (3, 40))
    codes = [sum((int(at[axis, i]) >> bit & 1) << 3 * bit + axis for bit in range(10) for axis in range(3)) for i in range(40)]
    assert morton_codes(at + 0.5).tolist() == codes


def test_places_ride_along_with_their_triangles() -> None:
    """A box is rotated about its axis and lifted: its positions follow, positions on the floor stay."""
    ground, block = floor(), box((-0.5, 0.0, -0.5), (0.5, 1.0, 0.5))
    matrix = np.array([[0.0, -1.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
    before = scene(ground, block)
    change = SceneChange.between(before, scene(ground, transformed(block, matrix)))
    corners = np.concatenate([mesh.positions[mesh.faces] for mesh in in_order(before)])
    middle, normal = corners.mean(1), triangle_normals(corners)[0].T
    moved = moved_sites(Sites(middle, normal, -normal, np.arange(len(corners))), change)
    on_block = np.repeat([mesh is block for mesh in in_order(before)], [len(mesh.faces) for mesh in in_order(before)])
    linear = matrix[:3, :3]
    assert np.allclose(moved.position[on_block], middle[on_block] @ linear.T + matrix[:3, 3], atol=1e-5)
    assert np.allclose(moved.normal[on_block], normal[on_block] @ linear.T, atol=1e-5)
    assert np.allclose(moved.geometric[on_block], -normal[on_block] @ linear.T, atol=1e-5)
    assert np.array_equal(moved.position[~on_block], middle[~on_block]) and on_block.sum() == 12


@pytest.mark.long
def test_a_further_refinement_brings_lookups_nearer_to_gathers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a view of a room with two bounces, refinement reduces the error of E_1 by lookup against E_1 by 64² rays."""
    monkeypatch.setattr(site_layout, "POINTS", (150, 150))
    with Renderer(irrsplat.load(write_room(tmp_path)), (48, 36), bounces=2, gather="trace", shadow_size=256) as renderer:
        renderer.frame()
        surface, shadows = renderer.scheduler.gatherer.surface_now, renderer.draw_shadows()
        assert surface is not None and surface.level.complete and surface.result is not None
        seen = read_back(renderer.draw_gbuffer(renderer.scene.camera()))
        sites: Sites = seen.sites(np.nonzero(seen.mask))[::5]
        with (
            TraceGather(renderer.world, 64) as fine,
            ReducePass(renderer.ctx, False) as reduce,
            RecordCache(renderer.ctx) as cache,
        ):
            cache.append(sites)
            gather_records(fine, reduce, HitLight(shadows), cache, np.arange(cache.count), seed=0)
            true = cache.read()["irradiance"]

        def off() -> float:
            return float(np.sqrt(np.mean((surface.at(sites) - true) ** 2)) / true.mean())

        errors, counts = [off()], [len(surface.result.irradiance)]
        for _ in range(2):
            while not surface.refine(shadows, Budget(1e-3)):
                pass
            errors.append(off())
            counts.append(len(surface.result.irradiance))
        assert counts[0] < 0.8 * counts[1] and counts[1] < 0.8 * counts[2]
        assert errors[1] < 0.9 * errors[0] and errors[2] < 0.75 * errors[0], errors
        renderer.relight([])
        assert surface.refinements == 0 and len(surface.result.irradiance) == counts[0]


def test_light_behind_a_lamp_stays_there() -> None:
    """A panel emits as much into the millimetre between it and the ceiling as into the room.

    The light of one side, Φ, gives walls of reflectance ρ and area S the mean irradiance Φ/(S·(1 - ρ)). That of the view is a
    fifth above it.
    """
    room = box((0, 0, 0), (4, 3, 5), material(0.6), outward=False)
    panel = quad((1.95, 2.999, 2.45), (0.1, 0, 0), (0, 0, 0.1), material(0.5, 1000.0))
    view = irrsplat.Camera((3.7, 1.8, 4.8), (1.5, 0.8, 1.0), fov=65.0)
    found = irrsplat.render(scene(room, panel, camera=view), (32, 24), samples=1).irradiance.mean()
    assert found == pytest.approx(np.pi * 1000.0 * 0.01 / (94.0 * (1.0 - 0.6)), rel=0.3)


def test_a_panel_below_a_ceiling_lights_the_room_as_with_more_sites(monkeypatch: pytest.MonkeyPatch) -> None:
    """With sixteen times the points, the floor's light differs by less than 1 % in the mean of two seeds.

    The ceiling is bright above the panel and dark elsewhere. Cells longer than the gap of 33 cm carry light from one part to the
    other, where the room sees it: without short steps the floor is 1.4 and 4.5 % too bright.
    """
    w, h, d, t, grey = 8.0, 4.0, 6.0, 0.2, material(0.6)
    slabs = [box((-t, y, -t), (w + t, y + t, d + t), grey) for y in (-t, h)]
    slabs += [box((-t, 0, z), (w + t, h, z + t), grey) for z in (-t, d)] + [box((x, 0, 0), (x + t, h, d), grey) for x in (-t, w)]
    panel = box((4.8, 3.65, 1.0), (5.8, 3.67, 2.0), material(0.5, 5.0))
    room = scene(*slabs, panel, camera=irrsplat.Camera((7.5, 1.8, 5.5), (4.0, 1.0, 2.5), fov=70.0))
    found = []
    for _ in range(2):
        views = [irrsplat.render(room, (32, 24), samples=1, seed=seed) for seed in (0, 3)]
        found.append(np.mean([view.irradiance[16:].mean() for view in views]))
        monkeypatch.setattr(site_layout, "POINTS", (32_000, 32_000))
    assert found[0] == pytest.approx(found[1], rel=0.01)


def test_a_coarse_level_keeps_the_light_of_a_bulb_below_a_ceiling() -> None:
    """The mean irradiance of the walls of a closed room is Φ/(S·(1 - ρ)).

    Half of the flux Φ falls on a few decimetres of the ceiling. Without short steps, a cell is half a metre wide, and the mean is
    a fifth too low. About 35 rays hit the bright place in all, so that three seeds have a standard error of about 5 %.
    """
    side, radiance, low = 0.04, 1000.0, np.array([0.5, 2.51, -0.3])
    room, bulb = box((-2, 0, -2), (2, 2.6, 2), material(0.8), outward=False), material(0.5, radiance)
    world, found = scene(room, box(low, low + side, bulb)), []
    for seed in range(3):
        with Renderer(world, (16, 12), seed=seed) as renderer, SiteLevel(renderer.world, renderer.settings, COARSE) as level:
            shadows = renderer.draw_shadows()
            while not level.make(shadows, Budget(None)):
                pass
            held = level.shown
            assert held is not None and held.light is not None
            E, area, at = held.light.irradiance.mean(1), held.area, held.records.read()["position"]
        on_walls = (np.abs(at - low) > 0.05).any(1) & (area > 0.0)
        found.append(np.average(E[on_walls], weights=area[on_walls]))
    assert np.mean(found) == pytest.approx(np.pi * radiance * 6.0 * side**2 / (73.6 * (1.0 - 0.8)), rel=0.1)
