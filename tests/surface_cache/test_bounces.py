"""All bounces: furnaces, radiosity by plain sums, rooms that no light enters, and what a change of lights or settings does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.core.buffers import Sites
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.gathering import record_gatherer
from irrsplat.scene.model import Mesh, Scene
from irrsplat.sky.environment import Environment
from irrsplat.surface_cache import site_layout, site_rays
from irrsplat.surface_cache.transport import CONVERGED, BouncedLight, Transport, sum_bounces
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.worlds import Camera, box, lamp, material, polygon_vector, quad, scene, sites

EMITTER = (1.0, 2.0, 3.0)  # W/(m² sr)
ALBEDO = (0.7, 0.5, 0.2)
ALL = {**FAST, "bounces": "all"}
KINDS = ("raster", "trace")


@contextmanager
def made(ctx: moderngl.Context, world: Scene, **settings: Any) -> Iterator[Renderer]:
    """A renderer whose surface cache is whole."""
    with Renderer(world, SIZE, ctx=ctx, **{**ALL, "gather_size": 32, **settings}) as renderer:
        advance(renderer)
        yield renderer


def advance(renderer: Renderer) -> None:
    renderer.frame(gather=False)
    assert renderer.shadows is not None
    assert renderer.scheduler.prepare(renderer.shadows, Budget(None)) and renderer.scheduler.gatherer.surface_share == 1.0


def gathered(renderer: Renderer, where: Sites) -> np.ndarray:
    """(N, 3): E of records at these places."""
    assert renderer.shadows is not None
    renderer.cache.truncate(0)
    renderer.cache.append(where)
    renderer.cache.invalidate()
    renderer.scheduler.renew(renderer.shadows, renderer.gbuffer, renderer.scene.camera(), Budget(None))
    return renderer.cache.read()["irradiance"]


def values(renderer: Renderer) -> np.ndarray:
    """What the surface cache holds, (S, 3)."""
    assert renderer.scheduler.gatherer.surface is not None and renderer.scheduler.gatherer.surface.result is not None
    return renderer.scheduler.gatherer.surface.result.irradiance


# ---- truths -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("number", [1, 2, 3, 5, "all"])
def test_furnace(ctx: moderngl.Context, kind: str, number: int | str) -> None:
    """Where all surfaces emit L_e and reflect ρ, a bounce brings ρ times the one before: E_N = π·L_e·Σ ρ^k for k < N, and
    π·L_e/(1 − ρ) in the end."""
    paint = material(ALBEDO, EMITTER)
    world = scene(box((-1, -1, -1), (1, 1, 1), paint, outward=False), box((-0.2, -0.9, -0.3), (0.3, 0.1, 0.2), paint))
    where = np.array([[-0.6, -0.999, 0.5], [0.999, 0.4, 0.3], [0.1, 0.101, 0.0], [-0.5, 0.2, 0.6]])
    with Renderer(world, SIZE, ctx=ctx, **{**FAST, "gather_size": 16, "gather": kind, "bounces": number}) as renderer:
        renderer.frame(gather=False)
        assert renderer.shadows is not None
        renderer.scheduler.prepare(renderer.shadows, Budget(None))
        E = gathered(renderer, sites(where, [[0, 1, 0], [-1, 0, 0], [0, 1, 0], [1, 0, 0]]))
    rho = np.array(ALBEDO)
    factor = 1.0 / (1.0 - rho) if number == "all" else (1.0 - rho**number) / (1.0 - rho)  # type: ignore[operator]
    assert np.allclose(E, np.pi * np.array(EMITTER) * factor, rtol=0.01)


@pytest.mark.all_sites
def test_a_white_room_never_ends(ctx: moderngl.Context) -> None:
    """With ρ = 1 no bounce is weaker than the one before: after 64 the statistics say that there is more to come."""
    white = scene(box((-1, -1, -1), (1, 1, 1), material(1.0), outward=False), lights=(lamp((0.2, 0.4, 0.1), 3.0),))
    with Renderer(white, (12, 10), ctx=ctx, **ALL) as renderer:
        stats = renderer.render().stats
        assert (stats["bounces"], stats["bounces_converged"]) == (64, False)
        mean = values(renderer)[2:].mean()
        renderer.change(renderer.settings.with_values({"bounces": 3}))
        stats = renderer.render().stats
        assert (stats["bounces"], stats["bounces_converged"]) == (3, None)
        # the lamp's 4π·3 W fall on 24 m² again and again: E_direct, and as much with each bounce
        assert mean == pytest.approx(63 * 4 * np.pi * 3.0 / 24.0, rel=0.05)
        assert values(renderer)[2:].mean() == pytest.approx(2 * 4 * np.pi * 3.0 / 24.0, rel=0.1)


def test_a_bright_sky_around_a_room_does_not_end_its_bounces(ctx: moderngl.Context) -> None:
    """Of a closed room that glows a little inside, all bounces are the same under a black sky, and under a map far brighter than
    anything inside, which shines on the walls' outer sides alone."""
    dark, bright = replace(room(), lights=()), np.full((32, 64, 3), 10.0, np.float32)
    found = []
    for world in (dark, replace(dark, environment=Environment(bright, bright))):
        with Renderer(world, (24, 20), ctx=ctx, **ALL) as renderer:
            found.append(renderer.render())
    black, shone_on = found
    assert black.stats["bounces"] > 8 and abs(shone_on.stats["bounces"] - black.stats["bounces"]) <= 2
    assert shone_on.irradiance.mean() == pytest.approx(black.irradiance.mean(), rel=0.01)


