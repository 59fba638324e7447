"""Gathers against scenes of known irradiance: furnace, sky, walls, patches, lights over planes, lights near walls."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import Sites
from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.gather.plane import FIELD
from irrsplat.gather.stratified import ray_directions
from irrsplat.scene.appearance import flatten
from irrsplat.scene.model import Light, Scene
from tests.gather.test_hemisphere import share_of_plane
from tests.support.luminaires import lopsided, photometry, steps
from tests.support.worlds import Lit, box, floor, gather, material, point_light, polygon_vector, quad, scene, sites

UP = (0.0, 1.0, 0.0)
EMITTER = (1.0, 2.0, 3.0)  # W/(m² sr), different in each channel
BLACK = material(0.0)
KINDS = ("plane", "trace", "embree")
WHOLE = ("trace", "embree")  # gathers that cover the whole hemisphere
SEEN = {"plane": share_of_plane(FIELD), "trace": 1.0, "embree": 1.0}  # of the cosine-weighted hemisphere; the plane: 0.945
EXACT = {"plane": 5e-3, "trace": 1e-5, "embree": 1e-5}  # relative error of E under uniform radiance


def inside(count: int, seed: int = 5) -> np.ndarray:
    """Return random points around the origin."""
    return np.random.default_rng(seed).uniform(-0.7, 0.7, (count, 3))


@pytest.mark.parametrize(("kind", "side"), [("plane", 32), ("trace", 64), ("embree", 64)])
def test_furnace(ctx: moderngl.Context, kind: str, side: int) -> None:
    """Uniform radiance L_e gives E = π·L_e; a whole hemisphere also gives M = π·L_e·n and no gradient.

    The paper's plane covers 94.5 % of the hemisphere. A single missed ray would return the bright sky.
    """
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, EMITTER), outward=False), sky=0.0 if kind == "plane" else 1e6)
    normals = np.random.default_rng(3).normal(size=(20, 3))
    found = gather(ctx, world, sites(inside(20), normals), side, kind)
    assert np.allclose(found.E, np.pi * SEEN[kind] * np.array(EMITTER), rtol=EXACT[kind])
    if kind != "plane":
        n = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        assert np.allclose(found.M, np.pi * np.array(EMITTER)[None, :, None] * n[:, None, :], atol=1e-4)
        assert np.abs(found.gradient).max() < 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_sky_over_an_unlit_plane(ctx: moderngl.Context, kind: str) -> None:
    """Only a sky of radiance L above: E = π·L. All directions miss, so R is the scene's diagonal."""
    world = scene(floor(2.0), sky=EMITTER)
    found = gather(ctx, world, sites(inside(8) * (1, 0, 1), UP), 32, kind)
    assert np.allclose(found.E, np.pi * SEEN[kind] * np.array(EMITTER), rtol=EXACT[kind])
    assert np.allclose(found.R, world.diagonal, rtol=1e-6)


def perpendicular(height: float, half_width: float, distance: float) -> float:
    """Return the form factor of a point on the floor to a wall at `distance`, whose foot's middle is nearest.

    Howell C-12, a rectangle in a perpendicular plane with a corner nearest, twice: with X = a/b, Y = c/b for height a,
    width b, distance c: F = 1/(2π)·[atan(1/Y) - Y/√(X²+Y²)·atan(1/√(X²+Y²))].
    """
    X, Y = height / half_width, distance / half_width
    root = np.hypot(X, Y)
    return float((np.arctan(1 / Y) - Y / root * np.arctan(1 / root)) / np.pi)


def parallel(half: float, distance: float) -> float:
    """Return the form factor of a point to a square of 2·half at its zenith: Howell C-11 four times, X = Y = half/distance."""
    x = half / distance
    return float(4 / np.pi * x / np.hypot(1, x) * np.arctan(x / np.hypot(1, x)))


def test_the_published_form_factors_are_lamberts() -> None:
    """The catalogue's two formulas match Lambert's formula for polygons."""
    wall = np.array([(-0.8, 0, 0.5), (0.8, 0, 0.5), (0.8, 1.7, 0.5), (-0.8, 1.7, 0.5)])
    roof = np.array([(-0.6, 0.9, -0.6), (0.6, 0.9, -0.6), (0.6, 0.9, 0.6), (-0.6, 0.9, 0.6)])
    assert polygon_vector(wall, np.zeros(3))[1] / np.pi == pytest.approx(perpendicular(1.7, 0.8, 0.5), rel=1e-9)
    assert polygon_vector(roof, np.zeros(3))[1] / np.pi == pytest.approx(parallel(0.6, 0.9), rel=1e-9)
    assert perpendicular(1e6, 1e6, 1.0) == pytest.approx(0.5, abs=1e-5), "an endless wall hides half of the sky"


