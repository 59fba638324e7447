"""Buffers of tiles: shadow maps, and the cells of the gather atlas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Canvas, Identity, Legend, ShownBuffer, ViewSource, colour_map
from irrsplat.app.viewer.buffers.texture_buffers import exposed
from irrsplat.app.viewer.show.screen import Region
from irrsplat.core.buffers import Atlas, ShadowMaps, Uniforms
from irrsplat.lighting.sky import sky_defines, sky_maps, sky_uniforms
from irrsplat.scene.model import Scene

GAP = 2.0  # pixels between tiles


@dataclass(frozen=True)
class Tiling:
    """Tiles in rows from the upper left corner (left, top; pixels from the lower left): how many a row, pixels per texel."""

    per_row: int
    pixels_per_texel: float
    left: float
    top: float


def tiling(count: int, tile: tuple[float, float], area: Region) -> Tiling:
    """The tiling that shows `count` tiles of `tile` texels largest in an area of a window."""
    x, y, *size = area
    per_row = np.arange(1, max(count, 1) + 1)
    rows = -(-max(count, 1) // per_row)
    pixels = np.minimum((size[0] - GAP * (per_row - 1)) / (per_row * tile[0]), (size[1] - GAP * (rows - 1)) / (rows * tile[1]))
    best = int(np.argmax(pixels))
    scale = max(float(pixels[best]), 1.0 / max(tile))
    width, height = (n[best] * (c * scale + GAP) - GAP for n, c in ((per_row, tile[0]), (rows, tile[1])))
    return Tiling(int(per_row[best]), scale, x + (size[0] - width) / 2.0, y + size[1] - (size[1] - height) / 2.0)


def common(a: Region, b: Region | None) -> Region | None:
    """Return the overlap of two regions; None if there is none. b: None for everywhere."""
    if b is None:
        return a
    low = max(a[0], b[0]), max(a[1], b[1])
    high = min(a[0] + a[2], b[0] + b[2]), min(a[1] + a[3], b[1] + b[3])
    return (*low, high[0] - low[0], high[1] - low[1]) if high[0] > low[0] and high[1] > low[1] else None


class GatherAtlasBuffer(ShownBuffer):
    """The atlas of the last batch."""

    in_view = False

    def inputs(self, source: ViewSource) -> object:
        return Identity(source.renderer.scheduler.gatherer.atlas)

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        canvas.blank()
        atlas = source.renderer.scheduler.gatherer.atlas
        if atlas is not None:
            draw_atlas(canvas, atlas, source.gain, sky_uniforms(source.scene, sky_maps(source.renderer.world)))

    def legend(self, source: ViewSource) -> Legend:
        return Legend(exposed(self.unit, source), unit=self.unit)


def draw_atlas(canvas: Canvas, atlas: Atlas, gain: float, sky: Uniforms) -> None:
    """Draw the cells of an atlas as large as they fit, radiance times `gain`; a texel that hits nothing shows the sky, of
    these uniforms of shaders/lighting/sky.glsl."""
    grid = tiling(atlas.count, atlas.cell, canvas.area)
    canvas.programs("viewer/buffers/gather_atlas", defines=sky_defines(sky))(
        canvas.target,
        scissor=canvas.region,
        radiance=atlas.radiance,
        cell=atlas.cell,
        columns=atlas.columns,
        count=atlas.count,
        place=(grid.left, grid.top, 1.0 / grid.pixels_per_texel, GAP),
        across=grid.per_row,
        gain=gain,
        table=atlas.table,
        frames=atlas.frames,
        **sky,
        ground=GROUND,
    )


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
