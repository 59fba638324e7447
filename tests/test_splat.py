"""Splatting against a loop over every record and pixel in numpy: which pixels a record speaks for, and with what weight."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np
import pytest

from irrsplat.buffers import NOTHING_SEEN, GBuffer, Records
from irrsplat.gpu.target import table_texture
from irrsplat.passes.splat import SplatPass
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings
from tests.worlds import gbuffer_of, rays

SIZE = (37, 29)
CAMERA = Camera((0.3, 0.2, 3.0), (0.0, 0.0, 0.0), (0.1, 1.0, 0.0), 50.0)
COLUMNS = 8
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
BASE = Settings(a=0.5, radius_min=0.0, radius_max=0.0)


@dataclass(frozen=True)
class View:
    """A made-up picture: pixels (H, W, 3) on their own rays, normals towards the eye, depth 0 where nothing is seen."""

    position: np.ndarray
    normal: np.ndarray
    depth: np.ndarray

    def gbuffer(self, ctx: moderngl.Context) -> GBuffer:
        return gbuffer_of(ctx, self.position, self.normal, self.depth)


@dataclass(frozen=True)
class Table:
    """Records: p and n (N, 3), E (N, 3), R (N,), M and ∇E (N, channel, 3), and what R may be at most (N,)."""

    p: np.ndarray
    n: np.ndarray
    E: np.ndarray
    R: np.ndarray
    M: np.ndarray
    gradient: np.ndarray
    limit: np.ndarray

    def records(self, ctx: moderngl.Context) -> Records:
        count = len(self.p)
        rows = -(-count // COLUMNS)

        def texture(rgb: np.ndarray, w: np.ndarray | float = 0.0) -> moderngl.Texture:
            whole = np.full((rows * COLUMNS, 4), 1e6)  # beyond the last record lies rubbish
            whole[:count, :3], whole[:count, 3] = rgb, w
            return table_texture(ctx, whole.reshape(rows, COLUMNS, 4))

        limit = texture(np.repeat(self.limit[:, None], 3, axis=1))
        vectors = [texture(v[:, i]) for v in (self.M, self.gradient) for i in range(3)]
        return Records(texture(self.p), texture(self.n), texture(self.E, self.R), tuple(vectors), count, COLUMNS, limit)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def view(seed: int = 0) -> View:
    """A wavy, noisy surface at depth 3, a twentieth of it holes."""
    rng = np.random.default_rng(seed)
    d = rays(CAMERA, SIZE)
    y, x = np.indices(d.shape[:2])
    depth = 3.0 + 0.5 * np.sin(x / 5.0) * np.cos(y / 7.0) + 0.02 * rng.random(d.shape[:2])
    normal = unit(np.array([0.0, 0.0, 1.0]) + 0.15 * rng.normal(size=d.shape))
    position = (np.asarray(CAMERA.eye) + depth[..., None] * d).astype("f4").astype(float)
    return View(position, normal.astype("f4").astype(float), np.where(rng.random(depth.shape) < 0.05, 0.0, depth))


def table(count: int = 200, seed: int = 1) -> Table:
    """Records near the surface of `view`, some of them beside the picture, behind the eye, and around it."""
    rng = np.random.default_rng(seed)
    p = view().position.reshape(-1, 3)[rng.integers(0, SIZE[0] * SIZE[1], count)] + rng.uniform(-0.05, 0.05, (count, 3))
    R = rng.uniform(0.1, 1.5, count)
    if count > 4:
        p[:4] = [(2.5, 0, 0), (0, 0, 3.6), (0.3, 0.2, 3.05), (0.0, 0.1, 4.0)]
        R[:4] = 3.0, 8.0, 9.0, 12.0
    values = [p, unit(np.array([0.0, 0.0, 1.0]) + 0.1 * rng.normal(size=(count, 3))), rng.uniform(0, 3, (count, 3)), R]
    values += [rng.normal(size=(count, 3, 3)), 0.5 * rng.normal(size=(count, 3, 3))]
    values.append(np.where(rng.random(count) < 0.3, rng.uniform(0.05, 1.0, count), 1e30))
    return Table(*(v.astype("f4").astype(float) for v in values))


def splat(seen: View, records: Table, settings: Settings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sums (H, W, 4), weight (H, W), and the pixels where rounding may decide whether a record speaks.

    Ward et al. 1988: w = 1/(|p-p_k|/R + √(1-n·n_k)), where w > 1/a; finite, R at most E/|∇E| on luminance where there are
    gradients, then limited by the view; neither in front of the pixel's surface nor behind it by more than R/20.
    """
    sums, weight = np.zeros((*seen.depth.shape, 4)), np.zeros(seen.depth.shape)
    unsure = np.zeros(seen.depth.shape, bool)
    screen = 2.0 * np.tan(np.radians(CAMERA.fov) / 2.0) / 100.0
    a = settings.a
    for p_k, n_k, E_k, R_k, M, gradient, limit in zip(*vars(records).values(), strict=True):
        d = np.linalg.norm(np.asarray(CAMERA.eye) - p_k)
        if settings.gradients:
            R_k = min(R_k, E_k @ LUMINANCE / np.linalg.norm(LUMINANCE @ gradient))
        R_k = min(R_k, limit)
        r = max(a * R_k, settings.radius_min * screen * d)
        if settings.radius_max > 0.0:
            r = min(r, settings.radius_max * screen * d)
        R = r / a
        apart = seen.position - p_k
        cosine = seen.normal @ n_k
        e = np.linalg.norm(apart, axis=-1) / R + np.sqrt(np.maximum(0.0, 1.0 - cosine))
        w = 1.0 / np.maximum(e, 1e-3)
        front = 0.05 * R - np.abs((apart * (seen.normal + n_k)).sum(-1)) / 2.0
        speaks = (seen.depth > 0.0) & (w > 1.0 / a)
        near = np.abs(w * a - 1.0) < 2e-4
        if settings.in_front:
            speaks &= (cosine > 0.0) & (front >= 0.0)
            near |= (np.abs(front) < 1e-5) | (np.abs(cosine) < 1e-5)
        unsure |= near & (seen.depth > 0.0)
        k = np.where(speaks, w if settings.kernel == "cut" else w - 1.0 / a, 0.0)
        E: np.ndarray = np.broadcast_to(E_k, seen.position.shape)
        if settings.gradients:
            turned = seen.normal @ M.T
            moved = turned + apart @ (gradient.T * min(1.0, a * R_k / r))
            E = np.clip(moved, 0.0, np.maximum(2.0 * turned, 0.0))
        sums += k[..., None] * np.concatenate([E, np.ones_like(E[..., :1])], -1)
        weight += np.where(speaks, w, 0.0)
    return sums, weight, unsure


