"""Lightmaps as 8-bit pictures: charts of similar brightness share a scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.core.color import srgb
from irrsplat.core.files import as_png, dithered

if TYPE_CHECKING:
    from irrsplat.app.bake.lightmap import Form, Lightmap

_CLIPPED = 0.005  # largest share of all light lost to clipping in the picture; the EXR is complete


@dataclass(frozen=True, eq=False)
class Encoding:
    """Map as an 8-bit picture whose scale differs between groups of charts.

    png: sRGB-encoded, dithered to keep the mean over several texels. strength: (G,) radiance or irradiance of a group's 1.
    part: (F,) group of each triangle. limit: clipping threshold. clipped: share of all light on texels above the limit.
    """

    png: bytes
    strength: np.ndarray
    part: np.ndarray
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
        most = np.minimum(ndimage.maximum(bright, owner, np.arange(charts)), limit)
        mesh = np.zeros(charts, np.int64)
        mesh[made.charts.chart] = made.receivers.mesh_of
        _, group = np.unique(np.stack([mesh, np.floor(np.log2(np.maximum(most, 1e-30)))], axis=1), axis=0, return_inverse=True)
        strength = np.zeros(int(group.max(initial=-1)) + 1)
        np.maximum.at(strength, group.ravel(), most)
        own = strength[group.ravel()]  # (charts,)
        shown = np.minimum(values / np.maximum(own[owner], 1e-30)[..., None], 1.0)
        total = float(bright[on >= 0].sum())
        clipped = float(np.maximum(bright[on >= 0] - limit, 0.0).sum()) / max(total, 1e-30)
        png = as_png(dithered(srgb(shown)) * (shown > 0.0) / 255.0)
        return Encoding(png, strength, group.ravel()[made.charts.chart], limit, clipped)


def limit_of(values: np.ndarray) -> float:
    """Return the least limit that clips at most the share _CLIPPED of the sum of values (N,)."""
    down = np.sort(values)[::-1].astype(float)
    excess = np.cumsum(down) - np.arange(1, len(down) + 1) * down  # clipped sum at each limit
    within = np.flatnonzero(excess <= _CLIPPED * down.sum())
    return float(down[within[-1]]) if len(within) else 0.0
