"""The gather by rays: its tables, analytic scenes, agreement with the raster gather, and Ward and Heckbert's gradient."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.core.glsl import NEIGHBOUR_STRIDE
from irrsplat.gather.stratified import shape, stratum_edges, stratum_table
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Scene
from tests.gather import test_gradients as occluder
from tests.gather.test_analytic import (
    EMITTER,
    LIGHTS,
    ROOF,
    UP,
    inside,
    irradiance,
    lamp_under_roof,
    parallel,
    perpendicular,
    rim_distance,
    room,
)
from tests.support.truth import load_reference
from tests.support.worlds import Gathered, Lit, box, floor, lamp, material, quad, scene, sites

# ---- tables -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [4, 16, 64])
def test_strata_share_the_hemisphere_equally(side: int) -> None:
    """Σ cosθ·dω = π, ∫ω dω = (0, 0, π), ∫dω = 2π: a stratum's own dω is w/z, but for the spread of what is in it."""
    table = stratum_table(side)
    assert table.shape == (*shape(side), 4) and table[..., 0].size == side * side
    assert np.allclose(table[..., 3], np.pi / side**2, rtol=1e-12)
    assert np.allclose(np.linalg.norm(table[..., :3], axis=-1), 1.0)
    vector = table[..., :3] * (table[..., 3] / table[..., 2])[..., None]
    assert np.allclose(vector.sum((0, 1)), [0.0, 0.0, np.pi], atol=1e-12)
    assert np.linalg.norm(vector, axis=-1).sum() == pytest.approx(2.0 * np.pi, rel=1.0 / side)


def test_a_stratum_s_vector_is_its_integral() -> None:
    """∫ω·dω over the stratum (sin²θ from 3/8 to 4/8, φ from 5/32 to 6/32 turns) in quadrature, which Σ L·ω·dω builds on."""
    table = stratum_table(16)
    theta = np.linspace(*np.arcsin(np.sqrt([3 / 8, 4 / 8])), 401)
    phi = np.linspace(*(2 * np.pi * np.array([5, 6]) / 32), 401)
    theta, phi = np.meshgrid(0.5 * (theta[1:] + theta[:-1]), 0.5 * (phi[1:] + phi[:-1]))
    solid = np.sin(theta) * np.ptp(theta) / 399 * np.ptp(phi) / 399
    omega = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    truth = (omega * solid[..., None]).sum((0, 1))
    found = table[3, 5, :3] * table[3, 5, 3] / table[3, 5, 2]
    assert np.allclose(found, truth, rtol=1e-5)


def test_edges_are_ward_and_heckbert_s_sum() -> None:
    """∇E along the surface for random L and r equals their formula, written as they print it (1992, translation gradient):

    Σ_k û_k·(2π/N)·Σ_{j≥1} sinθ_j-·cos²θ_j-·(L_jk - L_j-1,k)/min(r_jk, r_j-1,k)
    + Σ_k v̂_k-·Σ_j (sinθ_j+ - sinθ_j-)·(L_jk - L_j,k-1)/min(r_jk, r_j,k-1), the azimuth closed into a ring.
    """
    side = 16
    m, n = shape(side)
    rng = np.random.default_rng(0)
    L, r = rng.random((m, n)), rng.uniform(0.5, 2.0, (m, n))
    truth = np.zeros(2)
    for k in range(n):
        middle, before = 2 * np.pi * (k + 0.5) / n, 2 * np.pi * k / n
        for j in range(m):
            sine, more = np.sqrt(j / m), np.sqrt((j + 1) / m)
            if j:
                u = sine * (1 - sine**2) * (L[j, k] - L[j - 1, k]) / min(r[j, k], r[j - 1, k])
                truth += 2 * np.pi / n * u * np.array([np.cos(middle), np.sin(middle)])
            v = (more - sine) * (L[j, k] - L[j, k - 1]) / min(r[j, k], r[j, k - 1])
            truth += v * np.array([-np.sin(before), np.cos(before)])
    table = stratum_edges(side).reshape(m, n, 2, 4)
    row = np.floor(table[..., 3] / NEIGHBOUR_STRIDE).astype(int)
    column = (table[..., 3] - NEIGHBOUR_STRIDE * row).astype(int)
    change = (L[row, column] - L[..., None]) / np.minimum(r[row, column], r[..., None])
    assert np.allclose((change[..., None] * table[..., :2]).sum((0, 1, 2)), truth, rtol=1e-12)