def drawn(ctx: moderngl.Context, seen: View, records: Table, settings: Settings, *parts: int) -> tuple[np.ndarray, np.ndarray]:
    """The GPU's sums and weight, the records splatted in parts that end at the given counts, and at last all."""
    gbuffer, splatter = seen.gbuffer(ctx), SplatPass(ctx, SIZE, settings.gradients)
    splatter.clear(gbuffer)
    first = 0
    for count in (*parts, len(records.p)):
        splatter(replace(records.records(ctx), count=count), first, gbuffer, CAMERA, settings)
        first = count
    return splatter.target.read(0).copy(), splatter.target.read(1)[..., 0].copy()


VARIANTS = {
    "smooth": BASE,
    "cut": replace(BASE, kernel="cut"),
    "no in-front test": replace(BASE, in_front=False),
    "without gradients": replace(BASE, gradients=False),
    "paper": replace(BASE, gradients=False, kernel="cut", in_front=False, a=0.3),
    "large a": replace(BASE, a=1.5),
    "least radius": replace(BASE, radius_min=12.0),
    "greatest radius": replace(BASE, radius_max=8.0),
    "both": replace(BASE, radius_min=6.0, radius_max=8.0),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_splatting_equals_numpy(ctx: moderngl.Context, name: str) -> None:
    seen, records, settings = view(), table(), VARIANTS[name]
    sums, weight, unsure = splat(seen, records, settings)
    found_sums, found_weight = drawn(ctx, seen, records, settings)
    sure, surface = ~unsure, seen.depth > 0.0
    assert sure.mean() > 0.8 and (weight[surface & sure] > 0.0).mean() > 0.2, "the test has something to compare"
    assert np.allclose(found_weight[surface & sure], weight[surface & sure], rtol=1e-4)
    scale = np.abs(sums[surface]).max()
    assert np.allclose(found_sums[sure & surface], sums[sure & surface], rtol=5e-4, atol=1e-5 * scale)
    assert (found_weight[~surface] >= NOTHING_SEEN).all() and not found_sums[~surface].any(), "nothing is said of nothing"


def test_a_record_at_its_own_pixel_is_finite(ctx: moderngl.Context) -> None:
    """e = 0 there, and w = 1/max(e, 10⁻³) = 1000."""
    seen = view()
    seen.depth[:] = 3.0
    records = table(1)
    records.p[0], records.n[0], records.R[0] = seen.position[11, 13], seen.normal[11, 13], 0.2
    _, weight = drawn(ctx, seen, records, BASE)
    assert weight[11, 13] == pytest.approx(1000.0, rel=1e-3)


def test_the_smallest_record_reaches_its_pixel(ctx: moderngl.Context) -> None:
    """A sphere far smaller than a pixel must still serve the pixel that asked for it, or it would be asked for for ever."""
    seen = view()
    seen.depth[:] = 3.0
    for row, column in ((0, 0), (28, 36), (14, 18)):
        records = table(1)
        records.p[0], records.n[0], records.R[0] = seen.position[row, column], seen.normal[row, column], 1e-6
        _, weight = drawn(ctx, seen, records, BASE)
        assert weight[row, column] > 1.0 / BASE.a
        assert ((weight > 0.0) & (seen.depth > 0.0)).sum() == 1


def test_parts_are_the_whole_bit_for_bit(ctx: moderngl.Context) -> None:
    """Blending adds in the records' order, however many draws there are."""
    seen, records = view(), table()
    for one, other in zip(drawn(ctx, seen, records, BASE), drawn(ctx, seen, records, BASE, 1, 17, 40), strict=True):
        assert np.array_equal(one, other)


def test_no_extrapolation_below_black_or_beyond_twice(ctx: moderngl.Context) -> None:
    """However steep the gradient is, 0 ≤ E ≤ 2·n·M."""
    seen, records = view(), table(1)
    records.p[0], records.R[0], records.n[0] = seen.position[14, 18], 3.0, (0, 0, 1)
    records.E[0], records.M[0], records.gradient[0] = 1e6, (0.0, 0.0, 1.0), 100.0  # so bright that R stays what it is
    sums, _ = drawn(ctx, seen, records, BASE)
    E = sums[..., :3][sums[..., 3] > 0] / sums[..., 3:][sums[..., 3] > 0]
    assert len(E) > 50
    assert E.min() >= 0.0 and E.max() <= 2.0 + 1e-4


def test_a_gradient_is_bounded_where_the_radius_was_raised(ctx: moderngl.Context) -> None:
    """A record of a·R = 1 cm that the view raises to 70 cm: at its new rim E differs by what its gradient says of 1 cm."""
    seen, records = view(), table(1)
    records.p[0], records.n[0], records.R[0], records.limit[0] = seen.position[14, 18], (0, 0, 1), 0.02, 1e30
    records.E[0], records.M[0], records.gradient[0] = 1e6, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    records.gradient[0, :, 0] = 20.0  # per metre
    flat = View(
        seen.position * (1.0, 1.0, 0.0) + records.p[0] * (0.0, 0.0, 1.0),
        np.broadcast_to((0.0, 0.0, 1.0), seen.normal.shape),
        seen.depth,
    )
    flat.depth[:] = 3.0
    sums, _ = drawn(ctx, flat, records, replace(BASE, radius_min=25.0))
    E = sums[..., 0][sums[..., 3] > 0] / sums[..., 3][sums[..., 3] > 0]
    assert len(E) > 100
    assert 0.1 < np.abs(E - 1.0).max() <= 20.0 * 0.01
