"""Buffers of tiles: shadow maps, and the cells of the gather atlas."""

from __future__ import annotations

from typing import Any

import numpy as np

from irrsplat.app.viewer.buffers.kinds import exposed
from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Canvas, Identity, Legend, ShownBuffer, ViewSource, colour_map
from irrsplat.core.buffers import Atlas, Uniforms
from irrsplat.lighting.sky import sky_defines, sky_maps, sky_uniforms

_GAP = 2.0  # pixels between tiles


def tile_uniforms(size: tuple[int, int], count: int, cell: tuple[float, float], columns: int) -> dict[str, Any]:
    """Return the uniforms of tiles.glsl by which `count` tiles of `cell` texels are largest in a target of `size`, centred."""
    per_row = np.arange(1, max(count, 1) + 1)
    rows = -(-max(count, 1) // per_row)
    pixels = np.minimum((size[0] - _GAP * (per_row - 1)) / (per_row * cell[0]), (size[1] - _GAP * (rows - 1)) / (rows * cell[1]))
    best = int(np.argmax(pixels))
    scale = max(float(pixels[best]), 1.0 / max(cell))  # pixels per texel
    width, height = (float(n[best]) * (c * scale + _GAP) - _GAP for n, c in ((per_row, cell[0]), (rows, cell[1])))
    place = (size[0] - width) / 2.0, (size[1] + height) / 2.0, 1.0 / scale, _GAP
    return {
        "cell": cell,
        "columns": columns,
        "count": count,
        "place": place,
        "across": int(per_row[best]),
        "ground": GROUND,
    }


def draw_atlas(canvas: Canvas, atlas: Atlas, gain: float, sky: Uniforms) -> None:
    """Draw the cells of an atlas, radiance times `gain`. A texel that hits nothing shows the sky, of these uniforms of
    shaders/lighting/sky.glsl."""
    canvas.programs("viewer/buffers/gather_atlas", defines=sky_defines(sky))(
        canvas.target,
        scissor=canvas.region,
        radiance=atlas.radiance,
        gain=gain,
        table=atlas.table,
        frames=atlas.frames,
        **tile_uniforms(canvas.target.size, atlas.count, atlas.cell, atlas.columns),
        **sky,
    )


def gather_atlas() -> ShownBuffer:
    """Show the hemispheres of the records of the last batch."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        atlas = source.renderer.scheduler.gatherer.atlas
        if atlas is None:
            canvas.blank()
        else:
            draw_atlas(canvas, atlas, source.gain, sky_uniforms(source.scene, sky_maps(source.renderer.world)))

    words, legend = "what the records of the last batch saw, a hemisphere each", exposed("W/(m² sr)")
    state = lambda source: Identity(source.renderer.scheduler.gatherer.atlas)  # noqa: E731
    return ShownBuffer("atlas", "gather atlas", words, draw, legend, in_view=False, state=state)


def shadow_maps() -> ShownBuffer:
    """Show the shadow maps of all lights."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        shadows = source.renderer.shadows
        if shadows is None:
            return canvas.blank()
        side, columns, _ = shadows.layout
        count = int(shadows.table.reshape(-1, 8, 4)[:, 1, 3].round().sum())  # as shaders/lighting/lights.glsl has it
        canvas.programs("viewer/buffers/shadow_maps")(
            canvas.target,
            scissor=canvas.region,
            shadow_depth=shadows.depth,
            colours=canvas.programs.colours,
            **tile_uniforms(canvas.target.size, count, (side, side), int(columns)),
        )

    def legend(source: ViewSource) -> Legend:
        if source.renderer.shadows is None or not source.scene.lights:
            return Legend("no light casts shadows here")
        return Legend("distance from the light / depth of the map; black: nothing", "0", "1", "", colour_map())

    words = "every light's shadow maps: distance from the light along each one's axis"
    state = lambda source: Identity(source.renderer.shadows)  # noqa: E731
    return ShownBuffer("shadow", "shadow maps", words, draw, legend, in_view=False, state=state)
