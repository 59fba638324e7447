"""The record under the cursor: its values, its pixels, and its hemisphere."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, ViewSource
from irrsplat.app.viewer.buffers.tiled_buffers import draw_atlas
from irrsplat.app.viewer.show.screen import Programs, Texels
from irrsplat.core.buffers import Records
from irrsplat.core.color import LUMINANCE
from irrsplat.core.memo import Memo
from irrsplat.core.record_layout import COLUMNS
from irrsplat.gather import kinds
from irrsplat.gather.look import Gather
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target
from irrsplat.image.view import View
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.sky import sky_maps, sky_uniforms
from irrsplat.records.weight import own_radii, record_distance, record_weight, view_radius
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


@dataclass(frozen=True)
class RecordTable:
    """The records on the CPU, float32 arrays with a row for each record; record_layout.COLUMNS describes the columns.

    luminance_floor: as buffers.Records has it.
    """

    position: np.ndarray
    normal: np.ndarray
    irradiance: np.ndarray
    radius: np.ndarray
    gradient: np.ndarray
    axis: np.ndarray
    curvature: np.ndarray
    max_radius: np.ndarray
    limit: np.ndarray
    luminance_floor: float = 0.0

    def __len__(self) -> int:
        return len(self.radius)

    def slope(self) -> np.ndarray:
        """(N,) |∇E| of luminance in W/m³."""
        slope: np.ndarray = np.linalg.norm(np.einsum("ncx,c->nx", self.gradient, LUMINANCE), axis=1)
        return slope

    def reach(self, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray:
        """(N, 2) the radii a·R in metres along `axis` and across it, with all limits of a view of `size` (width, height) and the
        settings, as shaders/records/view_radius.glsl has them."""
        radii = own_radii(vars(self), self.luminance_floor, settings)
        distance = np.linalg.norm(self.position - np.asarray(camera.eye), axis=1)
        return view_radius(radii * self.limit[:, None], distance[:, None], camera, size, settings)

    def weights(self, p: np.ndarray, n: np.ndarray, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray:
        """(N,) every record's raw w at a point p with unit normal n, (3,) each; 0 where it does not count there."""
        radii, apart = self.reach(camera, size, settings) / settings.a, p - self.position
        distance = record_distance(apart, self.axis, radii)
        w = record_weight(distance, apart, n, self.normal, radii[:, 1], settings.hessian)
        counts = w > 1.0 / settings.a
        return np.where(counts, w, 0.0)

    def pick(self, texels: Texels, view: View, settings: Settings, x: int, y: int) -> int | None:
        """The number of the record that weighs most at pixel (x, y) of the view, (0, 0) the upper left one; None for none."""
        position = view.gbuffer.position
        if not len(self) or not (0 <= x < position.width and 0 <= y < position.height):
            return None
        here = texels(position, x, y)
        if here[3] == 0.0:
            return None
        w = self.weights(here[:3], texels(view.gbuffer.normal, x, y)[:3], view.camera, view.gbuffer.position.size, settings)
        best = int(np.argmax(w))
        return best if w[best] > 0.0 else None

    def describe(
        self, number: int, view: View, settings: Settings, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> list[tuple[str, str]]:
        """Return the values of record `number`, a label and a text with unit each. origin: of the positions, world space."""
        E, R = self.irradiance[number], float(self.radius[number])
        along, across = self.reach(view.camera, view.gbuffer.position.size, settings)[number]
        lines = [
            ("record", f"{number} of {len(self)}"),
            ("position", " ".join(f"{v:.3f}" for v in self.position[number].astype(float) + origin) + " m"),
            ("normal", " ".join(f"{v:.3f}" for v in self.normal[number])),
            ("irradiance", " ".join(f"{v:.3g}" for v in E) + " W/m²"),
            ("luminance", f"{float(E @ LUMINANCE):.3g} W/m²"),
            ("R", f"{R:.3g} m"),
            ("a·R", f"{settings.a * R:.3g} m, here {along:.3g} by {across:.3g} m"),
        ]
        if settings.gradients:
            lines.append(("|grad E|", f"{float(self.slope()[number]):.3g} W/m³"))
        if self.axis[number].any():
            lines.append(("curvature", " and ".join(f"{v:.3g}" for v in self.curvature[number]) + " of E per m²"))
        return lines


def read(records: Records) -> RecordTable:
    """The records of the GPU. Waits until what is being drawn is done, so it is for a click, or for a cache that has changed."""
    names = [field.name for field in fields(RecordTable) if field.name in COLUMNS]
    return RecordTable(**records.read(*names), luminance_floor=records.luminance_floor)


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
    """Reads records back, and gathers single ones again to show what they see. programs: borrowed."""

    def __init__(self, programs: Programs) -> None:
        self.ctx, self.programs = programs.ctx, programs
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
        draw_atlas(Canvas(target, self.programs), atlas, source.gain, sky_uniforms(world.scene, sky_maps(world)))
        return picture
