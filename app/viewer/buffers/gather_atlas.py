"""The gather atlas: a cell with the hemisphere of each record of the last batch."""

from __future__ import annotations

from irrsplat.app.viewer.buffers.legend import Legend
from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Canvas, Identity, ShownBuffer, ViewSource
from irrsplat.app.viewer.buffers.texture_buffers import exposed
from irrsplat.app.viewer.buffers.tiles import GAP, tiling
from irrsplat.core.buffers import Atlas, Uniforms
from irrsplat.lighting.sky import sky_defines, sky_maps, sky_uniforms


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
