"""All bounces: furnaces, radiosity by plain sums, rooms without light, and changes of lights or settings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.buffers import Sites
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.statistics import bounces_notice
from irrsplat.meter.light_meter import LightMeter
from irrsplat.scene.model import Camera, Mesh, Scene
from irrsplat.settings import Settings
from irrsplat.sky.environment import Environment
from irrsplat.surface_cache import site_layout, site_rays, tessellation
from irrsplat.surface_cache.transport import BouncedLight, Transport, sum_bounces
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.worlds import box, material, point_light, polygon_vector, quad, scene, sites

EMITTER = (1.0, 2.0, 3.0)  # W/(m² sr)
ALBEDO = (0.7, 0.5, 0.2)
ALL = {**FAST, "bounces": "all"}
LONG = pytest.mark.long


@contextmanager
def made(ctx: moderngl.Context, world: Scene, **settings: Any) -> Iterator[Renderer]:
    """A renderer with a complete surface cache."""
    with Renderer(world, SIZE, ctx=ctx, **{**ALL, "gather_size": 32, **settings}) as renderer:
        advance(renderer)
        yield renderer


def advance(renderer: Renderer) -> None:
    renderer.frame(gather=False)
    assert renderer.shadows is not None
    assert (
        renderer.scheduler.gatherer.prepare(renderer.shadows, Budget(None)) and renderer.scheduler.gatherer.surface_share == 1.0
    )


def gathered(renderer: Renderer, where: Sites) -> np.ndarray:
    """Return irradiance (N, 3) of records at these sites."""
    assert renderer.shadows is not None and renderer.gbuffer is not None
    renderer.cache.truncate(0)
    renderer.cache.append(where)
    renderer.cache.invalidate()
    renderer.scheduler.refresh(renderer.shadows, renderer.gbuffer, renderer.scene.camera(), Budget(None))
    return renderer.cache.read()["irradiance"]


def values(renderer: Renderer) -> np.ndarray:
    """Return the values (S, 3) of the surface cache."""
    assert renderer.scheduler.gatherer.surface is not None and renderer.scheduler.gatherer.surface.result is not None
    return renderer.scheduler.gatherer.surface.result.irradiance


# ---- references -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "number"), [("trace", "all"), pytest.param("embree", 3, marks=LONG)])
def test_furnace(ctx: moderngl.Context, kind: str, number: int | str) -> None:
    """All surfaces emit L_e and reflect ρ: E_N = π·L_e·Σ ρ^k for k < N, and π·L_e/(1 − ρ) in the limit."""
    paint = material(ALBEDO, EMITTER)
    world = scene(box((-1, -1, -1), (1, 1, 1), paint, outward=False), box((-0.2, -0.9, -0.3), (0.3, 0.1, 0.2), paint))
    where = np.array([[-0.6, -0.999, 0.5], [0.999, 0.4, 0.3], [0.1, 0.101, 0.0], [-0.5, 0.2, 0.6]])
    with Renderer(world, SIZE, ctx=ctx, **{**FAST, "gather_size": 16, "gather": kind, "bounces": number}) as renderer:
        renderer.frame(gather=False)
        assert renderer.shadows is not None
        renderer.scheduler.gatherer.prepare(renderer.shadows, Budget(None))
        E = gathered(renderer, sites(where, [[0, 1, 0], [-1, 0, 0], [0, 1, 0], [1, 0, 0]]))
    rho = np.array(ALBEDO)
    factor = (1.0 if number == "all" else 1.0 - rho ** int(number)) / (1.0 - rho)
    assert np.allclose(E, np.pi * np.array(EMITTER) * factor, rtol=0.01)


@LONG
def test_a_white_room_never_ends(ctx: moderngl.Context) -> None:
    """With ρ = 1 bounces do not decay: after 64 the statistics report that more would follow."""
    white = scene(box((-1, -1, -1), (1, 1, 1), material(1.0), outward=False), lights=(point_light((0.2, 0.4, 0.1), 3.0),))
    with Renderer(white, (12, 10), ctx=ctx, **ALL) as renderer:
        stats = renderer.render().stats
        assert (stats["bounces"], stats["bounces_converged"]) == (64, False)
        assert "after 64 bounces" in (bounces_notice(stats) or "")
        mean = values(renderer)[2:].mean()
        renderer.change(renderer.settings.with_values({"bounces": 3}))
        stats = renderer.render().stats
        assert (stats["bounces"], stats["bounces_converged"]) == (3, None)
        # The light's 4π·3 W reach 24 m² at every bounce: E_direct, and as much with each bounce
        assert mean == pytest.approx(63 * 4 * np.pi * 3.0 / 24.0, rel=0.05)
        assert values(renderer)[2:].mean() == pytest.approx(2 * 4 * np.pi * 3.0 / 24.0, rel=0.1)


@LONG
def test_a_bright_sky_around_a_room_does_not_end_its_bounces(ctx: moderngl.Context) -> None:
    """A closed room with weak emitters has equal bounces under a black sky and under a far brighter map.

    The map lights only the walls' outer sides.
    """
    dark, bright = replace(room(), lights=()), np.full((32, 64, 3), 10.0, np.float32)
    found = []
    for world in (dark, replace(dark, environment=Environment(bright, bright))):
        with Renderer(world, (24, 20), ctx=ctx, **ALL) as renderer:
            found.append(renderer.render())
    black, shone_on = found
    assert black.stats["bounces"] > 8 and abs(shone_on.stats["bounces"] - black.stats["bounces"]) <= 2
    assert shone_on.irradiance.mean() == pytest.approx(black.irradiance.mean(), rel=0.01)


FACES = (  # of a 1 m box open at the top: corner, edges, reflectance, emission
    ((0, 0, 0), (0, 0, 1), (1, 0, 0), (0.8, 0.8, 0.8), 0.0),
    ((0, 0, 0), (0, 1, 0), (0, 0, 1), (0.9, 0.1, 0.1), 0.0),
    ((1, 0, 0), (0, 0, 1), (0, 1, 0), (0.1, 0.9, 0.2), (0.3, 0.6, 0.9)),
    ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0.5, 0.6, 0.9), 0.0),
    ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0.7, 0.7, 0.3), 0.0),
)
SKY = (1.0, 0.8, 0.5)


def radiosity(where: np.ndarray, normal: np.ndarray, number: int, parts: int = 10) -> np.ndarray:
    """Return irradiance (N, 3) after `number` bounces at points in the box, by Lambert's formula over parts² patches per face.

    The sky fills the rest of the hemisphere.
    """
    corners, centres, normals, albedo, emission = [], [], [], [], []
    step = (np.arange(parts)[:, None, None] / parts, np.arange(parts)[None, :, None] / parts)
    for corner, along, across, reflectance, light in FACES:
        u, v = np.array(along) / parts, np.array(across) / parts
        low = corner + parts * (step[0] * u + step[1] * v)
        corners.append(np.stack([low, low + u, low + u + v, low + v], axis=-2).reshape(-1, 4, 3))
        centres.append((low + 0.5 * (u + v)).reshape(-1, 3))
        count = parts * parts
        normals.append(np.tile(np.cross(u, v) * count, (count, 1)))
        albedo.append(np.tile(reflectance, (count, 1)))
        emission.append(np.broadcast_to(light, (count, 3)))
    patches, p, n, rho, L_e = (np.concatenate(x) for x in (corners, centres, normals, albedo, emission))

    def seen(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Return ∫cosθ dω over each patch (N, P); patches in the point's own plane are edge on."""
        facing = np.abs(((patches.mean(1) - points[:, None]) * normal[:, None]).sum(-1)) > 1e-6
        return np.maximum((polygon_vector(patches, points[:, None]) * normal[:, None]).sum(-1), 0.0) * facing

    among, here = seen(p, n), seen(where, normal)
    E = np.zeros_like(p)
    for _ in range(number - 1):
        E = among @ (L_e + rho / np.pi * E) + (np.pi - among.sum(1, keepdims=True)) * SKY
    return here @ (L_e + rho / np.pi * E) + (np.pi - here.sum(1, keepdims=True)) * SKY


