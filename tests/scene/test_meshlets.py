"""Meshlets: every triangle is in one, boxes bound them, and what is left out of a view is what no pixel of it sees."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import Atlas, Sites
from irrsplat.gather import raster
from irrsplat.gather.hemicube import faces
from irrsplat.gather.raster import RasterGather
from irrsplat.gather.record_frame import tangent_frames
from irrsplat.gpu.geometry import Geometry
from irrsplat.scene import load, meshlets
from irrsplat.scene.flatten import flatten
from irrsplat.scene.meshlets import Meshlets, cut
from irrsplat.scene.model import Scene
from tests.support.worlds import Lit

RNG = np.random.default_rng(5)


def soup(count: int, size: float = 0.05) -> np.ndarray:
    """(F, 3, 3) small triangles in a box of 4 m, and two large ones."""
    corners = RNG.uniform(-2.0, 2.0, (count, 1, 3)) + size * RNG.standard_normal((count, 3, 3))
    corners[:2] = RNG.uniform(-2.0, 2.0, (min(count, 2), 3, 3))
    return corners.astype(np.float32)


@pytest.mark.parametrize("count", [0, 1, 2, 95, 96, 97, 1000, 5000])
def test_every_triangle_is_in_one_meshlet(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshlets, "MOST", 40)
    corners = soup(count)
    made = cut(corners)
    assert np.array_equal(np.sort(made.order), np.arange(count))
    assert np.array_equal(made.first, np.cumsum(made.count) - made.count) and made.count.sum() == count
    assert (made.count > 0).all() and made.count.max(initial=0) <= max(meshlets.SIZE, count // 39 + 1)
    for i in range(len(made)):
        points = corners[made.order[made.first[i] :][: made.count[i]]].reshape(-1, 3)
        assert np.allclose(made.centre[i] - made.half[i], points.min(0)), "a box fits what is in it"
        assert np.allclose(made.centre[i] + made.half[i], points.max(0))


def test_meshlets_hold_neighbours() -> None:
    """1024 triangles evenly in a cube of 4 m by 16: a meshlet of 64 or more would be a 16th of it, if it were as wide as high."""
    made = cut(soup(1024, 0.01)[2:])
    assert np.prod(2.0 * made.half, axis=1).mean() < 2.0 * 4.0**3 / len(made)


@pytest.mark.parametrize("away", [0.0, 3000.0])
def test_what_a_view_may_see_and_what_lies_within_it(away: float) -> None:
    """Against every vertex: a meshlet with one in the pyramid is not left out, and one that counts as within has all there. Far
    from the origin, where float32 has steps of a quarter of a millimetre, too."""
    corners = soup(3000) + np.float32(away)
    made = cut(corners)
    eye = RNG.uniform(-2.0, 2.0, (20, 3)) + away
    normal = RNG.standard_normal((20, 3))
    frame = tangent_frames(normal / np.linalg.norm(normal, axis=1, keepdims=True), np.arange(20), 0)
    rows = np.zeros((5, 20, 3, 4))
    rows[..., :3] = np.einsum("fij,njk->fnik", faces("raster")[0], frame)
    rows[..., 3] = -np.einsum("fnik,nk->fni", rows[..., :3], eye)
    some, within = made.seen(rows, 0.01)
    assert some.shape == within.shape == (len(made), 5, 20)
    points = corners[made.order].reshape(-1, 3).astype(float)
    x, y, w = np.moveaxis(np.einsum("fnik,pk->fnip", rows[..., :3], points) + rows[..., 3:], 2, 0)
    inside = (np.abs(x) <= w) & (np.abs(y) <= w)
    owner = np.repeat(np.arange(len(made)), 3 * made.count)
    views = inside.reshape(-1, len(points))
    count = np.stack([np.bincount(owner, view, len(made)) for view in views], axis=1).reshape(some.shape)
    assert not (count[~some] > 0).any()
    assert (count[within] == 3 * np.broadcast_to(made.count[:, None, None], some.shape)[within]).all()
    assert not (within & ~some).any()
    assert (~some).mean() > 0.5 and within.sum() > 10, "most are left out, and some need no clipping"


class Look:
    """What some points of a bundled scene see."""

    def __init__(self, ctx: moderngl.Context, name: str, kind: str = "raster") -> None:
        self.scene: Scene = load(name)
        self.lit = Lit(ctx, self.scene, 64)
        self.geometry = self.lit.geometry
        self.gather = RasterGather(self.lit.world, kind, 16)
        corners = self.geometry.corners[:: max(self.geometry.triangles // 20, 1)].astype(float)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        self.sites = Sites(corners.mean(1).astype("f4"), normal.astype("f4"), normal.astype("f4"))

    def __call__(self) -> tuple[np.ndarray, np.ndarray]:
        """Radiance and planes of the used part of the atlas."""
        atlas: Atlas = self.gather(self.lit.light, self.sites, np.arange(len(self.sites)), 0)
        lines = -(-atlas.count // atlas.columns) * atlas.cell[1]
        radiance, planes = (
            np.frombuffer(t.read(), "f4").reshape(t.height, t.width, 4)[:lines] for t in (atlas.radiance, atlas.planes)
        )
        return radiance.copy(), planes.copy()


@pytest.mark.parametrize("kind", ["raster", "plane"])
def test_leaving_meshlets_out_changes_no_bit(ctx: moderngl.Context, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    look = Look(ctx, "door", kind)
    culled = look()
    monkeypatch.setattr(raster, "_PAIRS", 700)  # some records at a time
    in_parts = look()
    drawn: list[int] = []

    def all_of_them(self: Meshlets, rows: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
        drawn.append(rows.shape[1])
        return np.ones((len(self), *rows.shape[:2]), bool), np.zeros((len(self), *rows.shape[:2]), bool)

    monkeypatch.setattr(Meshlets, "seen", all_of_them)
    whole = look()
    assert len(drawn) > 1 and sum(drawn) == len(look.sites)
    for a, b, c in zip(culled, in_parts, whole, strict=True):
        assert np.array_equal(a, c) and np.array_equal(b, c)
    assert (culled[0][..., 3] > 0.0).any()


def test_both_ways_of_drawing_agree(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same rays and planes to the bit; the looks of a surface are interpolated otherwise, so that radiance is rounded
    otherwise. Where two surfaces are equally far within the depth buffer's steps, either may be seen."""
    look = Look(ctx, "curved")
    many = look()
    monkeypatch.setattr(raster, "SINGLE_DRAW_TRIANGLES", 10**6)
    few = look()
    assert look.gather.single_draw is not None and look.gather.meshlet_draw is not None
    same = (many[1] == few[1]).all(-1)
    assert same.mean() > 0.999
    assert np.array_equal(many[0][same, 3], few[0][same, 3])
    error = np.abs(many[0] - few[0])[same] / np.abs(few[0][same]).max(-1, keepdims=True).clip(1e-6)
    assert np.quantile(error, 0.999) < 1e-4 and error.max() < 0.02


def test_meshlets_follow_what_moves(ctx: moderngl.Context) -> None:
    """Half of the triangles elsewhere: the same is seen as in geometry made of them."""
    look = Look(ctx, "curved")
    before = look()
    vertices, faces, _ = flatten(look.scene)
    vertices[: len(vertices) // 2, :3] += np.array([0.3, 0.2, -0.4], np.float32)
    look.geometry.update(vertices, faces)
    after = look()
    look.lit.world.geometry = Geometry(ctx, vertices, faces, look.geometry.counts)
    anew = look()
    assert not np.array_equal(before[0], after[0])
    assert all(np.array_equal(a, b) for a, b in zip(after, anew, strict=True))
