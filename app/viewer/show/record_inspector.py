"""The record under the cursor: its values, its pixels, and its hemisphere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Picture, Programs, ViewSource, depth_at
from irrsplat.app.viewer.buffers.table import atlas_tiles
from irrsplat.core.color import LUMINANCE
from irrsplat.core.memo import Memo
from irrsplat.gather import kinds
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import texel
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.weight import reach, weights

Columns = dict[str, np.ndarray]  # the columns of all records on the CPU, by the names in record_layout.COLUMNS
COLUMNS = ("position", "normal", "irradiance", "radius", "gradient", "axis", "curvature", "max_radius", "limit")


@dataclass(frozen=True)
class InspectedRecord:
    """A record on show, with its side.

    lines: its values, a label and a text each. picture: the radiance over its hemisphere.
    """

    side: int
    lines: list[tuple[str, str]]
    picture: moderngl.Texture


class RecordInspector(Owner):
    """The reader of records. It gathers single records again to show their hemispheres. programs: shared, not released by it."""

    def __init__(self, programs: Programs) -> None:
        self.ctx, self.programs = programs.ctx, programs
        self._made, self._memo = self.own(Workshop()), Memo()

    def forget(self) -> None:
        self._made.clear()
        self._memo.forget()

    def columns(self, source: ViewSource) -> Columns:
        """Return the records of a side on the CPU. They are read again after a change."""
        cache = source.renderer.cache
        state = cache.count, cache.revision
        return self._memo.get(f"records of {id(source.renderer)}", state, lambda: cache.records.read(*COLUMNS))

    def _reach(self, source: ViewSource) -> np.ndarray:
        floor, view = source.renderer.cache.records.luminance_floor, source.view
        return reach(self.columns(source), floor, view.camera, view.gbuffer.position.size, source.renderer.settings)

    def pick(self, source: ViewSource, x: int, y: int) -> int | None:
        """Return the number of the record with the greatest weight at pixel (x, y) of the view; None if no record contributes."""
        records, view = source.renderer.cache.records, source.view
        if not records.count or not depth_at(source, x, y):
            return None
        p, n = texel(view.gbuffer.position, x, y)[:3], texel(view.gbuffer.normal, x, y)[:3]
        w = weights(self.columns(source), self._reach(source), p, n, source.renderer.settings)
        return int(np.argmax(w)) if w.any() else None

    def inspect(self, number: int, side: int, source: ViewSource) -> InspectedRecord | None:
        """Return record `number` of a side; None before the first shadow maps."""
        picture = self.hemisphere(number, source)
        return None if picture is None else InspectedRecord(side, self._describe(number, source), picture)

    def _describe(self, number: int, source: ViewSource) -> list[tuple[str, str]]:
        """Return the values of record `number`: a label, and a text with the unit."""
        settings, records = source.renderer.settings, source.renderer.cache.records
        one = {name: column[number] for name, column in self.columns(source).items()}
        along, across = self._reach(source)[number]
        lines = [
            ("record", f"{number} of {records.count}"),
            ("position", " ".join(f"{v:.3f}" for v in one["position"].astype(float) + source.origin) + " m"),
            ("normal", " ".join(f"{v:.3f}" for v in one["normal"])),
            ("irradiance", " ".join(f"{v:.3g}" for v in one["irradiance"]) + " W/m²"),
            ("luminance", f"{float(one['irradiance'] @ LUMINANCE):.3g} W/m²"),
            ("R", f"{float(one['radius']):.3g} m"),
            ("a·R", f"{settings.a * float(one['radius']):.3g} m, here {along:.3g} by {across:.3g} m"),
        ]
        if settings.gradients:
            lines.append(("|grad E|", f"{float(np.linalg.norm(LUMINANCE @ one['gradient'])):.3g} W/m³"))
        if one["axis"].any():
            lines.append(("curvature", " and ".join(f"{v:.3g}" for v in one["curvature"]) + " of E per m²"))
        return lines

    def hemisphere(self, number: int, source: ViewSource) -> moderngl.Texture | None:
        """Return the hemisphere of record `number` as a texture, exposed like `source`; None before the first shadow maps.

        The texture is RGBA8, bottom row first. This object owns it, and the next call overwrites it.
        """
        renderer, world = source.renderer, source.renderer.world
        settings = renderer.scheduler.settings  # the settings of gathers: the last ones with at least one bounce
        if renderer.shadows is None:
            return None
        kind, more = kinds.kind(self.ctx, settings), settings.most_bounces > 1
        made_for = world, kind, more, settings.gather_size, light_defines(world.scene)
        plain = replace(settings, light_samples=0)  # without next-event estimation, rays return the full radiance of emitters
        gather = self._made.get("gather", made_for, lambda: kinds.gather_pass(world, plain, capacity=1))
        picture = self._made.get("picture", gather.cell, lambda: Picture(self.ctx, gather.cell, moderngl.LINEAR))
        site, light = renderer.cache.sites(slice(number, number + 1)), renderer.scheduler.gatherer.light(renderer.shadows)
        atlas = gather(light, site, np.array([number]), settings.seed)
        Canvas(picture, self.programs).tiles("gather_atlas", **atlas_tiles(atlas, renderer, source.gain))
        return picture.textures[0]