@pytest.mark.parametrize(
    ("kind", "number"),
    [("trace", "all"), *(pytest.param(*case, marks=LONG) for case in (("trace", 2), ("trace", 4), ("embree", "all")))],
)
def test_bounces_are_those_of_radiosity(ctx: moderngl.Context, kind: str, number: int | str) -> None:
    """Coloured walls, one of them a source, under a sky: several and all bounces."""
    world = scene(*(quad(corner, u, v, material(rho, light)) for corner, u, v, rho, light in FACES), sky=SKY)
    chance = np.random.default_rng(2).uniform(0.15, 0.85, (12, 2))
    faces = [(np.array(c), np.array(u), np.array(v)) for c, u, v, *_ in FACES * 2]
    where = np.array([c + a * u + b * v for (c, u, v), (a, b) in zip(faces, chance, strict=False)])
    normal = np.array([np.cross(u, v) for _, u, v in faces], float)
    with made(ctx, world, gather=kind, bounces=number) as renderer:
        E = gathered(renderer, sites(where, normal))
    expected = radiosity(where, normal, 60 if number == "all" else int(number))
    assert np.sqrt(np.mean((E - expected) ** 2)) < 0.02 * expected.mean()
    assert np.abs(E.mean(0) / expected.mean(0) - 1.0).max() < 0.015