def test_edges_give_the_gradient_along_the_normal_too() -> None:
    """Under a ceiling whose radiance falls off from the zenith as exp(-s²), in quadrature: what moving up by h brings."""
    side, height, step = 64, 1.3, 1e-3

    def E(h: float) -> float:
        s = (np.arange(40_000) + 0.5) / 40_000 * 8.0
        return float((np.exp(-(s**2)) * h * h / (h * h + s * s) ** 2 * 2 * np.pi * s * 8.0 / 40_000).sum())

    truth = (E(height - step) - E(height + step)) / (2 * step)
    m, n = shape(side)
    square = np.broadcast_to(((np.arange(m) + 0.5) / m)[:, None], (m, n))
    r, L = height / np.sqrt(1 - square), np.exp(-(height**2) * square / (1 - square))
    table = stratum_edges(side).reshape(m, n, 2, 4)
    row = np.floor(table[..., 3] / NEIGHBOUR_STRIDE).astype(int)
    column = (table[..., 3] - NEIGHBOUR_STRIDE * row).astype(int)
    change = (L[row, column] - L[..., None]) / np.minimum(r[row, column], r[..., None])
    found = (change[..., None] * table[..., :3]).sum((0, 1, 2))
    assert found[2] == pytest.approx(truth, rel=0.03)
    assert np.allclose(found[:2], 0.0, atol=1e-9)


# ---- analytic scenes --------------------------------------------------------------------------------------------------


def traced(ctx: moderngl.Context, world: Scene, where: Sites, side: int = 32) -> Gathered:
    return Lit(ctx, world).gather(where, side)


@pytest.mark.parametrize("side", [8, 32])
def test_furnace(ctx: moderngl.Context, side: int) -> None:
    """Every direction brings L_e: E = π·L_e, M = π·L_e·n, no gradient. Not one of the rays may miss: the sky would be seen."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, EMITTER), outward=False), sky=1e6)
    normals = np.random.default_rng(3).normal(size=(20, 3))
    found = traced(ctx, world, sites(inside(20), normals), side)
    assert np.allclose(found.E, np.pi * np.array(EMITTER), rtol=1e-5)
    n = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.allclose(found.M, np.pi * np.array(EMITTER)[None, :, None] * n[:, None, :], atol=1e-4)
    assert np.abs(found.gradient).max() < 1e-3


def test_not_one_of_a_million_rays_leaves_a_closed_box(ctx: moderngl.Context) -> None:
    lit = Lit(ctx, scene(box((-1, -1, -1), (1, 1, 1), outward=False)))
    look = lit.look(128, "trace", 64)
    normals = np.random.default_rng(8).normal(size=(64, 3))
    at = sites(inside(64), normals / np.linalg.norm(normals, axis=1, keepdims=True))[: look.capacity]
    atlas = look(lit.light, at, np.arange(64), 0)
    seen = np.frombuffer(atlas.radiance.read(), "f4").reshape(-1, 4)
    assert len(seen) >= 1_000_000 and (seen[:, 3] > 0.0).all()
    ctx.detect_framebuffer(0).use()
    look.release()


@pytest.mark.parametrize("distance", [0.05, 0.3, 1.0])
def test_a_black_wall_hides_half_of_the_sky(ctx: moderngl.Context, distance: float) -> None:
    """A wall of 40 m × 20 m: E = π·L·(1 - F), F being nearly one half.

    Its foot runs along two of the 64 azimuths, each of which counts whole or not at all: one of 64 at most is wrong.
    """
    wall = quad((-20, 0, distance), (40, 0, 0), (0, 20, 0), material(0.0))
    E = traced(ctx, scene(wall, sky=1.0), sites(np.zeros((64, 3)), UP)).E[:, 0] / np.pi
    truth = 1 - perpendicular(20.0, 20.0, distance)
    assert abs(E.mean() - truth) < 0.003 and np.abs(E - truth).max() < 1 / 64 + 0.003


@pytest.mark.parametrize(("half", "height"), [(0.5, 1.0), (1.0, 0.4)])
def test_parallel_patch(ctx: moderngl.Context, half: float, height: float) -> None:
    """E = π·L_e·F of a square overhead, over frames turned by 64 angles; rays that its rim decides are of either kind."""
    patch = quad((-half, height, -half), (2 * half, 0, 0), (0, 0, 2 * half), material(0.0, EMITTER))
    error = (
        traced(ctx, scene(patch), sites(np.zeros((64, 3)), UP), 64).E / (np.pi * parallel(half, height) * np.array(EMITTER)) - 1
    )
    assert abs(error.mean()) < 0.01
    assert np.sqrt((error**2).mean()) < 0.02


def test_sky_alone_and_no_geometry_at_all(ctx: moderngl.Context) -> None:
    world = scene(floor(2.0), sky=EMITTER)
    found = traced(ctx, world, sites(inside(8) * (1, 0, 1), UP))
    assert np.allclose(found.E, np.pi * np.array(EMITTER), rtol=1e-5)
    assert np.allclose(found.R, world.diagonal, rtol=1e-6)
    assert np.allclose(traced(ctx, scene(sky=2.0), sites(np.zeros((3, 3)), UP)).E, 2.0 * np.pi, rtol=1e-5)


def test_radius_is_the_harmonic_mean_distance(ctx: moderngl.Context) -> None:
    """Under a wide ceiling of height h, 1/r = cosθ/h: R = 1.5·h."""
    found = traced(ctx, scene(quad((-20, 0.7, -20), (40, 0, 0), (0, 0, 40))), sites(np.zeros((8, 3)), UP))
    assert np.allclose(found.R, 1.5 * 0.7, rtol=0.01)


def test_directions_below_the_geometric_surface_count_as_nothing(ctx: moderngl.Context) -> None:
    """With the shading normal 60° off, of the cosine-weighted hemisphere (1 + cos 60°)/2 = 3/4 lies above the surface."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, 1.0), outward=False))
    tilted = (np.sin(np.radians(60)), np.cos(np.radians(60)), 0.0)
    found = traced(ctx, world, sites(inside(16), tilted, geometric=UP))
    assert np.allclose(found.E, np.pi * 0.75, rtol=0.02)


