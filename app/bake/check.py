"""How far a bake is from a path tracer, at some of its points."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.reference import worker
from irrsplat.reference.truth import errors, noise, side_of, vertices

if TYPE_CHECKING:
    from irrsplat.app.bake.lightmap import Lightmap
    from irrsplat.scene.model import Scene

SAMPLES = 2048  # rays of each kind a point, as `irrsplat verify` has them
_WITHIN = 16  # points of a texel that shadows are looked at


@dataclass(frozen=True)
class Checked:
    """The errors of a bake's irradiance at `count` points against a path tracer's, which used so many `samples`; rmse and bias as
    truth.errors has them, over the truth's mean; net: the rmse without the truth's own noise. indirect: the net rmse of the
    indirect part alone. None in the dark."""

    count: int
    samples: int
    rmse: float | None
    net: float | None
    bias: float | None
    indirect: float | None

    @property
    def words(self) -> str:
        """One line that says so."""
        if self.rmse is None or self.net is None or self.bias is None:
            return f"checked     {self.count} texels: there is no light"
        told = f"checked     {self.count} texels against a path tracer: error {self.net:.1%} (RMSE over the mean), bias {self.bias:+.1%}"
        return told + ("" if self.indirect is None else f"; of indirect light alone {self.indirect:.1%}")


def check(
    made: Lightmap, count: int, bounces: int | str = "all", progress: Callable[[float], object] | None = None, seed: int = 0
) -> Checked:
    """The errors of a lightmap at `count` texels drawn at random, of those that lie within a chart with all around them.

    bounces: the setting that it was baked with. Light of lamps is compared as the mean over a texel, all else at its middle. Raises
    IrrsplatError where there is no path tracer (the extra `reference`).
    """
    from scipy import ndimage

    worker.require()
    inner = ndimage.binary_erosion(made.lit.seen, np.ones((3, 3)))
    rows, columns = np.nonzero(inner)
    chosen = np.random.default_rng(seed).permutation(len(rows))[:count]
    at = rows[chosen], columns[chosen]
    points = made.lit.position[at], made.lit.mapped[at], made.lit.geometric[at]
    shadowed = within_texels(made, at) if made.light == "all" else tuple(np.zeros((0, 3)) for _ in range(3))
    side = side_of(SAMPLES)
    found = worker.at_points(made.receivers.scene.local, points, shadowed, side, vertices(bounces), progress)  # type: ignore[arg-type]
    halves, direct = found["halves"], 0.0
    if made.light == "all":
        direct = found["direct"].reshape(len(chosen), _WITHIN, 3).mean(1)
    truth = halves.astype(float).mean(0) + direct
    told, own = errors(made.irradiance[at], truth), noise(halves + direct, np.ones(len(chosen), bool))
    indirect = errors(made.indirect[at], halves.mean(0))["rmse"]
    return Checked(
        len(chosen), 2 * side * side, told["rmse"], _net(told["rmse"], own), told["bias"],
        _net(indirect, noise(halves, np.ones(len(chosen), bool))),
    )  # fmt: skip


def within_texels(made: Lightmap, at: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, mapped and geometric normals, (N·16, 3) each, of a regular grid of points in the texels `at` (rows, columns): on
    the plane of the texel's own point."""
    side = math.isqrt(_WITHIN)
    steps = (np.arange(side) + 0.5) / side - 0.5
    x, y = (v.ravel() for v in np.meshgrid(steps, steps))
    p, rows, columns = made.lit.position, *at
    # differences to the neighbours on both sides, which are on the same chart
    across = 0.5 * (p[rows, columns + 1] - p[rows, columns - 1])
    down = 0.5 * (p[rows + 1, columns] - p[rows - 1, columns])
    places = p[at][:, None] + x[:, None] * across[:, None] + y[:, None] * down[:, None]
    normals = (np.repeat(a[at], _WITHIN, axis=0) for a in (made.lit.mapped, made.lit.geometric))
    return places.reshape(-1, 3), *normals


def _net(rmse: float | None, own: float | None) -> float | None:
    return None if rmse is None else math.sqrt(max(rmse**2 - (own or 0.0) ** 2, 0.0))
