"""The picture in the window: the buffer of each side, the markers over it, and the inspected record."""

from __future__ import annotations

from dataclasses import dataclass
from math import dist
from typing import cast

import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Identity, Programs, ViewSource, clear
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.objects import meshes_of, pixel_of
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.show.light.why_dark import PointLight, light_at
from irrsplat.app.viewer.show.markers import Markers
from irrsplat.app.viewer.show.record_inspector import InspectedRecord, RecordInspector
from irrsplat.app.viewer.view_options import Point, Surface
from irrsplat.core.memo import Memo
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Region, Target, texel
from irrsplat.renderer import Renderer
from irrsplat.scene import ray_caster

COUNT = 100  # points along a line
_DISCS = 400  # that a picture adds: 600 take 16 ms of a software renderer
_NEAR = 0.02  # share of the depth: a point nearer than this to the surface at its pixel is in view
_DIVIDER = (1.0, 1.0, 1.0)  # display colour of the line between two sides


class Display(Owner):
    """The display of a session's picture. A cursor is a pixel of the window, from the upper left corner."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.programs = self.own(Programs(session.ctx))
        self.markers, self.inspector = self.own(Markers(self.programs)), self.own(RecordInspector(self.programs))
        self.inspected: InspectedRecord | None = None  # the record under the cursor in the last picture
        self._memo = Memo()
        self.complete, self._partial = True, 0  # False if discs are left to the next frame; the number of such pictures
        self._renderers: list[Renderer] = []  # the renderers at the last update

    def update(self, screen: Target, cursor: tuple[int, int] | None = None) -> None:
        """Call `draw`, unless the screen already shows this picture."""
        options, session = self.session.options, self.session
        if self._renderers != session.renderers:
            self._renderers = list(session.renderers)
            for known in (self.inspector, self.programs, self._memo):  # they have data of a scene that is no longer open
                known.forget()
        sides = [self._inputs(side) for side, _ in session.sides()]
        records = (options.discs or options.inspect) and [(r.cache.count, r.cache.revision) for r in session.active]
        marks = options.discs, records, options.plane and Identity(session.plane.measured), options.inspect and cursor
        inputs = sides, options.split, options.divider, marks, Identity(screen), self._partial
        self._memo.get("picture", inputs, lambda: self.draw(screen, cursor))

    def _inputs(self, side: int) -> object:
        """Return the inputs of the picture of a side, apart from the options."""
        name, source = self.session.options.buffer, self.session.source(side)
        return name, source.inputs, BUFFERS[name].in_view or Identity(source.renderer.scheduler.gatherer.atlas)

    def draw(self, screen: Target, cursor: tuple[int, int] | None = None) -> None:
        """Draw both sides, and mark the record under the cursor, if records are inspected."""
        sides, self.complete = list(self.session.sides()), True
        for side, region in sides:
            self._draw_side(screen, side, region)
        self.inspected = self._inspect(screen, cursor) if self.session.options.inspect and cursor is not None else None
        for _, region in sides[1:]:
            assert region is not None
            clear(screen, _DIVIDER, (region[0] - 1, 0, 2, region[3]))

    def _draw_side(self, screen: Target, side: int, region: Region | None) -> None:
        options, source = self.session.options, self.session.source(side)
        canvas, view, renderer = Canvas(screen, self.programs, region), source.view, source.renderer
        BUFFERS[options.buffer].draw(canvas, source)
        if options.plane and self.shows_scene and (measured := self.session.plane.measured) is not None:
            self.markers.plane(canvas, view, measured)
        if options.discs and self.shows_scene:
            most = _DISCS if renderer.about["software"] else renderer.cache.count
            if not self.markers.discs(canvas, view, renderer.cache, renderer.settings, self.session.extent, side, most):
                self.complete, self._partial = False, self._partial + 1

    def _inspect(self, screen: Target, cursor: tuple[int, int]) -> InspectedRecord | None:
        """Return the record with the greatest weight under the cursor, and tint its pixels."""
        side, source, place = self._at(cursor)
        number = self.inspector.pick(source, *place)
        if number is None:
            return None
        canvas, renderer = Canvas(screen, self.programs, dict(self.session.sides()).get(side)), source.renderer
        self.markers.contributes(canvas, source.view, renderer.cache.records, number, renderer.settings)
        return self.inspector.inspect(number, side, source)

    def _at(self, cursor: tuple[int, int]) -> tuple[int, ViewSource, tuple[int, int]]:
        """Return the side at the cursor, its view, and the view's pixel there. Views of a moving camera may be smaller."""
        side = self.session.side_at(cursor[0])
        source, (width, height) = self.session.source(side), self.session.size
        image = source.view.image
        return side, source, (cursor[0] * image.width // width, cursor[1] * image.height // height)

    def value(self, cursor: tuple[int, int]) -> np.ndarray | None:
        """Return the value of the buffer under the cursor. It is read again when the buffer or the cursor has changed."""
        side, source, place = self._at(cursor)
        buffer = BUFFERS[self.session.options.buffer]
        return self._memo.get("value", (side, self._inputs(side), cursor), lambda: buffer.value(source, *place))

    def profile(self, side: int) -> Profile | None:
        """Return the values of a side's buffer along the measured line; None without a line."""
        ends = self.session.options.line
        if ends is None or ends[0] == ends[1]:
            return None
        name, source = self.session.options.buffer, self.session.source(side)
        return self._memo.get("profile", (self._inputs(side), ends), lambda: line_profile(name, source, *ends))

    @property
    def shows_scene(self) -> bool:
        """True if the buffer shows the scene from the camera."""
        return BUFFERS[self.session.options.buffer].in_view

    def _seen(self, cursor: tuple[int, int]) -> tuple[ViewSource, tuple[int, int]] | None:
        """Return the view at the cursor, and its pixel there; None if no view of the scene is shown."""
        return self._at(cursor)[1:] if self.session.views and self.shows_scene else None

    def mesh_at(self, cursor: tuple[int, int]) -> int | None:
        """Return the number of the mesh at the cursor; None if no mesh is there."""
        if (seen := self._seen(cursor)) is None:
            return None
        source, place = seen
        if texel(source.view.gbuffer.position, *place)[3] <= 0.0:
            return None
        (mesh,) = meshes_of(source.renderer.scene, texel(source.view.gbuffer.emission, *place)[3:].astype(int))
        return int(mesh) if mesh >= 0 else None

    def surface_at(self, cursor: tuple[int, int]) -> Surface | None:
        """Return the visible surface point at the cursor, with its normal; None for no surface."""
        if (seen := self._seen(cursor)) is None:
            return None
        source, place = seen
        *point, depth = texel(source.view.gbuffer.position, *place).tolist()
        normal = texel(source.view.gbuffer.normal, *place)[:3].tolist()
        return (cast(Point, tuple(point)), cast(Point, tuple(normal))) if depth > 0.0 else None

    def point_at(self, cursor: tuple[int, int] | None) -> Point | None:
        """Return the visible world point at the cursor; None for no surface."""
        surface = None if cursor is None else self.surface_at(cursor)
        return None if surface is None else surface[0]

    def point_light(self) -> PointLight | None:
        """Return the direct light at the clicked surface point; None without such a point."""
        surface, renderer = self.session.options.surface, self.session.renderers[0]
        if surface is None or not self.session.views or not ray_caster.available():
            return None
        inputs = Identity(renderer.scene), surface
        return self._memo.get("point light", inputs, lambda: light_at(renderer.scene, renderer.world.caster, *surface))

    def light_at(self, point: Point) -> float | None:
        """Return the illuminance at a point in lux, from the left picture; None for a point that is not in view."""
        source = self.session.source(0)
        pixel = pixel_of(source.view.camera, source.view.gbuffer.position.size, point)
        if pixel is None:
            return None
        x, y, z, depth = texel(source.view.gbuffer.position, *pixel).tolist()
        if depth <= 0.0 or dist((x, y, z), point) > _NEAR * depth:
            return None
        lux = self._memo.get("light", (source.inputs, pixel), lambda: BUFFERS["light"].value(source, *pixel))
        return None if lux is None else float(lux[0])


@dataclass(frozen=True)
class Profile:
    """The values of a buffer along a line.

    metres: (N,) distances from the first end. values: (N, C) in `unit`; NaN where the view has no value. channels: the names of
    the C channels.
    """

    metres: np.ndarray
    values: np.ndarray
    unit: str
    channels: tuple[str, ...]

    @property
    def summary(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """The least, mean and greatest value, each (C,); None if no point has a value."""
        there = self.values[np.isfinite(self.values).all(axis=1)]
        return (there.min(0), there.mean(0), there.max(0)) if len(there) else None


def line_profile(name: str, source: ViewSource, start: Point, end: Point) -> Profile:
    """Return the profile of the buffer `name` between two points. Where a surface hides the line, its values count."""
    buffer, share, view = BUFFERS[name], np.linspace(0.0, 1.0, COUNT), source.view
    points = np.array(start) + share[:, None] * np.subtract(end, start)
    places = [pixel_of(view.camera, view.gbuffer.position.size, (x, y, z)) for x, y, z in points.tolist()]
    found = [None if place is None else buffer.value(source, *place) for place in places]
    channels = max((len(value) for value in found if value is not None), default=1)
    values = np.array([np.full(channels, np.nan) if value is None else value for value in found], float)
    names = ("",) if channels == 1 else ("x", "y", "z") if name in ("position", "normal") else ("r", "g", "b")
    return Profile(share * dist(start, end), values, buffer.legend(source).unit, names)
