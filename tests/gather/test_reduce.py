"""Reduction against plain numpy sums: E, R, irradiance vectors, gradients and bends of synthetic cells."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import Atlas
from irrsplat.core.glsl import NEIGHBOUR_STRIDE
from irrsplat.gather.plane import plane_edges, plane_table
from irrsplat.gather.record_frame import tangent_frames
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu.target import table_texture
from irrsplat.records.record_cache import RecordCache
from tests.support.worlds import sites

SKY = (0.3, 0.7, 1.1)
SKY_GRADIENT, SKY_UP = np.array([0.1, -0.05, 0.2]), np.array([0.6, 0.0, -0.8])
RADII = (1e-3, 4.0)
COLUMNS, ROWS = 3, 4  # of cells in the atlas
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709


def cells(count: int, side: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random radiance (N, h, w, 4) over four orders of magnitude, and distances, a third of them misses; and the table."""
    rng = np.random.default_rng(seed)
    table = plane_table(side)
    seen = np.empty((count, *table.shape[:2], 4))
    seen[..., :3] = 10.0 ** rng.uniform(-2, 2, seen[..., :3].shape)
    seen[..., 3] = np.where(rng.random(seen.shape[:3]) < 0.33, 0.0, 10.0 ** rng.uniform(-1, 1, seen.shape[:3]))
    return seen.astype("f4"), table


def planes_of(seen: np.ndarray, table: np.ndarray, frame: np.ndarray, seed: int) -> np.ndarray:
    """Return for each hit (N, h, w, 3) a plane of random slope in world space, as in the gather."""
    rng = np.random.default_rng(seed)
    d = np.einsum("hwk,nkj->nhwj", table[..., :3], frame)
    g = d + rng.normal(size=d.shape) * rng.choice([0.05, 0.5, 3.0], d.shape[:3])[..., None]
    distance = seen[..., 3]
    scaled = g / ((g * d).sum(-1) * np.where(distance > 0.0, distance, 1.0))[..., None]
    return np.where(distance[..., None] > 0.0, scaled, 0.0).astype("f4")


