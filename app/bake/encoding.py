"""Lightmaps as 8-bit pictures: charts of similar brightness share a scale, much brighter spots have separate pictures."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.app.bake.cutting import Cut
from irrsplat.core.color import srgb

if TYPE_CHECKING:
    from irrsplat.app.bake.lightmap import Form, Lightmap

_CLIPPED = 0.005  # largest share of all light lost to clipping in the pictures; the EXR is complete
_STEEP = 16.0  # ratio of a chart's brightest texel to its median above which it is cut
_STEP = 8.0  # brightness ratio from the median to the brightest texel of a scale, and between pictures
_SMALL = 256  # texels of the largest chart that stays whole
_SHORT = 6.0  # texels: shortest edge that is cut
_ROUNDS, _MOST = 40, 100_000  # rounds of cutting; limit of pieces


@dataclass(frozen=True, eq=False)
class Picture:
    """Part of a map from texel `first` (x, y): linear values (H, W, 3) in 0..1."""

    first: tuple[int, int]
    values: np.ndarray

    @property
    def eight_bits(self) -> bytes:
        """An sRGB-encoded 8-bit PNG, dithered to keep the mean over several texels."""
        from PIL import Image

        display = 255.0 * srgb(self.values)
        y, x = np.indices(self.values.shape[:2])
        # Interleaved gradient noise (Jimenez 2014)
        noise = np.asarray((52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1.0)) % 1.0)
        data = io.BytesIO()
        shown = np.floor(display + noise[..., None]).clip(0, 255) * (self.values > 0.0)
        Image.fromarray(shown.astype(np.uint8)).save(data, "PNG", optimize=True)
        return data.getvalue()


@dataclass(frozen=True, eq=False)
class Encoding:
    """Map as 8-bit pictures, and their assignment to surfaces.

    cut: triangles, in pieces where part of a chart is far brighter. part: (P,) index of each piece into `strength` and
    `picture`. strength: (G,) value of a picture's 1. picture: (G,) index into `pictures`; the first is the whole map. limit:
    clipping threshold. clipped: share of all light on texels above the limit.
    """

    cut: Cut
    part: np.ndarray
    strength: np.ndarray
    picture: np.ndarray
    pictures: tuple[Picture, ...]
    limit: float
    clipped: float

    @staticmethod
    def of(made: Lightmap, form: Form) -> Encoding:
        """Encode the map of this form."""
        from scipy import ndimage

        values, on = getattr(made, form), made.owner
        bright = values.max(-1)
        limit = limit_of(bright[on >= 0])
        owner = on[tuple(ndimage.distance_transform_edt(on < 0, return_distances=False, return_indices=True))]
        charts = int(made.charts.chart.max(initial=-1)) + 1
        numbers = np.arange(charts)
        most = np.minimum(ndimage.maximum(bright, owner, numbers), limit)
        usual = ndimage.median(bright, owner, numbers)
        steep = (most > _STEEP * usual) & (np.bincount(on[on >= 0], minlength=charts) > _SMALL)
        most = np.where(steep, np.maximum(_STEP * usual, limit / _STEP**4), most)
        mesh = np.zeros(charts, np.int64)
        mesh[made.charts.chart] = made.receivers.mesh_of
        _, group = np.unique(np.stack([mesh, np.floor(np.log2(np.maximum(most, 1e-30)))], axis=1), axis=0, return_inverse=True)
        strength = np.zeros(int(group.max(initial=-1)) + 1)
        np.maximum.at(strength, group.ravel(), most)
        own = strength[group.ravel()]  # (charts,)
        cut, peak = _pieces(made, np.minimum(bright, limit), own, steep)
        chart = made.charts.chart[cut.of]
        # Level 0: the whole map; level k: k - 1 steps of _STEP below the limit
        level = 1 + np.floor(np.log(limit / np.maximum(peak, 1e-30)) / np.log(_STEP) + 1e-6).astype(np.int64)
        level = np.where(steep[chart] & (peak > own[chart]), level, 0)
        levels = np.unique(level[level > 0])
        whole = np.minimum(values / np.maximum(own[owner], 1e-30)[..., None], 1.0)
        pictures = [Picture((0, 0), whole)]
        for k in levels:
            pictures.append(_part_of(made, values * (_STEP ** (k - 1) / limit), cut, level == k))
        part = np.where(level > 0, len(strength) + np.searchsorted(levels, level), group.ravel()[chart])
        strengths = np.concatenate([strength, limit / _STEP ** (levels - 1.0)])
        picture = np.concatenate([np.zeros(len(strength), np.int64), 1 + np.arange(len(levels))])
        total = float(bright[on >= 0].sum())
        clipped = float(np.maximum(bright[on >= 0] - limit, 0.0).sum()) / max(total, 1e-30)
        return Encoding(cut, part, strengths, picture, tuple(pictures), limit, clipped)

    def pieces_of(
        self, attributes: dict[str, np.ndarray], faces: np.ndarray, first: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        """Return the pieces of one mesh: vertex attributes, faces (P, 3) and their `part` (P,).

        attributes: (V, …) by name. faces: (F, 3). first: receiver index of the first triangle.
        """
        (mine,) = np.nonzero((self.cut.of >= first) & (self.cut.of < first + len(faces)))
        root, part = faces[self.cut.of[mine] - first], self.part[mine]
        if len(mine) == len(faces):
            return attributes, root, part
        shares = self.cut.shares[mine]
        # Vertices at chart boundaries are duplicated for each map position
        key = np.concatenate([self.cut.faces[mine][..., None], _rounded(shares @ attributes["TEXCOORD_1"][root])], axis=2)
        _, chosen, number = np.unique(key.reshape(-1, 3), axis=0, return_index=True, return_inverse=True)
        corner = root.repeat(3, axis=0)[chosen], shares.reshape(-1, 3)[chosen]
        blended = {name: (values[corner[0]] * corner[1][..., None]).sum(1) for name, values in attributes.items()}
        blended["NORMAL"] /= np.maximum(np.linalg.norm(blended["NORMAL"], axis=1, keepdims=True), 1e-6)
        return blended, number.reshape(-1, 3), part


def _rounded(uv: np.ndarray) -> np.ndarray:
    """Return coordinates of 0..1 as integers for exact comparison."""
    return np.round(uv * 1e7).astype(np.int64)


def limit_of(values: np.ndarray) -> float:
    """Return the least limit that clips at most the share _CLIPPED of the sum of values (N,)."""
    down = np.sort(values)[::-1].astype(float)
    excess = np.cumsum(down) - np.arange(1, len(down) + 1) * down  # clipped sum at each limit
    within = np.flatnonzero(excess <= _CLIPPED * down.sum())
    return float(down[within[-1]]) if len(within) else 0.0


def _pieces(made: Lightmap, bright: np.ndarray, own: np.ndarray, steep: np.ndarray) -> tuple[Cut, np.ndarray]:
    """Cut `steep` charts, and return the pieces with the brightest texel (P,) of each; 0 for other charts.

    A piece is cut if one end is above the chart's `own` strength and the other is a step darker.
    """
    cut, most = Cut.whole(made.receivers), np.zeros(0)
    for turn in range(_ROUNDS):
        chart = made.charts.chart[cut.of]
        most = np.zeros(len(cut.of))
        (some,) = np.nonzero(steep[chart])
        if not len(some):
            break
        where, piece = _texels_of(_corners(made, cut)[some], made.charts.size)
        light = bright.ravel()[where.T]
        first = np.flatnonzero(np.diff(piece, prepend=-1))
        most[some] = np.maximum.reduceat(light.max(0), first)
        least = np.minimum.reduceat(light.min(0), first)
        floor = own[chart[some]]
        too_steep = np.zeros(len(cut.of), bool)
        too_steep[some] = (most[some] > floor) & (np.maximum(least, floor / _STEP) < most[some] / _STEP)
        edges, flat = cut.edges(made.receivers), _corners(made, cut)
        longest = edges.longest
        each = np.arange(len(longest))
        too_steep &= np.linalg.norm(flat[each, (longest + 1) % 3] - flat[each, longest], axis=1) > _SHORT
        if turn == _ROUNDS - 1 or not too_steep.any() or len(cut.of) > _MOST:
            break
        marked = np.zeros(len(edges.ends), bool)
        marked[edges.of_face[each, longest][too_steep]] = True
        cut = cut.divided(edges, edges.conforming(marked))
    return cut, most


def _corners(made: Lightmap, cut: Cut) -> np.ndarray:
    """Return the corners (P, 3, 2) of pieces in the map, in texels."""
    found: np.ndarray = cut.shares @ made.charts.corners[cut.of]
    return found


def _texels_of(flat: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return texels (N, 4), numbered row by row, of bilinear lookups on triangles `flat` (T, 3, 2), and triangle indices (N,).

    Sample points are at most half a texel apart; the results are in triangle order.
    """
    sides = np.linalg.norm(flat - flat[:, [1, 2, 0]], axis=2).max(1)
    steps = np.ceil(2.0 * sides).astype(np.int64) + 1
    counts = (steps + 1) * (steps + 2) // 2
    piece = np.repeat(np.arange(len(flat)), counts)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    row = np.floor((np.sqrt(8.0 * number + 1.0) - 1.0) / 2.0).astype(np.int64)  # row r starts at number r(r + 1)/2
    second = (number - row * (row + 1) // 2) / steps[piece]
    first = row / steps[piece] - second
    a, b, c = (flat[piece, k] for k in range(3))
    low = np.floor(a + first[:, None] * (b - a) + second[:, None] * (c - a) - 0.5).astype(np.int64)
    x, y = (np.clip(low[:, k, None] + shift, 0, size - 1) for k, shift in ((0, [0, 1, 0, 1]), (1, [0, 0, 1, 1])))
    return y * size + x, piece


def _part_of(made: Lightmap, values: np.ndarray, cut: Cut, mine: np.ndarray) -> Picture:
    """Return the part of a map that the pieces `mine` (P,) need, black elsewhere."""
    size = made.charts.size
    where, _ = _texels_of(_corners(made, cut)[mine], size)
    shown = np.zeros(size * size, bool)
    shown[where] = True
    rows, columns = np.nonzero(shown.reshape(size, size))
    y, x = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    part = np.minimum(values[y, x], 1.0) * shown.reshape(size, size)[y, x, None]
    return Picture((int(columns.min()), int(rows.min())), part)