def rooms(fine: bool) -> Scene:
    """Return two rooms on one floor polygon with a 1 cm wall between them and a light in the left one.

    fine: the floor is of small triangles instead, and the wall stands anywhere on them.
    """
    grey, parts = material(0.7), []
    walls, between = box((-2, 0, -1), (2, 2, 1), grey, outward=False), box((0.132, -0.1, -1.1), (0.142, 2.1, 1.1), grey)
    if fine:
        walls = replace(walls, faces=walls.faces[walls.positions[walls.faces][..., 1].max(1) > 0.0], closed=False)
        x, z = np.meshgrid(np.linspace(-2, 2, 49), np.linspace(-1, 1, 25))
        p = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1).astype("f4")
        number = np.arange(x.size).reshape(x.shape)
        a, b, c, d = (v.ravel() for v in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
        faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype("i4")
        parts.append(Mesh(p, np.tile(np.array([0, 1, 0], "f4"), (len(p), 1)), faces, grey))
    eye = Camera((1.8, 1.8, 0.8), (0.3, 0.0, 0.0), fov=80.0)
    return scene(walls, between, *parts, lights=(point_light((-1, 1.2, 0.2), 5.0),), camera=eye)


@pytest.mark.parametrize(("kind", "fine"), [("trace", False), pytest.param("trace", True, marks=LONG)])
def test_a_room_that_no_light_enters_stays_black(ctx: moderngl.Context, kind: str, fine: bool) -> None:
    chance = np.random.default_rng(1).uniform(0.0, 1.0, (40, 2))
    with made(ctx, rooms(fine), gather=kind, gather_size=16, shadow_size=512) as renderer:
        E = []
        for low, high in ((-1.9, 0.1), (0.16, 1.9)):
            where = np.stack([low + (high - low) * chance[:, 0], np.full(40, 0.002), 1.8 * chance[:, 1] - 0.9], axis=1)
            E.append(gathered(renderer, sites(where, (0, 1, 0))))
        frame = renderer.render()
    assert E[0].min() > 1.0
    assert E[1].mean() < (3e-4 if fine else 2e-4) * E[0].mean()
    assert frame.irradiance.mean() < 3e-4 * E[0].mean() and frame.irradiance.max() < 0.02 * E[0].mean(), (
        "the whole of the dark one"
    )


# ---- sums -------------------------------------------------------------------------------------------------------------


def closed(sizes: int, reflectance: float, seed: int = 0) -> tuple[Transport, np.ndarray]:
    """Return a random scene of mutually visible sites: F and E_1; rows sum to the reflectance."""
    random = np.random.default_rng(seed)
    area, seen = random.uniform(0.5, 2.0, sizes), random.uniform(0.0, 1.0, (sizes, sizes)) ** 8
    form = (seen + seen.T) * area
    transport = by_rows(reflectance * form / form.sum(1, keepdims=True))
    return transport, random.uniform(0.0, 1.0, (sizes, 3)) ** 9


def by_rows(F: np.ndarray) -> Transport:
    """Return a transport equal to F (S, S) in all channels: each site has a ray to each other one."""
    sites = len(F)
    transport = Transport(sites, sites)
    where = np.broadcast_to(np.arange(sites), (sites, sites))
    transport.fill(np.arange(sites), where, np.repeat(F[..., None], 3, axis=2))
    return transport


def dense(transport: Transport) -> np.ndarray:
    """Return the matrices (3, S, S): F of one site alone is a column."""
    units = np.eye(len(transport.known))
    return np.stack([transport(np.repeat(unit[:, None], 3, axis=1)) for unit in units]).transpose(2, 1, 0)


def last(E_1: np.ndarray, transport: Any, bounces: Any = "all") -> BouncedLight:
    found = Budget(None).advance(sum_bounces(E_1, transport, Settings(bounces=bounces)))
    assert found is not None
    return found


@pytest.mark.parametrize("reflectance", [0.2, 0.9, 0.99])
def test_all_bounces_are_the_solution_of_the_equation(reflectance: float) -> None:
    """E = E_1 + F·E.

    A dark site changes no value while two sites light each other, the first initially dark.
    """
    transport, E_1 = closed(50, reflectance)
    E = np.linalg.solve(np.eye(50) - dense(transport)[0], E_1)
    found = last(E_1, transport)
    assert found.converged
    assert np.abs(found.irradiance - E).max() < 0.005 * E.mean()
    pair = by_rows(np.array([[0.0, 0.9, 0.0], [0.9, 0.0, 0.0], [0.0, 0.0, 0.0]], "f4"))
    spread = last(np.outer([0.0, 1.0, 0.0], [1.0] * 3), pair).irradiance
    assert spread[:, 0] == pytest.approx([0.9 / 0.19, 1.0 / 0.19, 0.0], rel=0.01)
    doorway = by_rows(np.array([[0.98, 0.01], [0.01, 0.98]]))  # two rooms, which are not equally bright after 64 bounces
    assert not last(np.outer([1.0, 0.0], [1.0] * 3), doorway).converged


def test_a_tent_on_sunlit_ground_has_all_its_bounces() -> None:
    """E = E_1/(1 - 0.6) in the tent. The ground is brighter, has more sites, and its light ends after a bounce."""
    tent = np.repeat([True, False], [6, 40])
    F = np.where(tent[:, None] & tent, 0.6 / 6, np.where(tent[:, None] | tent, 0.0, 0.02 / 40))
    E_1 = np.outer(np.where(tent, 1.0, 5.0), [1.0] * 3)
    assert last(E_1, by_rows(F)).irradiance[tent] == pytest.approx(1.0 / (1.0 - 0.6), rel=0.05)


def test_a_white_room_has_no_sum_of_all_bounces() -> None:
    """Each of the 64 bounces adds E_1 = 1. Rounding leaves a reflectance of 1 - 10⁻⁷, by which ten million would follow."""
    found = last(np.ones((50, 3)), by_rows(np.full((50, 50), (1.0 - 1e-7) / 50)))
    assert not found.converged and found.irradiance.max() < 64.0


def test_as_many_bounces_as_are_asked_for() -> None:
    transport, E_1 = closed(20, 0.8)
    F = dense(transport)[0].astype(float)
    for number in (2, 3, 7):
        expected = sum(np.linalg.matrix_power(F, k) @ E_1 for k in range(number - 1))
        found = last(E_1, transport if number > 2 else None, number)
        assert np.allclose(found.irradiance, expected, rtol=1e-5) and found.bounces == number
    assert last(np.zeros((20, 3)), transport).bounces == 2, "where there is no light there is nothing to wait for"


# ---- changes ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use a surface cache of few points and rays, to compare it with itself. Its cells do not depend on lights."""
    monkeypatch.setattr(site_layout, "POINTS", (300, 300))
    monkeypatch.setattr(tessellation, "_FINEST", 0)
    monkeypatch.setattr(site_rays, "SIDES", (8, 8))


@pytest.mark.usefixtures("few")
def test_other_lights_come_to_the_values_of_a_fresh_cache(ctx: moderngl.Context) -> None:
    """The values are equal bit for bit; the old values remain in the meantime."""
    moved = [point_light((-0.5, 0.2, 0.5), 5.0), point_light((0.4, 0.3, 0.2), 1.0)]
    with made(ctx, room()) as renderer, made(ctx, replace(room(), lights=tuple(moved))) as other:
        before = values(renderer)
        renderer.relight(moved)
        assert renderer.scheduler.gatherer.surface_share < 1.0 and values(renderer) is before
        advance(renderer)
        assert np.array_equal(values(renderer), values(other))


@pytest.mark.usefixtures("few")
def test_a_lamp_goes_into_a_box_and_comes_out_again(ctx: moderngl.Context) -> None:
    """The box's inside has no sites while it is dark, and is lit when it contains the light."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5), outward=False), box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)))
    places = (0.0, 0.8, 0.0), (0.0, 0.0, 0.0), (0.0, 0.8, 0.0)
    counts: list[int] = []
    with made(ctx, replace(world, lights=(point_light(places[0]),))) as renderer:
        for place in places:
            lit = replace(world, lights=(point_light(place),))
            if counts:
                renderer.relight(lit.lights)
                advance(renderer)
            counts.append(len(values(renderer)))
            with made(ctx, lit) as other:
                assert np.array_equal(values(renderer), values(other))
            within = gathered(renderer, sites([[0.399, 0.1, 0.0], [0.999, 0.1, 0.0]], (-1, 0, 0)))
            assert (within.max(1) > 0.01).tolist() == [place == places[1], place != places[1]]
    assert counts[0] == counts[2] < counts[1]


@pytest.mark.usefixtures("few")
def test_ticks_of_little_time_come_to_the_same(ctx: moderngl.Context) -> None:
    """The values are those of a cache made at once."""
    with Renderer(room(), SIZE, ctx=ctx, **ALL) as small, made(ctx, room(), gather_size=8) as whole:
        shares: list[float] = []
        while small.scheduler.gatherer.surface_share < 1.0 and len(shares) < 3000:
            _, progress = small.frame(seconds=1e-4)
            shares.append(progress.surface)
            assert not progress.done
        assert len(shares) > 1 and shares == sorted(shares)
        assert np.array_equal(values(small), values(whole))


@pytest.mark.usefixtures("few")
def test_records_follow_the_number_of_bounces(ctx: moderngl.Context) -> None:
    """Records of each number of bounces equal those of a new renderer; without bounces they are kept unchanged."""
    with Renderer(room(), SIZE, ctx=ctx, **{**ALL, "bounces": 1}) as renderer:
        one = renderer.render().records_irradiance
        for number in ("all", 2):
            renderer.change(renderer.settings.with_values({"bounces": number}))
            more = renderer.render()
            assert (more.records_irradiance[: len(one)] > one).mean() > 0.9 and more.stats["bounces"] >= 2
            where = renderer.cache.sites(slice(0, len(one)))
            with made(ctx, room(), bounces=number, gather_size=8) as other:
                assert np.array_equal(gathered(other, where), more.records_irradiance[: len(one)])
        edits = renderer.cache.revision
        renderer.change(renderer.settings.with_values({"bounces": 0}))
        assert not renderer.render().irradiance.any()
        renderer.change(renderer.settings.with_values({"bounces": 2}))
        assert np.array_equal(renderer.render().irradiance, more.irradiance) and renderer.cache.revision == edits


@pytest.mark.few_sites
def test_a_scene_of_nothing_another_sky_and_other_rays(ctx: moderngl.Context) -> None:
    """A scene without triangles has no site; another sky, then another seed, give the values of a fresh cache."""
    with Renderer(scene(sky=1.0), (8, 6), ctx=ctx, **ALL) as renderer:
        frame = renderer.render()
        assert not frame.irradiance.any() and frame.stats["bounces_converged"]
    with made(ctx, room(0.5), gather_size=8) as renderer:
        surface = renderer.scheduler.gatherer.surface
        assert surface is not None and not surface.refine(renderer.draw_shadows(), Budget(0.0))
        for other, seed in ((replace(room(), sky_gradient=(0.1, 0.3, 0.0)), 0), (room(0.2), 4)):
            renderer.pose(other)
            renderer.change(replace(renderer.settings, seed=seed))
            assert not surface.refine(renderer.draw_shadows(), Budget(None))
        advance(renderer)
        with made(ctx, other, gather_size=8, seed=seed) as fresh:
            assert np.allclose(values(renderer), values(fresh), rtol=1e-4)


def test_a_lit_ground_ends_no_bounces_in_the_house_on_it() -> None:
    """90 sites keep 0.8 of their light from bounce to bounce, and 10 of a ground in the sun nothing."""
    fade = np.where(np.arange(100) < 90, 0.8, 0.0).astype(np.float32)[:, None]
    found = last(np.ones((100, 3)), lambda term: term * fade)
    assert np.allclose(found.irradiance[:90], 5.0, rtol=0.01)


def test_small_emissive_solids_emit_their_flux_once(ctx: moderngl.Context) -> None:
    """The mean E of a closed room, by its area, is Φ/Σ A·(1 - ρ): 196 emissive boxes of 2 cm below the ceiling.

    The sites of a box's outer sides, whose E is that of the room, must not have the E of its bright inner sides a step away.
    """
    side, albedo, radiance = 0.02, 0.9, 30.0
    bulb = material(albedo, radiance)
    corners = [np.array([x, 2.3, z]) for x in np.linspace(-1.8, 1.7, 14) for z in np.linspace(-1.8, 1.7, 14)]
    bulbs = [box(low, low + side, bulb) for low in corners]
    world = scene(box((-2, 0, -2), (2, 2.6, 2), material(0.8)), *bulbs)
    area, wall = len(bulbs) * 6.0 * side**2, np.array([10.4, 16.0, 10.4])
    expected = np.pi * radiance * area / (2.0 * wall.sum() * 0.2 + area * (1.0 - albedo))
    share = np.stack(np.meshgrid(*[np.linspace(0.05, 0.95, 8)] * 2), -1).reshape(-1, 2)
    points, normals = np.zeros((2, 3, 2, len(share), 3))
    for axis, other in enumerate(((1, 2), (0, 2), (0, 1))):
        points[axis, :, :, other] = share.T[:, None]
        points[axis, 1, :, axis] = 1.0
        normals[axis, :, :, axis] = np.array([[1.0], [-1.0]])
    points = np.array([-2.0, 0.0, -2.0]) + points * np.array([4.0, 2.6, 4.0])
    with LightMeter(world, ctx=ctx, gather_size=16) as meter:
        found = meter.measure(points.reshape(-1, 3), normals.reshape(-1, 3)).total.mean(1).reshape(3, -1).mean(1)
    assert found @ wall / wall.sum() == pytest.approx(expected, rel=0.04)
