"""Comparison of baked irradiance with a path-traced reference at random points."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.app.bake.lightmap import Lightmap
from irrsplat.app.bake.unwrap import Chartist
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import triangle_areas
from irrsplat.gpu import context
from irrsplat.reference import worker
from irrsplat.reference.truth import errors, noise, side_of, vertices

if TYPE_CHECKING:
    from irrsplat.app.bake.vertices import VertexLight

SAMPLES = 2048  # rays per point and kind, as in `irrsplat verify`
_WITHIN = 16  # points per texel for shadow sampling


@dataclass(frozen=True)
class Checked:
    """Errors of baked irradiance at `count` points against a path-traced reference.

    what: "texels" or "vertices". samples: reference samples per point. rmse, bias: relative to the reference's mean, as in
    truth.errors. net: the rmse without the reference's own noise. indirect: the net rmse of the indirect part alone. The
    errors are None in the dark.
    """

    count: int
    what: str
    samples: int
    rmse: float | None
    net: float | None
    bias: float | None
    indirect: float | None

    @property
    def words(self) -> str:
        """One line for the terminal."""
        if self.rmse is None or self.net is None or self.bias is None:
            return f"checked     {self.count} {self.what}: there is no light"
        text = f"checked     {self.count} {self.what} against a path tracer: error {self.net:.1%} (RMSE over the mean), "
        text += f"bias {self.bias:+.1%}"
        return text + ("" if self.indirect is None else f"; of indirect light alone {self.indirect:.1%}")


@dataclass(frozen=True, eq=False)
class _Sample:
    """Points of a bake: positions, mapped and geometric normals, (N, 3) each.

    shadowed: points for direct light, equally many per point. irradiance, indirect: baked values (N, 3) in W/m².
    """

    points: tuple[np.ndarray, np.ndarray, np.ndarray]
    shadowed: tuple[np.ndarray, np.ndarray, np.ndarray]
    irradiance: np.ndarray
    indirect: np.ndarray


def check(
    made: Lightmap | VertexLight,
    count: int,
    bounces: int | str = "all",
    progress: Callable[[float], object] | None = None,
    seed: int = 0,
) -> Checked:
    """Return the errors of a bake at `count` random points.

    Texels are drawn from the interior of charts, vertices in proportion to their area. bounces: the bake's setting. Direct
    light is compared as the mean over a texel, indirect light at its centre. Raises InputError without comparable points,
    IrrsplatError without a path tracer (the extra `reference`).
    """
    worker.require()
    random = np.random.default_rng(seed)
    some = _texels(made, count, random) if isinstance(made, Lightmap) else _vertices(made, count, random)
    side, number = side_of(SAMPLES), len(some.irradiance)
    if not number:
        raise InputError("no point of the bake can be compared; give a larger --size")
    scene = made.receivers.scene.local
    found = worker.at_points(scene, some.points, some.shadowed, side, vertices(bounces), progress)
    halves, direct, everywhere = found["halves"], np.float32(0.0), np.ones(number, bool)
    if len(found["direct"]):
        direct = found["direct"].reshape(number, -1, 3).mean(1)
    error, own = errors(some.irradiance, halves.astype(float).mean(0) + direct), noise(halves + direct, everywhere)
    indirect = errors(some.indirect, halves.mean(0))["rmse"]
    return Checked(
        number, made.checks, 2 * side * side, error["rmse"], _net(error["rmse"], own), error["bias"],
        _net(indirect, noise(halves, everywhere)),
    )  # fmt: skip


def _none() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3))


def _texels(made: Lightmap, count: int, random: np.random.Generator) -> _Sample:
    from scipy import ndimage

    # Hidden texels and chart rims have no reference: they hold values for bilinear filtering
    inner = ndimage.binary_erosion(made.lit.seen, np.ones((3, 3)))
    same = ndimage.minimum_filter(made.owner, 3) == ndimage.maximum_filter(made.owner, 3)
    rows, columns = np.nonzero(inner & same)
    chosen = random.permutation(len(rows))[:count]
    at = rows[chosen], columns[chosen]
    shadowed = within_texels(made, at) if made.light == "all" else _none()
    points = made.lit.position[at], made.lit.mapped[at], made.lit.geometric[at]
    return _Sample(points, shadowed, made.irradiance[at], made.indirect[at])


def _vertices(made: VertexLight, count: int, random: np.random.Generator) -> _Sample:
    # Area weighting: vertices crowd at contacts and shadow edges, which are small and difficult
    area = np.zeros(len(made.lit))
    faces = made.cut.faces
    np.add.at(area, faces, triangle_areas(made.cut.positions(made.receivers)[faces])[:, None])
    area *= made.lit
    at = random.choice(len(area), count, p=area / area.sum()) if area.any() else np.zeros(0, np.int64)
    points = made.points.position[0, at], made.points.mapped[0, at], made.points.geometric[0, at]
    return _Sample(points, points if made.light == "all" else _none(), made.irradiance[at], made.indirect[at])


def within_texels(made: Lightmap, at: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, mapped and geometric normals, (N·16, 3) each, on a regular grid in the texels `at` (rows, columns).

    The points lie on the surface itself: next to a curved surface, its own shadow would count. Points off the surface count as
    the texel's centre.
    """
    side = math.isqrt(_WITHIN)
    steps = (np.arange(side) + 0.5) / side - 0.5
    ctx = context.create()
    try:
        with Chartist(ctx, made.charts) as chartist:
            offsets = [*((x, y) for y in steps for x in steps), (0.0, 0.0)]
            places = [tuple(values[at] for values in chartist.at(x, y)) for x, y in offsets]
    finally:
        ctx.release()
    triangle, u, v = (np.stack(values, axis=1) for values in zip(*places, strict=True))
    triangle, u, v = (np.where(triangle < 0, values[:, -1:], values)[:, :-1] for values in (triangle, u, v))
    found = made.receivers.surfaces.at(triangle.ravel(), u.ravel(), v.ravel())
    return found.position, found.mapped, found.front


def _net(rmse: float | None, own: float | None) -> float | None:
    return None if rmse is None else math.sqrt(max(rmse**2 - (own or 0.0) ** 2, 0.0))