def off(E: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Return the relative error of the mean of E (N, 3), and the relative RMSE over records."""
    error = E / truth - 1.0
    return float(np.abs(error.mean(0)).max()), float(np.sqrt((error**2).mean()))


@pytest.mark.parametrize("side", [64, 128])
@pytest.mark.parametrize(("half", "distance"), [(1.0, 0.4), (0.3, 1.2)])
def test_parallel_patch(ctx: moderngl.Context, half: float, distance: float, side: int) -> None:
    """E = π·L_e·F of a square overhead, over 64 frames with different rotations.

    A texel on an edge counts completely or not at all. A square of n = side·half/distance texels has 4n on its rim, each
    with a random error of ±½: √(4n/12) in a sum of n². The relative error is 0.58·n^(-3/2), 2.5 % at n = 8 and 0.3 % at n =
    32; the mean is unbiased.
    """
    patch = quad((-half, distance, -half), (2 * half, 0, 0), (0, 0, 2 * half), material(0.0, EMITTER))
    truth = np.pi * parallel(half, distance) * np.array(EMITTER)
    mean, rms = off(gather(ctx, scene(patch), sites(np.zeros((64, 3)), UP), side).E, truth)
    assert mean < 0.013
    assert rms < max(0.02, 0.58 * (side * half / distance) ** -1.5)


@pytest.mark.parametrize(("height", "distance", "side"), [(1.0, 0.5, 32), (0.5, 0.1, 64), (2.0, 1.5, 32)])
def test_perpendicular_patch(ctx: moderngl.Context, height: float, distance: float, side: int) -> None:
    """E = π·L_e·F of a wall at the record's feet, with errors as in test_parallel_patch."""
    patch = quad((-1, 0, distance), (2, 0, 0), (0, height, 0), material(0.0, EMITTER))
    truth = np.pi * perpendicular(height, 1.0, distance) * np.array(EMITTER)
    mean, rms = off(gather(ctx, scene(patch), sites(np.zeros((64, 3)), UP), side).E, truth)
    assert mean < 0.01
    assert rms < (0.025 if side == 32 else 0.01)


@pytest.mark.parametrize("kind", WHOLE)
def test_radius_is_the_harmonic_mean_distance(ctx: moderngl.Context, kind: str) -> None:
    """Under a ceiling 57 times as wide as its height h, 1/r = cosθ/h: 1/R = ∫ cosθ·cosθ/h dω/π = 2/(3h), R = 1.5·h."""
    found = gather(ctx, scene(quad((-20, 0.7, -20), (40, 0, 0), (0, 0, 40))), sites(np.zeros((8, 3)), UP), 32, kind)
    assert np.allclose(found.R, 1.5 * 0.7, rtol=0.01)


ROOF = quad((-3, 1.5, -3), (6, 0, 0), (0, 0, 6), material((0.2, 0.5, 0.9)))
LIGHTS = {
    "physical": point_light((0.4, -1.0, 0.2), 5.0),
    "opengl": Light((0.4, -1.0, 0.2), (1.0, 2.0, 3.0), attenuation=(0.5, 0.25, 0.125)),
    "no falloff": Light((0.4, -1.0, 0.2), (1.0, 2.0, 3.0)),
    "directional": Light((0.5, -2.0, 0.25), (1.0, 2.0, 3.0), directional=True),
    "hard cone": point_light((0.4, -1.0, 0.2), 5.0, spot_target=(0.0, 1.5, 0.0), spot_cutoff=35.0, spot_inner=35.0),
    "soft cone": point_light((0.4, -1.0, 0.2), 5.0, spot_target=(0.0, 1.5, 0.0), spot_cutoff=45.0, spot_inner=20.0),
    "exponent": Light((0.4, -1.0, 0.2), (1, 1, 1), spot_target=(0, 1.5, 0), spot_cutoff=60.0, spot_inner=60.0, spot_exponent=8.0),
    "wide cone": point_light((0.4, -1.0, 0.2), 5.0, spot_target=(0.0, 1.5, 0.0), spot_cutoff=85.0, spot_inner=60.0),
    "luminaire": Light(
        (0.4, -1.0, 0.2),
        (3.0, 2.0, 1.0),
        physical=True,
        photometry=photometry(steps(0, 180, 25), steps(0, 360, 25), lopsided),
        spot_target=(0.0, 1.5, 0.5),
        across=(0.2, 0.1, 1.0),
    ),
}


def irradiance(light: Light, p: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Return unshadowed E (..., 3) of `light` at points p with normals n, by the formulas of the scene grammar."""
    at = np.asarray(light.position, float)
    to = np.broadcast_to(at, p.shape) if light.directional else at - p
    d = np.linalg.norm(to, axis=-1)
    cosine = np.maximum((to * n).sum(-1) / d, 0.0)
    spot = np.ones_like(d)
    if light.photometry is not None:
        spot = light.photometry.intensity(-(to @ light.frame.T) / d[..., None]) / LUMINOUS_EFFICACY
    elif light.spot_target is not None:
        axis = np.subtract(light.spot_target, at)
        c = np.clip(-(to @ axis) / d / np.linalg.norm(axis), -1.0, 1.0)
        angle = np.degrees(np.arccos(c))
        if light.spot_inner < light.spot_cutoff:
            spot = np.clip((light.spot_cutoff - angle) / (light.spot_cutoff - light.spot_inner), 0.0, 1.0)
        else:
            spot = (angle <= light.spot_cutoff).astype(float)
        spot = spot * np.maximum(c, 0.0) ** light.spot_exponent
    if light.physical:
        strength = 1.0 / d**2
    elif light.directional:
        strength = np.pi * np.ones_like(d)
    else:
        strength = np.pi / (light.attenuation[0] + light.attenuation[1] * d + light.attenuation[2] * d * d)
    return (cosine * spot * strength)[..., None] * np.asarray(light.color)


@pytest.mark.parametrize(
    ("name", "kind"),
    [*((name, "trace") for name in LIGHTS), *((name, "plane") for name in ("soft cone", "luminaire", "physical"))],
)
def test_what_a_texel_sees_of_a_lit_plane(ctx: moderngl.Context, name: str, kind: str) -> None:
    """Each texel has ρ/π·E at the hit of its ray on the plane, and the ray's length.

    A plane's ray passes through the texel's centre on the face, while the table's direction is a mean: they differ by
    second order. Strata around the normal are long, and hold the mean over their length. rim: degrees around a cone's rim,
    which cuts texels.
    """
    exact, rim = (1e-3, 1.0) if kind == "trace" else (0.01, 3.0)
    light = LIGHTS[name]
    lit, where = Lit(ctx, scene(ROOF, lights=(light,))), sites((0.1, 0.0, -0.2), UP)
    with lit, lit.look(48, kind) as look:
        atlas = look(lit.light, where, np.zeros(1), 0)
        width, height = atlas.cell
        seen = np.frombuffer(atlas.radiance.read(), "f4").reshape(atlas.radiance.height, -1, 4)[:height, :width]
        frame = np.frombuffer(atlas.frames.read(), "f4").reshape(atlas.frames.height, -1, 4)[:3, 0, :3]
        table = np.frombuffer(atlas.table.read(), "f4").reshape(height, width, 4)[..., :3]
    if kind == "trace":
        table = ray_directions(48).reshape(table.shape)
    direction = table @ frame
    t = 1.5 / direction[..., 1]
    hit = where.position[0] + t[..., None] * direction
    margin = 10 * exact
    on, beside = (np.abs(hit[..., [0, 2]]) < 3.0 - margin).all(-1), (np.abs(hit[..., [0, 2]]) > 3.0 + 2 * margin).any(-1)
    assert not seen[beside].any() and on.sum() > 500
    assert np.allclose(seen[on][:, 3], t[on], rtol=exact)
    on[0] &= kind != "trace"
    truth = np.array([0.2, 0.5, 0.9]) / np.pi * irradiance(light, hit[on], np.array([0.0, -1.0, 0.0]))
    relative = 0.03 if kind == "trace" else 0.02
    wrong = np.abs(seen[on][:, :3] - truth).max(-1) > relative * truth.max(-1) + 0.005 * truth.max()
    if name in ("hard cone", "soft cone"):
        wrong &= np.abs(rim_distance(light, hit[on])) > rim
    assert wrong.mean() < 0.002, f"{wrong.sum()} of {wrong.size} texels"


def rim_distance(light: Light, p: np.ndarray) -> np.ndarray:
    """Return degrees between points and the rim of a light's cone."""
    axis, to = np.subtract(light.spot_target, light.position), p - np.asarray(light.position)  # type: ignore[arg-type]
    c = to @ axis / np.linalg.norm(to, axis=-1) / np.linalg.norm(axis)
    return np.degrees(np.arccos(c)) - light.spot_cutoff


@pytest.mark.parametrize("shade", [False, True])
def test_few_rays_bring_as_much_as_many(ctx: moderngl.Context, shade: bool) -> None:
    """Few and many rays give equal light on a room's walls, with a light under the ceiling and one in an open shade.

    A mean over more surface than a ray hits would include light inside the shade's shadow.
    """
    walls, high = box((-1, 0, -1), (1, 2, 1), material(0.5), outward=False), 1.4 if shade else 1.9
    east, south, down, grey = (0.2, 0.0, 0.0), (0.0, 0.0, 0.2), (0.0, -0.2, 0.0), material(0.8)
    edges = (-0.1, 0.1)
    sides = [quad((-0.1, 1.5, z), east, down, grey) for z in edges] + [quad((x, 1.5, -0.1), south, down, grey) for x in edges]
    inward = np.repeat([(1.0, 0, 0), (-1.0, 0, 0), (0, 0, 1.0), (0, 0, -1.0), (0, 1.0, 0)], 256, axis=0)
    places = np.random.default_rng(3).uniform((-1, 0, -1), (1, 2, 1), inward.shape)
    places = np.where(inward != 0.0, (0, 1, 0) - inward, places)
    shades = [*sides, quad((-0.1, 1.3, -0.1), east, south, grey)] if shade else []
    with Lit(ctx, scene(walls, *shades, lights=(point_light((0.0, high, 0.0), 7.0),))) as lit:
        few, many = (lit.gather(sites(places, inward), side).E.mean() for side in (16, 64))
    assert few == pytest.approx(many, rel=0.02)


def room() -> Scene:
    """Return a furnished room with different normals, colours and shadows for each triangle."""
    return scene(
        box((-1, -1, -1), (1, 1, 1), material((0.7, 0.4, 0.2), (0.1, 0.2, 0.3)), outward=False),
        box((-0.6, -1, -0.5), (-0.1, -0.2, 0.1), material((0.1, 0.8, 0.3))),
        quad((0.2, -0.4, -0.6), (0.5, 0.1, 0.2), (-0.1, 0.3, 0.4), material((0.9, 0.1, 0.6), (0.5, 0.0, 0.2))),
        lights=(point_light((0.3, 0.7, 0.2), 2.0),),
    )


@pytest.mark.parametrize("kind", WHOLE)
def test_directions_below_the_geometric_surface_count_as_nothing(ctx: moderngl.Context, kind: str) -> None:
    """With the shading normal 60° off, (1 + cos 60°)/2 = 3/4 of the cosine-weighted hemisphere lies above the surface."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, 1.0), outward=False))
    tilted = (np.sin(np.radians(60)), np.cos(np.radians(60)), 0.0)
    found = gather(ctx, world, sites(inside(16), tilted, geometric=UP), 32, kind)
    assert np.allclose(found.E, np.pi * 0.75, rtol=0.02)


@pytest.mark.parametrize("kind", WHOLE)
def test_a_lit_floor_does_not_light_itself(ctx: moderngl.Context, kind: str) -> None:
    """A floor alone has no indirect light where its shading normals lean, as on a coarse curved mesh. Rays below the horizon meet
    the floor itself, also where the mean direction of their stratum lies above."""
    slope = np.radians(np.arange(1.0, 15.0))
    leaning = np.stack([np.sin(slope), np.cos(slope), 0.0 * slope], axis=1)
    lit = scene(floor(paint=material(0.9)), lights=(point_light((0.0, 1.0, 0.0), 10.0),))
    assert not gather(ctx, lit, sites(np.zeros((len(slope), 3)), leaning, geometric=UP), 32, kind).E.any()


@pytest.mark.parametrize("shines", [0.0, 1.0])
@pytest.mark.parametrize("kind", WHOLE)
def test_the_dark_within_a_closed_mesh_is_known_for_it(ctx: moderngl.Context, kind: str, shines: float) -> None:
    """Records on the floor inside a closed dark box have no reach, also with another closed box next to it.

    Outside the box, inside an emitting box, and in the dark between open sheets, they keep their reach.
    """
    paint, inner = material(0.5, shines), box((-0.2, -0.01, -0.2), (0.2, 0.1, 0.2))
    sheets = [
        quad((3, 0, -1), (2, 0, 0), (0, 1, 0)),
        quad((3, 0, 1), (2, 0, 0), (0, 1, 0)),
        quad((3, 1, -1), (2, 0, 0), (0, 0, 2)),
    ]
    sheets += [quad((x, 0, -1), (0, 0, 2), (0, 1, 0)) for x in (3, 5)]
    world = scene(floor(9.0), box((-1, -0.01, -1), (1, 1, 1), paint), inner, *sheets, sky=1.0)
    places = np.array([(-0.5, 0.0, 0.3), (0.3, 0.0, 0.0), (2.0, 0.0, 0.0), (4.0, 0.0, 0.0)])
    found = gather(ctx, world, sites(places, UP), 32, kind)
    within = np.array([shines == 0.0] * 2 + [False] * 2)
    assert np.array_equal(found.farthest == 0.0, within)
    assert np.array_equal(found.E.any(1), ~within & [True, True, True, False])


@pytest.mark.parametrize("kind", WHOLE)
def test_a_sky_that_is_brighter_above_lights_by_where_a_surface_faces(ctx: moderngl.Context, kind: str) -> None:
    """E = π·sky + 2π/3·gradient·cos, for the angle between normal and up: ∫ cosθ dω = π, ∫ ω cosθ dω = 2π/3·n."""
    sky, gradient, up = np.array([1.0, 2.0, 0.5]), np.array([0.7, -0.3, 0.5]), np.array([0.0, 0.6, 0.8])
    world = replace(scene(sky=tuple(sky)), sky_gradient=tuple(gradient), up=tuple(up))
    normals = np.random.default_rng(2).normal(size=(16, 3))
    normals = np.concatenate([normals / np.linalg.norm(normals, axis=1, keepdims=True), [up, -up]])
    found = gather(ctx, world, sites(np.zeros((18, 3)), normals), 32, kind)
    expected = np.pi * sky + 2.0 * np.pi / 3.0 * (normals @ up)[:, None] * gradient
    assert np.allclose(found.E, expected, rtol=2e-3, atol=5e-3)


@pytest.mark.parametrize("kind", WHOLE)
@pytest.mark.parametrize("away", [1e-2, 4e-4, 3e-5])
def test_a_record_in_a_corner_does_not_see_through_the_wall(ctx: moderngl.Context, away: float, kind: str) -> None:
    """A black box under a bright sky stays dark inside, also `away` metres from a wall, the distance of a pixel's hit.

    No ray is lost.
    """
    world = scene(box((-1, -1, -1), (1, 1, 1), BLACK, outward=False), sky=100.0)
    along = np.random.default_rng(0).uniform(-0.9, 0.9, 64)
    near = np.stack([along, np.full(64, -1.0), np.full(64, -1.0 + away)], 1)
    E = gather(ctx, world, sites(near, UP), 32, kind).E / (100.0 * np.pi)
    assert E.max() == 0.0, f"{E.max():.2%} of the sky, {(E[:, 0] > 0).mean():.0%} see any"


@pytest.mark.parametrize("kind", WHOLE)
def test_a_site_in_the_corner_line_sees_the_wall(ctx: moderngl.Context, kind: str) -> None:
    """On the floor of a furnace, exactly at a wall's foot, the wall fills half of the hemisphere: E = π·L_e as everywhere.

    From the line itself the wall is edge-on and vanishes; from inside the floor's triangle it does not.
    """
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, EMITTER), outward=False))
    vertices, faces = flatten(world)
    corners = vertices[faces, :3]
    on_line = ((corners[..., 0] == 1.0) & (corners[..., 1] == -1.0)).sum(1) == 2
    floor_triangle = int(np.flatnonzero(on_line & (corners[..., 1] == -1.0).all(1))[0])
    bare = sites([(1.0, -1.0, z) for z in (-0.5, 0.0, 0.5)], UP)
    known = Sites(bare.position, bare.normal, bare.geometric, np.full(3, floor_triangle))
    assert np.allclose(gather(ctx, world, known, 32, kind).E, np.pi * np.array(EMITTER), rtol=1e-5)


def test_records_know_their_noise(ctx: moderngl.Context) -> None:
    """Records at one place with other rays deviate by their noise within a factor of 2.5, under a small panel and a large one."""
    for half, least in ((0.05, 0.1), (0.5, 0.005)):
        lit = quad((-half, 1.0, -half), (2.0 * half, 0.0, 0.0), (0.0, 0.0, 2.0 * half), material(0.0, 1.0))
        records = gather(ctx, scene(lit), sites(np.tile((0.1, 0.0, 0.05), (200, 1)), (0.0, 1.0, 0.0)), 32)
        Y = records.E.mean(1)
        assert Y.std() > least * Y.mean() and 0.4 < records.noise.mean() * Y.mean() / Y.std() < 2.5
    black = gather(ctx, scene(lit), sites((0.1, 0.0, 0.05), (0.0, -1.0, 0.0)), 32)
    assert not black.E.any() and black.noise == 1.0, "no light along few rays is no certainty"
