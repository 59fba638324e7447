"""Every light's shadow maps side by side: the distance from the light along each one's axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.app.viewer.buffers.legend import Legend, colour_map
from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Identity, ShownBuffer, ViewSource
from irrsplat.app.viewer.buffers.tiles import GAP, common, tiling
from irrsplat.core.buffers import ShadowMaps
from irrsplat.scene.model import Scene


class ShadowMapsBuffer(ShownBuffer):
    """The tiles of all lights, by the colour map."""

    in_view = False

    def inputs(self, source: ViewSource) -> object:
        return Identity(source.renderer.shadows)

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        canvas.blank()
        shadows = source.renderer.shadows
        if shadows is None:
            return
        side, columns, far = shadows.layout
        tiles = light_tiles(shadows)
        grid = tiling(len(tiles), (side, side), canvas.area)
        pitch, size = side * grid.pixels_per_texel + GAP, max(int(side * grid.pixels_per_texel), 1)
        low, high = shadow_range(source.scene, shadows)
        for i, tile in enumerate(tiles):
            x, y = round(grid.left + (i % grid.per_row) * pitch), round(grid.top - (i // grid.per_row) * pitch) - size
            part = common((x, y, size, size), canvas.region)
            if part is None:
                continue
            canvas.programs("viewer/buffers/shadow_maps")(
                canvas.target,
                scissor=part,
                shadow_depth=shadows.depth,
                corner=(i % columns * side, i // columns * side),
                place=(x, y, side / size),
                thickness=tile.thickness or far,
                low=low,
                high=high,
                colours=canvas.colours,
            )

    def legend(self, source: ViewSource) -> Legend:
        shadows = source.renderer.shadows
        if shadows is None or not source.scene.lights:
            return Legend("no light casts shadows here")
        low, high = shadow_range(source.scene, shadows)
        return Legend("distance from the light; black: nothing there", f"{low:.3g}", f"{high:.3g}", self.unit, colour_map())


@dataclass(frozen=True)
class LightTile:
    """A shadow map's tile: the light's position, the tile's axis (None: one of six about a point), and the metres of depth in a
    parallel tile (0: a perspective one)."""

    eye: np.ndarray
    axis: np.ndarray | None
    thickness: float


def light_tiles(shadows: ShadowMaps) -> list[LightTile]:
    """The tiles of all lights in their order, read from the table of shaders/lighting/lights.glsl."""
    tiles: list[LightTile] = []
    for position, colour, _, _, cone, _, _, forward in shadows.table.reshape(-1, 8, 4):
        directional, count = position[3] > 0.5, round(colour[3])
        axis = forward[:3] if count == 1 else None
        tiles += [LightTile(position[:3], axis, float(cone[0]) if directional else 0.0)] * count
    return tiles


def shadow_range(scene: Scene, shadows: ShadowMaps) -> tuple[float, float]:
    """The least and the greatest distance from a light along a tile's axis that its shadow maps can hold, in metres."""
    ends = []
    for tile in light_tiles(shadows):
        if tile.thickness:
            ends.append((0.0, tile.thickness))
            continue
        offset = scene.corners - tile.eye
        along = np.abs(offset).max(1) if tile.axis is None else np.maximum(offset @ tile.axis, 0.0)
        ends.append((0.0 if tile.axis is None else along.min(), along.max()))
    low, high = (float(f([end[i] for end in ends])) for i, f in enumerate((min, max))) if ends else (0.0, 1.0)
    return low, high if high > low else low + scene.diagonal
