"""What is drawn over a buffer: records as dots, discs and normals, the scene's edges, and the pixels that one record serves."""

from __future__ import annotations

import math
from typing import Any, Literal

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.legend import Legend, colour_map
from irrsplat.app.viewer.show.screen import Programs, Region, colours, view_uniforms
from irrsplat.core.buffers import Records
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.image.view import View
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from irrsplat.surface_cache.cache import SurfaceCache

By = Literal["radius", "age"]

_OVER = DrawState(blend="over", depth_clamp=True)
_RADIUS = 4.0  # of a dot, pixels
_WIDTH = 1.75  # half a line's, pixels
_RISE = 0.03  # length of a normal, of the image height
_EDGE = (1.0, 0.55, 0.15, 0.55)  # of the wireframe
_SERVED = (0.1, 0.85, 1.0)
_SPAN = 0.01, 0.5  # of a·diagonal: the radii that the colours go from and to


class Markers(Owner):
    """Draws over what is in a target already, in `region` of it alone where one is given; what surfaces hide is left out."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.programs = Programs(ctx)
        self.colours = colours(ctx)
        self.query = ctx.query(samples=True)
        self.number = ctx.buffer(reserve=4)  # of the one record that `serves` is about

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.programs, self.colours, self.number)

    def forget(self) -> None:
        """Keep nothing of the scene that was drawn."""
        self.programs.forget()

    def points(
        self,
        target: Target,
        view: View,
        records: Records,
        *,
        settings: Settings,
        scene: Scene,
        by: By = "radius",
        region: Region | None = None,
    ) -> None:
        """Every record as a dot of constant size, coloured by its radius a·R_k or by its age."""
        program = self.programs("viewer/markers/points", "viewer/markers/points", record_defines(settings.gradients))
        self._draw(program, target, view, records, settings, scene, by, region, radius=_RADIUS)

    def discs(
        self,
        target: Target,
        view: View,
        records: Records,
        *,
        settings: Settings,
        scene: Scene,
        by: By = "radius",
        region: Region | None = None,
    ) -> None:
        """Every record's ellipse of radii a·R, as it reaches in this view, in its tangent plane."""
        segments = _segments(target.size[1], settings)
        program = self.programs("viewer/markers/discs", "viewer/markers/discs", record_defines(settings.gradients))
        self._draw(
            program,
            target,
            view,
            records,
            settings,
            scene,
            by,
            region,
            vertices=2 * segments + 2,
            width=_WIDTH,
            segments=segments,
        )

    def normals(
        self,
        target: Target,
        view: View,
        records: Records,
        *,
        settings: Settings,
        scene: Scene,
        by: By = "radius",
        region: Region | None = None,
    ) -> None:
        """Every record's normal, a line of constant length on screen but for its slant."""
        program = self.programs("viewer/markers/normals", "viewer/markers/normals", record_defines(settings.gradients))
        self._draw(program, target, view, records, settings, scene, by, region, width=_WIDTH, rise=_RISE * view.camera.screen)

    def _draw(
        self,
        program: Program,
        target: Target,
        view: View,
        records: Records,
        settings: Settings,
        scene: Scene,
        by: By,
        region: Region | None,
        vertices: int = 4,
        **rest: Any,
    ) -> None:
        low, high = (0.0, max(records.count - 1, 1)) if by == "age" else np.log(radius_range(settings, scene))
        uniforms = {
            **records.uniforms,
            **view_uniforms(target, view.gbuffer, view.camera),
            **view_radius_uniforms(view.camera, view.gbuffer.position.size, settings),
            "colours": self.colours,
            "size": target.size,
            "by_age": by == "age",
            "span": (low, 1.0 / (high - low)),
            **rest,
        }
        if records.count:
            program(
                target,
                mode=moderngl.TRIANGLE_STRIP,
                vertices=vertices,
                instances=records.count,
                state=_OVER,
                scissor=region,
                **program.declared(uniforms),
            )

    def sites(
        self, target: Target, view: View, surface: SurfaceCache | None, *, exposure: float, region: Region | None = None
    ) -> None:
        """Every site of the surface cache that faces the camera, as a dot in the colour that a white surface has there."""
        count = 0 if surface is None else len(surface.sites)
        if surface is None or surface.records is None or not count:
            return
        program = self.programs("viewer/markers/points", "viewer/markers/sites")
        records = surface.records.records
        uniforms = {
            **view_uniforms(target, view.gbuffer, view.camera),
            "records_position": records.textures["position"],
            "records_normal": records.textures["normal"],
            "surface_values": surface.lookup.values,
            "first": records.count - count,
            "eye": view.camera.eye,
            "size": target.size,
            "gain": 2.0**exposure,
            "radius": _RADIUS,
        }
        program(
            target,
            mode=moderngl.TRIANGLE_STRIP,
            vertices=4,
            instances=count,
            state=_OVER,
            scissor=region,
            **program.declared(uniforms),
        )

    def wireframe(self, target: Target, view: View, geometry: Geometry, *, region: Region | None = None) -> None:
        """The edges of the scene's triangles, thin and half transparent."""
        program = self.programs("viewer/markers/wire", "image/gbuffer")
        state = DrawState(blend="over", depth_clamp=True, wireframe=True)
        uniforms = view_uniforms(target, view.gbuffer, view.camera)
        program(target, geometry=geometry, state=state, scissor=region, **uniforms, tint=_EDGE)
        self.ctx.wireframe = False  # imgui's draws do not set it

    def serves(
        self,
        target: Target,
        view: View,
        records: Records,
        number: int,
        *,
        settings: Settings,
        region: Region | None = None,
    ) -> int:
        """Tint the pixels that record `number` speaks for; how many they are, of the target's and in `region`."""
        if not 0 <= number < records.count:
            return 0
        program = self.programs("viewer/markers/serves", "indirect/splat", record_defines(settings.gradients))
        uniforms = {
            **records.uniforms,
            **view_uniforms(target, view.gbuffer, view.camera),
            **view_radius_uniforms(view.camera, view.gbuffer.position.size, settings),
            "in_front": settings.in_front,
            "forward": -view.camera.axes[2],
            "tint": _SERVED,
        }
        self.number.write(np.array([number], "i4").tobytes())
        with self.query:
            program(
                target,
                mode=moderngl.TRIANGLE_STRIP,
                vertices=4,
                numbers=self.number,
                state=_OVER,
                scissor=region,
                **program.declared(uniforms),
            )
        return int(self.query.samples)


def radius_legend(settings: Settings, scene: Scene, by: By, count: int) -> Legend:
    """What the colours of `count` records stand for."""
    if by == "age":
        return Legend("record number, old to new", "0", str(max(count - 1, 0)), "", colour_map())
    low, high = radius_range(settings, scene)
    text = "radius a·R_k before the view limits it, logarithmic"
    return Legend(text, f"{low:.2g}", f"{high:.2g}", "m", colour_map())


def radius_range(settings: Settings, scene: Scene) -> tuple[float, float]:
    """The radii a·R_k in metres that the colours of records go from and to."""
    return _SPAN[0] * settings.a * scene.diagonal, _SPAN[1] * settings.a * scene.diagonal


def _segments(height: int, settings: Settings) -> int:
    """How many straight pieces a circle is drawn with: n of them are r·(1 - cos(π/n)) ≈ r·π²/2n² pixels off at radius r pixels,
    half a pixel for n = π·√r."""
    r = (settings.radius_max or 50.0) / 100.0 * height
    return min(max(math.ceil(math.pi * math.sqrt(r)), 12), 64)
