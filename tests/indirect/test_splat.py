"""Splatting against a numpy loop over every record and pixel: the covered pixels and their weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import NOTHING_SEEN, GBuffer, Records
from irrsplat.indirect.splat import SplatPass
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings
from tests.support.worlds import gbuffer_of, on_plane, rays, records_of

SIZE = (37, 29)
CAMERA = Camera((0.3, 0.2, 3.0), (0.0, 0.0, 0.0), (0.1, 1.0, 0.0), 50.0)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
FLOOR = 0.6  # W/m²: darker pixels may have an error of a share of this
COLUMNS = "position normal irradiance radius vectors gradient limit axis curvature max_radius noise".split()  # noqa: SIM905
BASE = Settings(a=0.5, radius_min=0.0, radius_max=0.0)


@dataclass(frozen=True)
class View:
    """Synthetic picture: pixels (H, W, 3) on their own rays, normals towards the eye, depth 0 for the background."""

    position: np.ndarray
    normal: np.ndarray
    depth: np.ndarray

    def gbuffer(self, ctx: moderngl.Context) -> GBuffer:
        return gbuffer_of(ctx, self.position, self.normal, self.depth)


@dataclass(frozen=True)
class Table:
    """Records in numpy.

    p and n (N, 3), E (N, 3), R (N,), M and ∇E (N, channel, 3), limit (N,): allowed share of the radius, or -metres. axis (N, 3):
    direction of least bend, 0 if unknown. bend (N, 2): bends along and across it. farthest (N,): the greatest radius. noise (N,):
    relative standard error.
    """

    p: np.ndarray
    n: np.ndarray
    E: np.ndarray
    R: np.ndarray
    M: np.ndarray
    gradient: np.ndarray
    limit: np.ndarray
    axis: np.ndarray
    bend: np.ndarray
    farthest: np.ndarray
    noise: np.ndarray

    def records(self, ctx: moderngl.Context) -> Records:
        return records_of(ctx, FLOOR, **dict(zip(COLUMNS, vars(self).values(), strict=True)))


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def view(seed: int = 0) -> View:
    """Return a wavy, noisy surface at depth 3, a twentieth of it holes."""
    rng = np.random.default_rng(seed)
    d = rays(CAMERA, SIZE)
    y, x = np.indices(d.shape[:2])
    depth = 3.0 + 0.5 * np.sin(x / 5.0) * np.cos(y / 7.0) + 0.02 * rng.random(d.shape[:2])
    normal = unit(np.array([0.0, 0.0, 1.0]) + 0.15 * rng.normal(size=d.shape))
    position = (np.asarray(CAMERA.eye) + depth[..., None] * d).astype("f4").astype(float)
    return View(position, normal.astype("f4").astype(float), np.where(rng.random(depth.shape) < 0.05, 0.0, depth))


def grazing(seed: int = 0) -> View:
    """Return a floor at grazing angles up to the horizon, with slightly noisy normals."""
    rng = np.random.default_rng(seed)
    position, depth = on_plane(CAMERA, SIZE, (0.0, -0.05, 0.0), (0.0, 1.0, 0.0))
    normal = unit(np.array([0.0, 1.0, 0.0]) + 0.05 * rng.normal(size=position.shape))
    depth = np.where((depth > 0.2) & (depth < 20.0), depth, 0.0)
    position = np.where(depth[..., None] > 0.0, position, 0.0)
    return View(position.astype("f4").astype(float), normal.astype("f4").astype(float), depth)


def table(count: int = 200, seed: int = 1, on: View | None = None) -> Table:
    """Return records near the surface of `on` (default: `view`), some outside the picture, behind the eye, and around it.

    Their ellipses are up to 8 times as long as wide; one bend in five is unknown.
    """
    rng = np.random.default_rng(seed)
    on = on or view()
    there = np.flatnonzero(on.depth.ravel() > 0.0)
    at = rng.choice(there, count)
    p = on.position.reshape(-1, 3)[at] + rng.uniform(-0.02, 0.02, (count, 3))
    n = unit(on.normal.reshape(-1, 3)[there].mean(0) + 0.1 * rng.normal(size=(count, 3)))
    R = rng.uniform(0.1, 1.5, count)
    if count > 4:
        p[:4] = [(2.5, 0, 0), (0, 0, 3.6), (0.3, 0.2, 3.05), (0.0, 0.1, 4.0)]
        R[:4] = 3.0, 8.0, 9.0, 12.0
    values = [p, n, rng.uniform(0, 3, (count, 3)), R]
    values += [n[:, None] * values[2][..., None] + 0.3 * rng.normal(size=(count, 3, 3)), 0.5 * rng.normal(size=(count, 3, 3))]
    values.append(np.where(rng.random(count) < 0.3, rng.uniform(-0.3, 1.0, count), 1.0))
    known = (rng.random(count) < 0.8) | (count == 1)
    values.append(known[:, None] * unit(np.cross(n, rng.normal(size=(count, 3)))))
    radii = R[:, None] * np.stack([rng.uniform(1.0, 8.0, count) ** 0.5, rng.uniform(1.0, 8.0, count) ** -0.5], 1)
    values.append(known[:, None] * rng.choice([-2.0, 2.0], (count, 2)) / radii**2)
    values += [np.where(rng.random(count) < 0.2, R, 100.0), rng.uniform(0.0, 0.5, count)]
    return Table(*(v.astype("f4").astype(float) for v in values))


def splat(seen: View, records: Table, settings: Settings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sums (H, W, 4), weight (H, W, 2), and the pixels where rounding may decide a record's contribution.

    Ward et al. 1988: w = 1/(|p-p_k|/R + √(1-n·n_k)) for w > 1/a. With bends, |p-p_k|/R is taken along and across an axis,
    with R = √(2/|bend|) or the maximum. Otherwise R is at most E/|∇E| on luminance if gradients exist. Radii are finite,
    limited by the allowed share and by the view. A record in front of the pixel's surface, or behind it by more than R/20,
    has no weight. The second weight is Σ k·(Y² - σ²).
    """
    sums, weight = np.zeros((*seen.depth.shape, 4)), np.zeros((*seen.depth.shape, 2))
    unsure = np.zeros(seen.depth.shape, bool)
    screen = 2.0 * np.tan(np.radians(CAMERA.fov) / 2.0) / 100.0
    a = settings.a
    for p_k, n_k, E_k, R_k, M, gradient, limit, axis, bend, most, noise in zip(*vars(records).values(), strict=True):
        d = np.linalg.norm(np.asarray(CAMERA.eye) - p_k)
        known = settings.gradients and axis.any()
        own = np.array([R_k, R_k])
        if known and settings.hessian:
            share = max(E_k @ LUMINANCE, FLOOR) / max(E_k @ LUMINANCE, 1e-20)
            own = np.minimum(np.sqrt(2.0 * share / np.maximum(np.abs(bend), 1e-30)), most)
        elif settings.gradients:
            own = np.minimum(own, max(E_k @ LUMINANCE, FLOOR) / np.maximum(np.linalg.norm(LUMINANCE @ gradient), 1e-30))
        widest, allowed = (-limit, 1.0) if limit < 0.0 else (np.inf, limit)
        r = np.maximum(a * own * allowed, settings.radius_min * screen * d)
        if settings.radius_max > 0.0:
            r = np.minimum(r, settings.radius_max * screen * d)
        r = np.minimum(r, widest)
        R = r / a
        trust = min(1.0, a * own[1] * allowed / r[1])
        apart = seen.position - p_k
        cosine = seen.normal @ n_k
        along = apart @ axis
        turn = np.sqrt(np.maximum(0.0, 1.0 - cosine))
        e = np.sqrt(along**2 / R[0] ** 2 + ((apart**2).sum(-1) - along**2) / R[1] ** 2) + turn
        w = 1.0 / np.maximum(e, 1e-3)
        front = 0.05 * R[1] - np.abs((apart * (seen.normal + n_k)).sum(-1)) / 2.0
        speaks = (seen.depth > 0.0) & (w > 1.0 / a)
        near = np.abs(w * a - 1.0) < 2e-4
        near |= speaks & (w * 6e-8 / np.maximum(turn, 1e-6) > 1e-4)  # for nearly equal normals, 1 - n·n_k is rounding error
        if settings.hessian:
            speaks &= (cosine > 0.0) & (front >= 0.0)
            near |= (np.abs(front) < 1e-5) | (np.abs(cosine) < 1e-5)
        unsure |= near & (seen.depth > 0.0)
        k = np.where(speaks, w - 1.0 / a if settings.hessian else w, 0.0)
        E: np.ndarray = np.broadcast_to(E_k, seen.position.shape)
        if settings.gradients:
            E = seen.normal @ M.T + 0.75 * (1.0 - cosine)[..., None] * (M @ n_k)
            moved = E + apart @ (gradient.T * trust)
            if settings.hessian and known:
                across = (apart**2).sum(-1) - along**2 - (apart @ n_k) ** 2
                more = trust**2 * (bend[0] * along**2 + bend[1] * across) / 2.0
                moved = moved + np.clip(more, -0.5, 0.5)[..., None] * E
            Y_k = E @ LUMINANCE
            E = np.clip(moved, 0.0, np.maximum(2.0 * E, 0.0))
            share = np.clip(E @ LUMINANCE / np.where(Y_k > 0.0, 0.1 * Y_k, np.inf), 1e-3, 1.0)
            known = np.where(Y_k > 0.0, share, 1.0)
            w, k = w * known, k * known
        sums += k[..., None] * np.concatenate([E, np.ones_like(E[..., :1])], -1)
        weight += np.stack([np.where(speaks, w, 0.0), k * (E @ LUMINANCE) ** 2 * (1.0 - noise**2)], -1)
    return sums, weight, unsure