FACES = (  # of a box of 1 m that is open above: corner, edges, reflectance, emission
    ((0, 0, 0), (0, 0, 1), (1, 0, 0), (0.8, 0.8, 0.8), 0.0),
    ((0, 0, 0), (0, 1, 0), (0, 0, 1), (0.9, 0.1, 0.1), 0.0),
    ((1, 0, 0), (0, 0, 1), (0, 1, 0), (0.1, 0.9, 0.2), (0.3, 0.6, 0.9)),
    ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0.5, 0.6, 0.9), 0.0),
    ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0.7, 0.7, 0.3), 0.0),
)
SKY = (1.0, 0.8, 0.5)


def radiosity(where: np.ndarray, normal: np.ndarray, number: int, parts: int = 10) -> np.ndarray:
    """(N, 3): E after `number` bounces at points in the box, by sums over parts² patches a face and Lambert's formula.

    What all patches leave open of the hemisphere is sky.
    """
    corners, centres, normals, albedo, emission = [], [], [], [], []
    step = (np.arange(parts)[:, None, None] / parts, np.arange(parts)[None, :, None] / parts)
    for corner, u, v, rho, light in FACES:
        low = corner + step[0] * np.array(u) + step[1] * np.array(v)
        u, v = np.array(u) / parts, np.array(v) / parts
        corners.append(np.stack([low, low + u, low + u + v, low + v], axis=-2).reshape(-1, 4, 3))
        centres.append((low + 0.5 * (u + v)).reshape(-1, 3))
        count = parts * parts
        normals.append(np.tile(np.cross(u, v) * count, (count, 1)))
        albedo.append(np.tile(rho, (count, 1)))
        emission.append(np.broadcast_to(light, (count, 3)))
    patches, p, n, rho, L_e = (np.concatenate(x) for x in (corners, centres, normals, albedo, emission))

    def seen(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(N, P): ∫cosθ dω over each patch; those in the point's own plane are seen edge on."""
        facing = np.abs(((patches.mean(1) - points[:, None]) * normal[:, None]).sum(-1)) > 1e-6
        return np.maximum((polygon_vector(patches, points[:, None]) * normal[:, None]).sum(-1), 0.0) * facing

    among, here = seen(p, n), seen(where, normal)
    E = np.zeros_like(p)
    for _ in range(number - 1):
        E = among @ (L_e + rho / np.pi * E) + (np.pi - among.sum(1, keepdims=True)) * SKY
    return here @ (L_e + rho / np.pi * E) + (np.pi - here.sum(1, keepdims=True)) * SKY


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_bounces_are_those_of_radiosity(ctx: moderngl.Context, kind: str) -> None:
    """Coloured walls, one of which shines, under a sky: two, four and all bounces."""
    world = scene(*(quad(corner, u, v, material(rho, light)) for corner, u, v, rho, light in FACES), sky=SKY)
    chance = np.random.default_rng(2).uniform(0.15, 0.85, (12, 2))
    where = np.array(
        [np.add(c, a * np.array(u) + b * np.array(v)) for (c, u, v, *_), (a, b) in zip(FACES * 2, chance, strict=False)]
    )
    normal = np.array([np.cross(u, v) for _, u, v, *_ in FACES * 2], float)
    for number in (2, 4, "all"):
        with made(ctx, world, gather=kind, bounces=number) as renderer:
            E = gathered(renderer, sites(where, normal))
        expected = radiosity(where, normal, 60 if number == "all" else int(number))
        assert np.sqrt(np.mean((E - expected) ** 2)) < 0.02 * expected.mean(), number
        assert np.abs(E.mean(0) / expected.mean(0) - 1.0).max() < 0.015, number


def rooms(fine: bool) -> Scene:
    """Two rooms on one floor polygon, a wall of 1 cm between them, and a lamp in the left one; fine: a floor of small triangles
    lies on it, and the wall stands anywhere on them."""
    grey, parts = material(0.7), []
    if fine:
        x, z = np.meshgrid(np.linspace(-2, 2, 49), np.linspace(-1, 1, 25))
        p = np.stack([x.ravel(), np.full(x.size, 1e-3), z.ravel()], axis=1).astype("f4")
        number = np.arange(x.size).reshape(x.shape)
        a, b, c, d = (v.ravel() for v in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
        faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype("i4")
        parts.append(Mesh(p, np.tile(np.array([0, 1, 0], "f4"), (len(p), 1)), faces, grey))
    walls, between = box((-2, 0, -1), (2, 2, 1), grey, outward=False), box((0.132, -0.1, -1.1), (0.142, 2.1, 1.1), grey)
    eye = Camera((1.8, 1.8, 0.8), (0.3, 0.0, 0.0), fov=80.0)
    return scene(walls, between, *parts, lights=(lamp((-1, 1.2, 0.2), 5.0),), camera=eye)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fine", [False, True])
def test_a_room_that_no_light_enters_stays_black(ctx: moderngl.Context, kind: str, fine: bool) -> None:
    chance = np.random.default_rng(1).uniform(0.0, 1.0, (40, 2))
    with made(ctx, rooms(fine), gather=kind, gather_size=16, shadow_size=512) as renderer:
        E = []
        for low, high in ((-1.9, 0.1), (0.16, 1.9)):
            where = np.stack([low + (high - low) * chance[:, 0], np.full(40, 0.002), 1.8 * chance[:, 1] - 0.9], axis=1)
            E.append(gathered(renderer, sites(where, (0, 1, 0))))
        frame = renderer.render()
    assert E[0].min() > 1.0
    assert E[1].mean() < 2e-4 * E[0].mean()
    assert frame.irradiance.mean() < 2e-4 * E[0].mean() and frame.irradiance.max() < 0.02 * E[0].mean(), (
        "the whole of the dark one"
    )


# ---- sums -------------------------------------------------------------------------------------------------------------


def closed(sizes: int, reflectance: float, seed: int = 0) -> tuple[Transport, np.ndarray, np.ndarray]:
    """A made-up scene of sites that see each other by lot: F, E_1 and areas; rows sum to the reflectance."""
    random = np.random.default_rng(seed)
    area, seen = random.uniform(0.5, 2.0, sizes), random.uniform(0.0, 1.0, (sizes, sizes)) ** 8
    form = (seen + seen.T) * area
    transport = by_rows(reflectance * form / form.sum(1, keepdims=True))
    return transport, random.uniform(0.0, 1.0, (sizes, 3)) ** 9, area


def by_rows(F: np.ndarray) -> Transport:
    """A transport that is F (S, S) in all channels: each site has a ray to each other."""
    sites = len(F)
    transport = Transport(sites, sites)
    where = np.broadcast_to(np.arange(sites)[:, None], (sites, sites, 3))
    transport.fill(
        np.arange(sites), np.pi * np.ones((sites, sites)), (where, F[..., None] * [1, 0, 0], np.ones((sites, sites, 3)))
    )
    return transport


def dense(transport: Transport) -> np.ndarray:
    """(3, S, S)."""
    return np.stack([matrix.toarray() for matrix in transport.matrices])


def last(*arguments: Any) -> BouncedLight:
    return list(sum_bounces(*arguments))[-1]


@pytest.mark.parametrize("reflectance", [0.2, 0.7, 0.9])
def test_all_bounces_are_the_solution_of_the_equation(reflectance: float) -> None:
    """E = E_1 + F·E; and what is said to be still to come without the last sum's estimate is about what is."""
    transport, E_1, area = closed(50, reflectance)
    E = np.linalg.solve(np.eye(50) - dense(transport)[0], E_1)
    found = last(E_1, transport, area, 64, True)
    assert found.converged and found.remaining is not None and found.remaining < CONVERGED
    assert np.abs(found.irradiance - E).max() < 0.005 * E.mean()
    upto = last(E_1, transport, area, found.bounces, False)
    gathered = E_1 + transport(upto.irradiance)  # as a record adds the last bounce
    assert found.remaining == pytest.approx(float((area @ ((E - gathered) / E) / area.sum()).max()), rel=0.2)


def test_as_many_bounces_as_are_asked_for() -> None:
    transport, E_1, area = closed(20, 0.8)
    F = dense(transport)[0].astype(float)
    for number in (2, 3, 7):
        expected = sum(np.linalg.matrix_power(F, k) @ E_1 for k in range(number - 1))
        found = list(sum_bounces(E_1, transport if number > 2 else None, area, number, False))
        assert np.allclose(found[-1].irradiance, expected, rtol=1e-5)
        assert [f.bounces for f in found] == list(range(2, number + 1)) and [f.complete for f in found][-1:] == [True]
    assert last(np.zeros((20, 3)), transport, area, 64, True).bounces == 2, "where there is no light there is nothing to wait for"


def test_a_closed_white_box_holds_nobody_up() -> None:
    """Light fades by half from bounce to bounce, but in a pair of small sites that see each other alone, by a hundredth: the sums
    end when the others' are made, which the pair's do not disturb."""
    F = np.zeros((6, 6))
    F[:4, :4] = 0.5 / 4
    F[4, 5] = F[5, 4] = 0.99
    area, E_1 = np.array([1.0, 1.0, 1.0, 1.0, 0.05, 0.05]), np.ones((6, 3))
    found = last(E_1, by_rows(F), area, 64, True)
    assert found.converged and found.bounces < 12
    E = np.linalg.solve(np.eye(6) - F, E_1)
    assert found.irradiance[:4] == pytest.approx(E[:4], rel=0.01) and (found.irradiance[4:] <= E[4:]).all()


def test_a_ray_s_hit_goes_where_it_is_said() -> None:
    """Two rays of a site, one on three others with unlike weights, one that hits nothing of the cache."""
    transport = Transport(4, 2)
    where = np.array([[[1, 2, 3], [0, 0, 0]]])
    weights, albedo = np.array([[[0.5, 0.25, 0.25], [0.0, 0.0, 0.0]]]), np.array([[[0.2, 0.4, 1.0], [0.9, 0.9, 0.9]]])
    transport.fill(np.array([2]), np.array([[np.pi / 2, np.pi / 2]]), (where, weights, albedo))
    assert np.allclose(dense(transport)[:, 2], np.array([[0.2], [0.4], [1.0]]) * 0.5 * np.array([0.0, 0.5, 0.25, 0.25]))
    assert not dense(transport)[:, [0, 1, 3]].any()


# ---- changes ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A surface cache of few points and rays: exact enough to compare it with itself."""
    monkeypatch.setattr(site_layout, "POINTS", (300, 300))
    monkeypatch.setattr(site_rays, "SIDES", (8, 8))


@pytest.mark.usefixtures("few")
def test_other_lights_need_no_other_transport(ctx: moderngl.Context) -> None:
    """Who sees whom stays; the values come to those of a renderer that began with these lights, bit by bit."""
    moved = [lamp((-0.5, 0.2, 0.5), 5.0), lamp((0.4, 0.3, 0.2), 1.0)]
    with made(ctx, room()) as renderer, made(ctx, replace(room(), lights=tuple(moved))) as other:
        cache, before = renderer.scheduler.gatherer.surface, values(renderer)
        assert cache is not None
        transport = cache.transport
        renderer.relight(moved)
        assert renderer.scheduler.gatherer.surface_share < 1.0 and values(renderer) is before, "the old ones hold meanwhile"
        advance(renderer)
        assert cache.transport is transport and not np.array_equal(values(renderer), before)
        assert np.array_equal(values(renderer), values(other))


@pytest.mark.usefixtures("few")
def test_a_lamp_goes_into_a_box_and_comes_out_again(ctx: moderngl.Context) -> None:
    """The box's inside needs no sites while it is dark; when a lamp is in it, it is lit."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5), outward=False), box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)))
    places = (0.0, 0.8, 0.0), (0.0, 0.0, 0.0), (0.0, 0.8, 0.0)
    counts = []
    with made(ctx, replace(world, lights=(lamp(places[0]),))) as renderer:
        for place in places:
            lit = replace(world, lights=(lamp(place),))
            if counts:
                renderer.relight(lit.lights)
                advance(renderer)
            assert renderer.scheduler.gatherer.surface is not None
            counts.append(len(renderer.scheduler.gatherer.surface.sites))
            with made(ctx, lit) as other:
                assert np.array_equal(values(renderer), values(other))
            within = gathered(renderer, sites([[0.399, 0.1, 0.0], [0.999, 0.1, 0.0]], (-1, 0, 0)))
            assert (within.max(1) > 0.01).tolist() == [place == places[1], place != places[1]]
    assert counts[0] == counts[2] < counts[1]


@pytest.mark.usefixtures("few")
def test_ticks_of_little_time_come_to_the_same(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_gatherer, "_PATIENCE", np.inf)
    with Renderer(room(), SIZE, ctx=ctx, **ALL) as small, made(ctx, room(), gather_size=8) as whole:
        shares = []
        while small.scheduler.gatherer.surface_share < 1.0 and len(shares) < 3000:
            _, progress = small.frame(seconds=1e-4)
            shares.append(progress.surface)
            assert not progress.done and (progress.surface == 1.0 or progress.records == 0), "no record before it is there"
        assert len(shares) > 20 and shares == sorted(shares)
        assert np.array_equal(values(small), values(whole))
        for _ in range(2000):
            if small.frame(seconds=1e-3)[1].done:
                break
        assert small.frame()[1].done and np.array_equal(small.render().position, whole.render().position)


@pytest.mark.usefixtures("few")
def test_records_follow_the_number_of_bounces(ctx: moderngl.Context) -> None:
    """Each number's records are those of a renderer of that number; without bounces they wait, and are as they were."""
    with Renderer(room(), SIZE, ctx=ctx, **{**ALL, "bounces": 1}) as renderer:
        one = renderer.render().records_irradiance
        for number in (3, "all", 2):
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


@pytest.mark.usefixtures("few")
def test_equal_seeds_equal_bits_and_other_seeds_other_rays() -> None:
    one, two = (irrsplat.render(room(), SIZE, **ALL) for _ in range(2))
    assert np.array_equal(one.image, two.image) and np.array_equal(one.records_irradiance, two.records_irradiance)
    assert one.stats["bounces_converged"] and 3 <= one.stats["bounces"] < 64
    other = irrsplat.render(room(), SIZE, **ALL, seed=3)
    assert not np.array_equal(one.image, other.image)
    assert other.irradiance.mean() == pytest.approx(one.irradiance.mean(), rel=0.03)


@pytest.mark.usefixtures("few")
def test_the_paper_s_algorithm_with_more_bounces(ctx: moderngl.Context) -> None:
    """One record at a time, summed on the CPU: the same light reaches it."""
    with Renderer(room(), (16, 12), "paper", ctx=ctx, **{**ALL, "warmup": 20}) as renderer:
        frame = renderer.render()
    with Renderer(room(), (16, 12), "paper", ctx=ctx, **{**ALL, "bounces": 1, "warmup": 20}) as renderer:
        once = renderer.render()
    assert frame.stats["bounces"] > 3 and once.stats["bounces"] == 1
    assert 1.2 < frame.records_irradiance[:20].mean() / once.records_irradiance[:20].mean() < 4.0


@pytest.mark.usefixtures("few")
def test_nothing_to_see_and_nothing_at_all(ctx: moderngl.Context) -> None:
    """A scene without triangles, and one without light."""
    for world in (scene(sky=1.0), scene(box((-1, -1, -1), (1, 1, 1), material(0.5), outward=False))):
        with Renderer(world, (8, 6), ctx=ctx, **ALL) as renderer:
            frame = renderer.render()
            assert not frame.irradiance.any() and frame.stats["bounces_converged"]