@pytest.mark.parametrize("away", [1e-2, 1e-3, 1e-4, 3e-5])
def test_a_record_in_a_corner_does_not_see_through_the_wall(ctx: moderngl.Context, away: float) -> None:
    """Bright outside, black inside: not a single ray gets out, however near the wall is."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.0), outward=False), sky=100.0)
    along = np.random.default_rng(0).uniform(-0.9, 0.9, 64)
    near = np.stack([along, np.full(64, -1.0), np.full(64, -1.0 + away)], 1)
    assert not traced(ctx, world, sites(near, UP)).E.any()


def test_a_site_in_the_corner_line_sees_the_wall(ctx: moderngl.Context) -> None:
    """On the floor of a furnace, exactly where a wall begins: E = π·L_e, if the site's triangle is known."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, EMITTER), outward=False))
    vertices, faces, _ = flatten(world)
    corners = vertices[faces, :3]
    on_line = ((corners[..., 0] == 1.0) & (corners[..., 1] == -1.0)).sum(1) == 2
    triangle = int(np.flatnonzero(on_line & (corners[..., 1] == -1.0).all(1))[0])
    bare = sites([(1.0, -1.0, z) for z in (-0.5, 0.0, 0.5)], UP)
    known = Sites(bare.position, bare.normal, bare.geometric, np.full(3, triangle))
    assert np.allclose(traced(ctx, world, known).E, np.pi * np.array(EMITTER), rtol=1e-5)


# ---- direct light at the hits -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LIGHTS)
def test_what_a_ray_sees_of_a_lit_plane(ctx: moderngl.Context, name: str) -> None:
    """Each ray brings ρ/π·E from where it meets the plane, at the ray's length; its direction is the stratum's middle."""
    lit, light = Lit(ctx, scene(ROOF, lights=(LIGHTS[name],))), LIGHTS[name]
    look = lit.look(64, "trace", 1)
    where = sites((0.1, 0.0, -0.2), UP)
    atlas = look(lit.light, where, np.zeros(1), 0)
    width, height = atlas.cell
    seen = np.frombuffer(atlas.radiance.read(), "f4").reshape(height, width, 4)
    frame = np.frombuffer(atlas.frames.read(), "f4").reshape(5, -1, 4)[:3, 0, :3]
    square, phi = (np.arange(height)[:, None] + 0.5) / height, 2 * np.pi * (np.arange(width) + 0.5) / width
    local = np.broadcast_arrays(np.sqrt(square) * np.cos(phi), np.sqrt(square) * np.sin(phi), np.sqrt(1 - square))
    direction = np.stack(local, -1) @ frame
    t = 1.5 / direction[..., 1]
    hit = where.position[0] + t[..., None] * direction
    on, off = (np.abs(hit[..., [0, 2]]) < 2.99).all(-1), (np.abs(hit[..., [0, 2]]) > 3.01).any(-1)
    assert not seen[off].any() and on.sum() > 500
    assert np.allclose(seen[on][:, 3], t[on], rtol=1e-3)
    truth = np.array([0.2, 0.5, 0.9]) / np.pi * irradiance(light, hit[on], np.array([0.0, -1.0, 0.0]))
    wrong = np.abs(seen[on][:, :3] - truth).max(-1) > 0.03 * truth.max(-1) + 0.005 * truth.max()
    if name in ("hard cone", "soft cone"):  # the rim
        wrong &= np.abs(rim_distance(light, hit[on])) > 1.0
    assert wrong.mean() < 0.002, f"{wrong.sum()} of {wrong.size} rays"
    ctx.detect_framebuffer(0).use()
    look.release()