def drawn(ctx: moderngl.Context, seen: View, records: Table, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """Return the GPU's sums and weights."""
    gbuffer, splatter = seen.gbuffer(ctx), SplatPass(ctx, SIZE)
    splatter.clear(gbuffer)
    splatter(records.records(ctx), np.arange(len(records.p)), gbuffer, CAMERA, settings)
    return splatter.target(1).read(0).copy(), splatter.target(1).read(1)[..., :2].copy()


VARIANTS = {
    "hessian": BASE,
    "without gradients": replace(BASE, gradients=False),
    "weights of the paper": replace(BASE, weights="paper"),
    "paper": replace(BASE, gradients=False, weights="paper", a=0.3),
    "large a": replace(BASE, a=1.5),
    "bounded radius": replace(BASE, radius_min=6.0, radius_max=8.0),
}


@pytest.mark.parametrize(("surface", "name"), [(view, name) for name in VARIANTS] + [(grazing, "hessian"), (grazing, "large a")])
def test_splatting_equals_numpy(ctx: moderngl.Context, surface: Callable[[], View], name: str) -> None:
    """Every pixel covered in numpy is covered on the GPU: no quad cuts an ellipse of any length at any angle."""
    seen, settings = surface(), VARIANTS[name]
    records = table(on=seen)
    sums, weight, unsure = splat(seen, records, settings)
    found_sums, found_weight = drawn(ctx, seen, records, settings)
    visible = seen.depth > 0.0
    here = ~unsure & visible
    assert here.sum() > 0.8 * visible.sum() and (weight[here, 0] > 0.0).mean() > 0.2, "the test has something to compare"
    assert np.allclose(found_weight[here, 0], weight[here, 0], rtol=1e-4)
    assert np.allclose(found_weight[here, 1], weight[here, 1], rtol=1e-3, atol=1e-5 * weight[here, 1].max())
    scale = np.abs(sums[visible]).max()
    assert np.allclose(found_sums[here], sums[here], rtol=5e-4, atol=1e-5 * scale)
    assert (found_weight[~visible, 0] >= NOTHING_SEEN).all() and not found_sums[~visible].any(), "nothing is said of nothing"
    assert not found_weight[~visible, 1].any()


def test_a_record_within_a_closed_mesh_leaves_its_pixel_to_others(ctx: moderngl.Context) -> None:
    """A record with maximum radius 0 covers only the pixel that requested it, and contributes 0 alone.

    Other records within reach determine that pixel's light.
    """
    position, depth = on_plane(CAMERA, SIZE, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    seen = View(position, np.broadcast_to([0.0, 0.0, 1.0], position.shape), depth)
    records = table(2)
    records.p[:], records.n[:], records.axis[:], records.limit[:] = position[14, [18, 16]], (0, 0, 1), (1, 0, 0), 1.0
    records.gradient[:], records.bend[:], records.farthest[:] = 0.0, [[18.0, 18.0], [1e-3, 1e-3]], [0.0, 2.0]
    records.E[0], records.M[0], records.E[1], records.M[1] = 0.0, 0.0, 3.0, np.outer((3.0, 3.0, 3.0), (0, 0, 1))
    records.farthest[1] = 1.0
    sums, weight = drawn(ctx, seen, records, BASE)
    assert np.allclose(sums[14, 18, :3] / sums[14, 18, 3], 3.0, rtol=1e-2) and weight[14, 18, 0] > 100.0
    alone = Table(*(v[:1] for v in vars(records).values()))
    sums, weight = drawn(ctx, seen, alone, BASE)
    assert not sums[..., :3].any() and (weight[..., 0] > 0.0).sum() == 1 and weight[14, 18, 0] > 1.0 / BASE.a


@pytest.mark.parametrize(("weights", "a"), [("hessian", 0.4), ("paper", 1.0)])
def test_a_quadratic_field_is_extrapolated_exactly(ctx: moderngl.Context, weights: str, a: float) -> None:
    """E = 2 + s·q + ½ Σ h q² in the plane's own axes: one record extrapolates it exactly with second derivatives only."""
    position, depth = on_plane(CAMERA, SIZE, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    seen = View(position, np.broadcast_to([0.0, 0.0, 1.0], position.shape), depth)
    axis, slope, h = unit(np.array([0.6, -0.8, 0.0])), np.array([0.3, 0.2, 0.0]), np.array([-0.1, 0.7])
    other = np.cross((0, 0, 1), axis)
    colour = np.array([1.0, 0.5, 2.0])
    records = table(1)
    records.p[0], records.n[0], records.limit[0] = position[14, 18], (0, 0, 1), 1.0
    records.E[0], records.M[0], records.gradient[0] = 2.0 * colour, 2.0 * np.outer(colour, (0, 0, 1)), np.outer(colour, slope)
    records.axis[0], records.bend[0] = axis, h / 2.0
    settings = replace(BASE, a=a, weights=weights)
    sums, _ = drawn(ctx, seen, records, settings)
    q = position - position[14, 18]
    truth = (2.0 + q @ slope + 0.5 * (h[0] * (q @ axis) ** 2 + h[1] * (q @ other) ** 2))[..., None] * colour
    served = sums[..., 3] > 0.02
    assert served.sum() > 100
    off = np.abs(sums[served][:, :3] / sums[served][:, 3:] - truth[served]) / truth[served]
    assert off.max() < 1e-3 if weights == "hessian" else off.max() > 0.05


@pytest.mark.parametrize("angle", [0.0, 20.0])
def test_even_light_hardly_falls_as_the_surface_turns(ctx: moderngl.Context, angle: float) -> None:
    """Uniform radiance L gives E = π·L on any normal, but a record on another normal covers its own hemisphere only.

    n·M has the cosine of that part; a quarter of the missing part remains as an error.
    """
    position, depth = on_plane(CAMERA, SIZE, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    colour = np.array([1.0, 0.5, 2.0])
    records = table(1)
    records.p[0], records.n[0], records.limit[0] = position[14, 18], (0, 0, 1), 1.0
    records.E[0], records.M[0], records.gradient[0] = np.pi * colour, np.pi * np.outer(colour, (0, 0, 1)), 0.0
    records.axis[0], records.bend[0], records.farthest[0] = (1, 0, 0), 1e-9, 4.5
    turned = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    seen = View(position, np.broadcast_to(turned, position.shape), depth)
    sums, _ = drawn(ctx, seen, records, BASE)
    served = sums[..., 3] > 0.0
    assert served.sum() > 20
    lacks = 1.0 - sums[served][:, :3] / sums[served][:, 3:] / (np.pi * colour)
    assert np.abs(lacks).max() <= 0.26 * (1.0 - turned[2]) + 1e-4


def test_a_record_without_light_extrapolates_none(ctx: moderngl.Context) -> None:
    """E = 0 without derivatives and with maximum radii extrapolates to 0, without NaN."""
    seen, records = view(), table(3)
    records.E[:], records.M[:], records.gradient[:] = 0.0, 0.0, 0.0
    records.bend[:], records.farthest[:] = 0.0, 4.0
    for settings in (BASE, VARIANTS["weights of the paper"], VARIANTS["without gradients"]):
        sums, weight = drawn(ctx, seen, records, settings)
        assert not sums[..., :3].any() and np.isfinite(sums).all() and np.isfinite(weight).all()
        assert (weight[seen.depth > 0.0, 0] > 0.0).any()


def test_a_record_at_its_own_pixel_is_finite(ctx: moderngl.Context) -> None:
    """At the record's own pixel e = 0, and w = 1/max(e, 10⁻³) = 1000."""
    seen = view()
    seen.depth[:] = 100.0  # farther than all records
    records = table(1)
    records.p[0], records.n[0], records.bend[0] = seen.position[11, 13], seen.normal[11, 13], 2.0 / 0.2**2
    _, weight = drawn(ctx, seen, records, BASE)
    assert weight[11, 13, 0] == pytest.approx(1000.0, rel=1e-3)


def test_the_smallest_record_reaches_its_pixel(ctx: moderngl.Context) -> None:
    """A sphere far smaller than a pixel covers the pixel that requested it; otherwise requests would never end."""
    seen = view()
    seen.depth[:] = 100.0  # farther than all records
    for row, column in ((0, 0), (28, 36), (14, 18)):
        records = table(1)
        records.p[0], records.n[0], records.bend[0] = seen.position[row, column], seen.normal[row, column], 2.0 / 1e-6**2
        _, weight = drawn(ctx, seen, records, BASE)
        assert weight[row, column, 0] > 1.0 / BASE.a
        assert ((weight[..., 0] > 0.0) & (seen.depth > 0.0)).sum() == 1
