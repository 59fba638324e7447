"""The record under the cursor: what it holds, which pixels it serves, and the hemisphere that it saw."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.buffer_view import BufferView
from irrsplat.app.viewer.buffers.gather_atlas import draw_atlas
from irrsplat.app.viewer.buffers.shown_buffer import ViewSource
from irrsplat.app.viewer.show.record_table import RecordTable, read
from irrsplat.core.memo import Memo
from irrsplat.gather import kinds
from irrsplat.gather.look import Gather
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.sky import sky_maps, sky_uniforms


@dataclass(frozen=True)
class InspectedRecord:
    """A record on show. lines: what it holds, a label and a text each. picture: the hemisphere that it sees. served: how many
    pixels of its side it contributes to."""

    number: int
    side: int
    lines: list[tuple[str, str]]
    picture: moderngl.Texture
    served: int


class RecordInspector(Owner):
    """Reads records back, and gathers single ones again to show what they see. buffer_view: borrowed, to draw with."""

    def __init__(self, ctx: moderngl.Context, buffer_view: BufferView) -> None:
        self.ctx, self.buffer_view = ctx, buffer_view
        self._made, self._memo = Workshop(), Memo()
        self.gather_pass: Gather | None = None  # the last one used

    def owned(self) -> tuple[Resource, ...]:
        return (self._made,)

    def forget(self) -> None:
        self._made.clear()
        self._memo.forget()
        self.gather_pass = None

    def table(self, side: int, source: ViewSource) -> RecordTable:
        """The records of a side on the CPU, read again once they have changed."""
        cache = source.renderer.cache
        state = source.renderer, cache.count, cache.revision
        return self._memo.get(f"records of side {side}", state, lambda: read(cache.records))

    def inspect(self, number: int, side: int, source: ViewSource, served: int) -> InspectedRecord | None:
        """Record `number` of a side, which serves so many pixels; None before anything is lit."""
        picture = self.hemisphere(number, source)
        if picture is None:
            return None
        lines = self.table(side, source).describe(number, source.view, source.settings, source.origin)
        return InspectedRecord(number, side, lines, picture, served)

    def hemisphere(self, number: int, source: ViewSource) -> moderngl.Texture | None:
        """Return the hemisphere of record `number` as a texture, exposed as the source is; None before anything is lit.

        The texture is RGBA8, bottom row first, this object's own, and holds until the next call.
        """
        renderer, world = source.renderer, source.renderer.world
        settings = renderer.scheduler.settings  # those by which records are gathered: without bounces, the last that had some
        if renderer.shadows is None:
            return None
        kind, more = kinds.kind(self.ctx, settings), settings.most_bounces > 1
        made_for = world, kind, more, settings.gather_size, light_defines(world.scene)
        plain = replace(settings, light_samples=0)  # rays find emitters at their full radiance
        gather = self._made.get("gather", made_for, lambda: kinds.gather_pass(world, plain, capacity=1))
        picture = self._made.get("picture", gather.cell, lambda: self.ctx.texture(gather.cell, 4))
        target = self._made.get("target", picture, lambda: Target(self.ctx, gather.cell, textures=[picture]))
        self.gather_pass = gather
        site, light = renderer.cache.sites(slice(number, number + 1)), renderer.scheduler.gatherer.light(renderer.shadows)
        atlas = gather(light, site, np.array([number]), settings.seed)
        draw_atlas(self.buffer_view.canvas(target), atlas, source.gain, sky_uniforms(world.scene, sky_maps(world)))
        return picture