@pytest.mark.parametrize("gap", [0.02, 0.05, 0.1])
def test_a_lamp_near_a_wall_does_not_alias(ctx: moderngl.Context, gap: float) -> None:
    """Its spot is far smaller than what a ray stands for, and yet E is right within a few per cent, wherever the rays go."""
    roof = quad((-5, 2, -5), (10, 0, 0), (0, 0, 10), material(0.6))
    world = scene(roof, lights=(lamp((0.0, 2.0 - gap, 0.0), 7.0),))
    aside = np.random.default_rng(2).uniform(-1.0, 1.0, (64, 3)) * (1, 0, 1)
    straight = aside * 0.02
    E = traced(ctx, world, sites(straight, UP)).E[:, 0] / (0.6 * 7.0 * lamp_under_roof(gap, 2.0))
    assert abs(E.mean() - 1.0) < 0.02 and np.abs(E - 1.0).max() < 0.08, f"{E.min():.3f} to {E.max():.3f}"
    coarse, fine = (traced(ctx, world, sites(aside, UP), side).E[:, 0] for side in (32, 256))
    assert np.sqrt(np.mean((coarse / fine - 1.0) ** 2)) < 0.05, "seen at any angle"


# ---- both gathers -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cornell", "curved", "door"])
def test_both_gathers_agree(ctx: moderngl.Context, name: str) -> None:
    """At pixels of the reference: the mean of E within 1 %, each record within 1.5 % in root mean square at 128² faces against
    256² rays, and less fine rays differ more."""
    reference = load_reference(name)
    some = np.random.default_rng(1).permutation(len(reference.position))[:36]
    where = Sites(reference.position[some], reference.normal[some], reference.normal[some])
    lit = Lit(ctx, irrsplat.load(name), 512)
    raster = lit.gather(where, 128, "raster").E.astype(float)
    error = {}
    for side in (16, 64, 256):
        E = lit.gather(where, side).E
        error[side] = float(np.sqrt(np.mean((E - raster) ** 2)) / raster.mean())
    assert abs(E.mean() / raster.mean() - 1.0) < 0.01
    assert error[256] < 0.015, error
    assert error[256] < error[64] < error[16], error


def test_many_records_at_once_equal_each_alone(ctx: moderngl.Context) -> None:
    """Neither the cell in the atlas nor the batch may matter: the same rays bring the same light, to the last bit."""
    rng, lit = np.random.default_rng(7), Lit(ctx, room())
    where = sites(rng.uniform(-0.9, 0.9, (23, 3)), rng.normal(size=(23, 3)))
    together, alone = lit.gather(where, 16), lit.gather(where, 16, capacity=1)
    assert np.array_equal(together.E, alone.E) and np.array_equal(together.gradient, alone.gradient)
    assert together.E.std() > 0.1, "there is something to see"


# ---- gradients --------------------------------------------------------------------------------------------------------


def test_gradient_against_the_exact_one(ctx: moderngl.Context) -> None:
    """The lamp behind a board of test_gradients.py, whose ∇E is known: a median of a quarter off at 64² rays, and shrinking."""
    p, n = occluder.places()
    lit, truth = Lit(ctx, occluder.world()), occluder.gradient(p, n)
    found = {side: lit.gather(sites(p, n), side) for side in (32, 64, 128)}
    error = {side: occluder.relative(g.gradient[:, 0], truth) for side, g in found.items()}
    assert error[64] < 0.25, error
    assert error[128] < error[64] < error[32], error
    slope = (found[128].gradient[:, 0] * truth).sum() / (truth * truth).sum()
    assert slope == pytest.approx(1.0, abs=0.08), "no share of it is missing or counted twice"
    assert occluder.relative(found[64].M[:, 0], occluder.vector(p)) < 0.03


def test_gradient_against_differences_of_a_fine_gather(ctx: moderngl.Context) -> None:
    """∇E along the surface of 64² rays against differences of 65 536 directions 8 cm apart, in a room full of things."""
    lit = Lit(ctx, room())
    rng = np.random.default_rng(5)
    p, n = rng.uniform((-0.05, -0.3, -0.8), (0.8, 0.3, 0.8), (40, 3)), np.tile(UP, (40, 1))
    axes, step = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 0.04
    fine = [[lit.gather(sites(p + s * step * d, n), 256).E for s in (1.0, -1.0)] for d in axes]
    truth = np.stack([(a - b) / (2 * step) for a, b in fine], -1).reshape(-1, 2)
    error = {}
    for side in (16, 64, 128):
        found = lit.gather(sites(p, n), side).gradient[..., [0, 2]].reshape(-1, 2)
        error[side] = occluder.relative(found, truth)
    assert error[64] < 0.25, error
    assert error[128] < error[64] < error[16], error
