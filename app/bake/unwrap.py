"""Unique texture coordinates for all surfaces: charts made and packed by xatlas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from irrsplat.app.bake.places import Receivers
from irrsplat.core.errors import InputError
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, table_texture
from irrsplat.gpu.texel_table import table_rows

PADDING = 2  # texels between charts: bilinear filtering stays within a chart's own rim
_TRIES = 6
_ONE_PLACE = 0.01  # texels: distance below which corners coincide in the map
_NEAREST = 5  # points per side of the grid on which a texel searches the nearest surface
_AROUND = 0.75  # texels: half-width of this grid


@dataclass(frozen=True, eq=False)
class Charts:
    """Meshes of the receivers in a square of `size` texels per side.

    vertex: per mesh (V,) the source of each copied vertex. faces: per mesh (F, 3). uv: per mesh (V, 2) texels from the map's
    top left corner. chart: (F,) chart number of all triangles.
    """

    size: int
    vertex: tuple[np.ndarray, ...]
    faces: tuple[np.ndarray, ...]
    uv: tuple[np.ndarray, ...]
    chart: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        """Corners (F, 3, 2) of all triangles, in texels."""
        return np.concatenate([np.zeros((0, 3, 2)), *(uv[faces] for uv, faces in zip(self.uv, self.faces, strict=True))])


def unwrap(receivers: Receivers, size: int) -> Charts:
    """Return charts that fill a square of `size` texels as far as possible.

    Raises InputError without xatlas, for an empty scene, and for a square that is too small.
    """
    try:
        import xatlas
    except ModuleNotFoundError as error:
        raise InputError("a lightmap needs the Python module 'xatlas'; run: pip install 'irrsplat[bake]'") from error
    if not receivers.meshes:
        raise InputError("the scene has no triangles to bake light on")
    density, atlas, tried = 0.0, None, None
    for _ in range(_TRIES):
        tried = _packed(xatlas, receivers, size, density)
        side = max(tried.width, tried.height)
        if tried.atlas_count == 1 and side <= size and (atlas is None or tried.texels_per_unit > atlas.texels_per_unit):
            atlas = tried
        if atlas is tried and side >= 0.97 * size:
            break
        # Rescale to fit: charts and gaps do not shrink alike
        density = tried.texels_per_unit * (0.5 if tried.atlas_count > 1 else 0.99 * size / side)
    if atlas is None:
        assert tried is not None
        raise InputError(f"{tried.chart_count:,} charts do not fit into {size} x {size} texels; give a larger --size")
    scale = np.array([atlas.width, atlas.height], float)
    found = [atlas.get_mesh(i) for i in range(len(receivers.meshes))]
    uv = tuple(np.asarray(uv, float) * scale for _, _, uv in found)
    faces = tuple(np.asarray(faces, np.int64).reshape(-1, 3) for _, faces, _ in found)
    return Charts(size, tuple(np.asarray(v, np.int64) for v, _, _ in found), faces, uv, _islands(faces, uv))


def _packed(xatlas: Any, receivers: Receivers, size: int, density: float) -> Any:
    """Return the atlas of all meshes at `density` texels per unit; 0: xatlas's estimate for the size.

    The unit is about the scene's diagonal, because xatlas leaves out triangles below an absolute area.
    """
    atlas, per_metre = xatlas.Atlas(), 2.0 ** -np.round(np.log2(receivers.scene.diagonal))
    for mesh in receivers.meshes:
        flat = np.ascontiguousarray
        atlas.add_mesh(flat(per_metre * mesh.positions, np.float32), flat(mesh.faces, np.uint32), flat(mesh.normals, np.float32))
    packing = xatlas.PackOptions()
    packing.padding, packing.bilinear = PADDING, True
    if density:
        packing.texels_per_unit = density
    else:
        packing.resolution = size
    atlas.generate(xatlas.ChartOptions(), packing)
    return atlas


def _islands(faces: tuple[np.ndarray, ...], uv: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return a number (F,) for each connected set of triangles in the map.

    Corners at one position in the map are connected, even as different vertices; gaps separate charts.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    starts = np.cumsum([0, *map(len, uv)])
    joined = np.concatenate([f + start for f, start in zip(faces, starts, strict=False)])
    _, place = np.unique(np.round(np.concatenate(uv) / _ONE_PLACE).astype(np.int64), axis=0, return_inverse=True)
    corner = place.ravel()[joined]
    rows, columns, count = corner[:, [0, 1]].ravel(), corner[:, [1, 2]].ravel(), int(place.max()) + 1
    _, number = connected_components(coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count)), directed=False)
    _, chart = np.unique(number[corner[:, 0]], return_inverse=True)
    return chart.ravel().astype(np.int64)


class Chartist(Owner):
    """Rasterizer of charts: triangle and barycentric coordinates of each texel."""

    def __init__(self, ctx: moderngl.Context, charts: Charts) -> None:
        self.size = charts.size
        corners = charts.corners
        rows = np.concatenate([corners, np.zeros_like(corners)], axis=-1).astype("f4")
        self.count = len(corners)
        self.corners = self.own(table_texture(ctx, table_rows(rows)))
        self.program = self.own(Program(ctx, "bake/chart"))
        self.target = self.own(Target(ctx, (self.size, self.size), (4,)))

    def at(self, dx: float, dy: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return triangles (size, size), -1 for none, and their barycentric coordinates u and v.

        The points are at the offset (dx, dy) from the texels' centres, in texels.
        """
        self.target.use()
        self.target.gl.clear()
        self.program(
            self.target,
            vertices=3 * self.count,
            state=DrawState(),
            corners=self.corners,
            offset=(dx, dy),
            texels=(self.size, self.size),
        )
        found = np.frombuffer(self.target.textures[0].read(), "f4").reshape(self.size, self.size, 4)
        return found[..., 0].astype(np.int64) - 1, found[..., 1].astype(float), found[..., 2].astype(float)

    def nearest(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the values of `at` for the centre, or for the nearest covered point of the texel or its rim.

        Bilinear filtering reads rim texels as well.
        """
        steps = np.linspace(-_AROUND, _AROUND, _NEAREST)
        offsets = sorted(((float(x), float(y)) for x in steps for y in steps), key=lambda p: p[0] ** 2 + p[1] ** 2)
        triangle, u, v = self.at(*offsets[0])
        for offset in offsets[1:]:
            further = self.at(*offset)
            missing = triangle < 0
            triangle, u, v = (np.where(missing, new, old) for new, old in zip(further, (triangle, u, v), strict=True))
        return triangle, u, v