def atlas_of(
    ctx: moderngl.Context,
    seen: np.ndarray,
    side: int,
    frame: np.ndarray,
    geometric: np.ndarray,
    planes: np.ndarray | None = None,
    numbers: np.ndarray | None = None,
) -> Atlas:
    """Return the cells row by row, as the gather draws them; unused texels hold arbitrary values."""
    height, width = seen.shape[1:3]
    sheet, planar = (np.full((ROWS * height, COLUMNS * width, 4), 7e7, "f4") for _ in range(2))
    for i, cell in enumerate(seen):
        y, x = i // COLUMNS * height, i % COLUMNS * width
        sheet[y : y + height, x : x + width] = cell
        planar[y : y + height, x : x + width] = 0.0
        planar[y : y + height, x : x + width, :3] = 0.0 if planes is None else planes[i]
    rows = np.zeros((4, COLUMNS * ROWS, 4))
    rows[:3, : len(seen), :3] = frame.swapaxes(0, 1)
    rows[3, : len(seen), :3] = np.einsum("nij,nj->ni", frame, geometric)
    rows[3, : len(seen), 3] = np.arange(len(seen)) if numbers is None else numbers
    return Atlas(
        table_texture(ctx, sheet),
        table_texture(ctx, planar),
        table_texture(ctx, plane_table(side)),
        table_texture(ctx, plane_edges(side)),
        table_texture(ctx, rows),
        len(seen),
        COLUMNS,
        (width, height),
        (side // 4, side // 4),
    )


def reduced(
    seen: np.ndarray, side: int, frame: np.ndarray, geometric: np.ndarray, planes: np.ndarray | None = None
) -> tuple[np.ndarray, ...]:
    """Return in float64 E (N, 3), R (N,), M and ∇E (N, channel, 3), and the Hessian of luminance (N, 2, 2) in the tangent
    plane.
    """
    table, edges = plane_table(side), plane_edges(side)
    height, width = table.shape[:2]
    below = np.einsum("nij,nj->ni", frame, geometric)  # the geometric normal in the record's frame
    above = np.einsum("hwk,nk->nhw", table[..., :3], below) > 0.0
    hit = seen[..., 3] > 0.0
    rise = np.einsum("hwk,nkj,j->nhw", table[..., :3], frame, SKY_UP)
    L = np.where(hit[..., None], seen[..., :3], SKY + rise[..., None] * SKY_GRADIENT).astype(float)
    inverse = np.where(hit, 1.0 / np.where(hit, seen[..., 3], 1.0), 0.0).astype(float)
    planes = np.zeros((*seen.shape[:3], 3)) if planes is None else planes.astype(float)
    share = np.where(above, table[..., 3], 0.0)
    E = np.einsum("nhw,nhwc->nc", share, L)
    R = np.clip(share.sum((1, 2)) / np.maximum((share * inverse).sum((1, 2)), 1e-30), *RADII)
    M = np.einsum("nhw,nhwc,hwk->nck", share, L, table[..., :3] / table[..., 2:3])
    gradient, hessian = np.zeros((len(seen), 3, 3)), np.zeros((len(seen), 2, 2))
    y, x = np.indices((height, width))
    for j in (0, 1):
        edge = edges[:, j::2]
        row = np.floor(edge[..., 3] / NEIGHBOUR_STRIDE).astype(int)
        column = (edge[..., 3] - NEIGHBOUR_STRIDE * row).astype(int)
        # intersection direction of both planes, and the nearer one's distance there, at most the nearer hit distance
        w = table[..., :3] + table[row, column, :3]
        w /= np.linalg.norm(w, axis=-1, keepdims=True)
        outward = np.einsum("hwk,nkj->nhwj", w, frame)
        near = np.maximum((planes * outward).sum(-1), (planes[:, row, column] * outward).sum(-1))
        near = np.clip(near, 0.0, np.maximum(inverse, inverse[:, row, column]))
        change = (above & above[:, row, column])[..., None] * (L[:, row, column] - L)
        gradient += np.einsum("nhw,nhwc,hwk->nck", near, change, edge[..., :3])
        outer = np.einsum("nhw,hwk,hwl->nkl", 4.0 * near**2 * (change @ LUMINANCE), edge[..., :2], w[..., :2])
        hessian += (outer + outer.swapaxes(1, 2)) / 2.0
        assert (abs(row - y) + abs(column - x) < height + width).all()
    return E, R, np.einsum("nck,nkj->ncj", M, frame), np.einsum("nck,nkj->ncj", gradient, frame), hessian


def reduce(ctx: moderngl.Context, atlas: Atlas, cache: RecordCache, gradients: bool = True) -> None:
    """Run the pass; leave no released framebuffer bound for the next test (see test_target.py)."""
    sky = {"sky": SKY, "sky_gradient": SKY_GRADIENT, "sky_up": SKY_UP}
    ReducePass(ctx, gradients)(atlas, cache.records, sky, RADII)
    ctx.detect_framebuffer(0).use()


def vectors_of(cache: RecordCache, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return M and ∇E (N, channel, 3) of the records from number `first` on."""
    vectors, gradient = cache.records.read("vectors", "gradient").values()
    return vectors[first:], gradient[first:]


def bends_of(cache: RecordCache, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the axis (N, 3) and the two bends (N, 2) of the records from number `first` on."""
    names = ("radius", "axis", "curvature", "max_radius")
    R, axis, curvature, max_radius = (column[first:] for column in cache.records.read(*names).values())
    most = np.where(axis.any(1), np.minimum(3.0 * R, RADII[1]), R)
    assert np.allclose(max_radius, most, rtol=1e-6), "three times R with second derivatives, else R"
    return axis, curvature


@pytest.mark.parametrize("first", [0, 5, 1019])  # 1019: the batch crosses the end of a row of the cache
@pytest.mark.parametrize("side", [8, 16])
def test_reduction_equals_numpy(ctx: moderngl.Context, side: int, first: int) -> None:
    count = 10  # of 12 cells
    rng = np.random.default_rng(first)
    normal = rng.normal(size=(count, 3))
    where = sites(rng.normal(size=(count, 3)), normal)
    frame = tangent_frames(where.normal, np.arange(count), 0)
    seen, table = cells(count, side, seed=first + 1)
    planes = planes_of(seen, table, frame, seed=first + 2)
    cache = RecordCache(ctx)
    if first:
        cache.append(sites(np.zeros((first, 3)), (0, 1, 0)), np.full((first, 4), 42.0, "f4"))
    cache.append(where)
    numbers = first + np.arange(count)
    reduce(ctx, atlas_of(ctx, seen, side, frame, where.geometric, planes, numbers), cache)

    E, R, M, gradient, hessian = reduced(seen, side, frame, where.geometric, planes)
    found = cache.read()
    assert np.allclose(found["irradiance"][first:], E, rtol=2e-5)
    assert np.allclose(found["radius"][first:], R, rtol=2e-5)
    found_M, found_gradient = vectors_of(cache, first)
    assert np.allclose(found_M, M, rtol=1e-4, atol=2e-5 * np.abs(M).max())
    # rounding of a sum with mixed signs is that of its terms
    assert np.allclose(found_gradient, gradient, rtol=1e-3, atol=2e-5 * np.abs(gradient).max())
    assert (found["irradiance"][:first] == 42.0).all() and (found["radius"][:first] == 42.0).all(), "others stay as they were"

    value, way = np.linalg.eigh(hessian)
    order = np.argsort(np.abs(value), axis=1)
    value, way = np.take_along_axis(value, order, 1), np.take_along_axis(way, order[:, None], 2)
    Y = E @ LUMINANCE
    scale = np.abs(value).max() / Y.min()
    axis, bend = bends_of(cache, first)
    assert np.allclose(np.linalg.norm(axis, axis=1), 1.0, atol=1e-5)
    assert np.abs((axis * where.normal).sum(1)).max() < 1e-5, "in the tangent plane"
    clear = np.abs(value[:, 1]) - np.abs(value[:, 0]) > 0.01 * np.abs(value[:, 1])  # otherwise rounding decides the smaller one
    assert clear.sum() >= 6
    expected = np.clip(value / Y[:, None], -2.0 / RADII[0] ** 2, 2.0 / RADII[0] ** 2)
    assert np.allclose(bend[clear], expected[clear], rtol=2e-3, atol=1e-4 * scale)
    along = np.einsum("nk,nkj->nj", way[..., 0], frame[:, :2])
    assert np.abs((along * axis).sum(1))[clear].min() > 0.9999
    assert (np.abs(bend[:, 0]) <= np.abs(bend[:, 1]) * (1.0 + 1e-5)).all(), "it bends less along the axis"
    before, none = bends_of(cache)
    assert not before[:first].any() and not none[:first].any(), "nobody has looked how those bend"


@pytest.mark.parametrize("light", ["black", "even"])
def test_where_nothing_changes_nothing_bends(ctx: moderngl.Context, light: str) -> None:
    """Without light, or with uniform light: radii are unlimited, an axis exists, and no value is NaN."""
    where = sites(np.zeros((4, 3)), np.random.default_rng(0).normal(size=(4, 3)))
    frame = tangent_frames(where.normal, np.arange(4), 0)
    seen, table = cells(4, 8, seed=3)
    seen[..., :3] = 0.0 if light == "black" else 2.0
    seen[..., 3] = np.maximum(seen[..., 3], 0.1)  # no sky
    planes = planes_of(seen, table, frame, 1)
    cache = RecordCache(ctx)
    cache.append(where)
    reduce(ctx, atlas_of(ctx, seen, 8, frame, where.geometric, planes), cache)
    axis, bend = bends_of(cache)
    assert np.allclose(np.linalg.norm(axis, axis=1), 1.0, atol=1e-5) and not bend.any()
    assert not vectors_of(cache)[1].any()


@pytest.mark.parametrize(("distance", "radius"), [(0.0, RADII[1]), (1e-9, RADII[0]), (1e9, RADII[1]), (0.5, 0.5)])
def test_radius_stays_finite_and_within_its_limits(ctx: moderngl.Context, distance: float, radius: float) -> None:
    """All directions miss: R is the maximum; all distances equal: R is that distance."""
    where = sites(np.zeros((1, 3)), (0, 1, 0))
    frame = tangent_frames(where.normal, np.arange(1), 0)
    seen, _ = cells(1, 8, seed=5)
    seen[..., 3] = distance
    cache = RecordCache(ctx)
    cache.append(where)
    reduce(ctx, atlas_of(ctx, seen, 8, frame, where.geometric), cache)
    assert cache.read()["radius"][0] == pytest.approx(radius, rel=1e-5)
