"""The g-buffer: position, normals and material at every pixel's centre (Jones 2010, section 3.2), and the filters in front."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Literal

import moderngl
import numpy as np

from irrsplat.core.buffers import Filters, GBuffer, Uniforms
from irrsplat.gpu.program import Draw, DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Region, Target, float_texture
from irrsplat.gpu.world import World
from irrsplat.image.texture_maps import TextureMaps, map_uniforms
from irrsplat.scene.appearance import Appearance, Run
from irrsplat.scene.model import Camera, Part, part_drawn, part_of
from irrsplat.scene.spatial.visible_parts import SceneParts

_NEAR = 1e-6  # of the far distance: used by the matrix only, since no clipping takes place
_EDGE_ON = 5e-7  # of the eye's coordinates: closer to a triangle's plane, the eye lies in the plane
_SURFACES = DrawState(depth="<", depth_clamp=True)
_BEHIND = 0.9998  # in clip space: behind all surfaces (depth < 0.992), in front of the empty depth buffer (1)
_NOTHING = DrawState(depth="<", depth_write=False)
_TINTS = DrawState(depth="<", depth_write=False, depth_clamp=True, blend="multiply")
_GLOWS = replace(_TINTS, blend="add")
# Interpolation rounds differently where the rasteriser counts pixels from another origin. Common cells make a part of a picture
# bit for bit equal to the whole.
CELL_PIXELS = 1 << 22  # pixels of the largest picture drawn as one cell
_CELL_SIDE = 8192  # pixels along its longer side
CELL = 1024  # pixels along a side of the cells of larger pictures


class GBufferTarget(Target):
    """Render target of the g-buffer: the textures of buffers.GBuffer, and depth. Optional textures are made on demand."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        super().__init__(ctx, size, (4,) * 4, depth=True)
        self.place = self.own(Target(ctx, size, textures=self.textures[:1], depth_attachment=self.depth))
        self.depths = self.own(Target(ctx, size, textures=[], depth_attachment=self.depth))
        self.surfaces = self.own(Target(ctx, size, textures=self.textures))
        self._parts = self.own(Workshop())

    def also(self, name: str, components: int, together: bool = False) -> Target:
        """Return a target for a further texture with the same depth; `together`: appended to this target's textures."""
        texture = self._parts.get(name, (), lambda: float_texture(self.ctx, self.size, components))
        textures = [*self.textures, texture] if together else [texture]
        make = partial(Target, self.ctx, self.size, textures=textures, depth_attachment=self.depth)
        return self._parts.get(f"{name} target {together}", (), make)


Sides = Literal["back"] | None  # culled sides


@dataclass(frozen=True)
class _Batch:
    """Runs that differ in uniforms only: draws by the program of these `defines`, with or without back-face culling.

    surfaces: candidates for the g-buffer. filters: draws that may tint surfaces behind. glows: filters that emit.
    """

    defines: Mapping[str, int]
    cull: Sides
    surfaces: tuple[Draw, ...]
    filters: tuple[Draw, ...]
    glows: tuple[Draw, ...]


class GBufferPass(Owner):
    """Draws the world's scene from the eye into float textures of `size` (width, height). maps: textures of surfaces."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], maps: TextureMaps | None = None) -> None:
        self.ctx = ctx
        self.maps = maps or self.own(TextureMaps(ctx))
        self.target = self.own(GBufferTarget(ctx, size))
        self.nothing = self.own(Program(ctx, "lib/nothing", "lib/fullscreen", {"DEPTH": _BEHIND}))
        self.places = {n: self.own(Program(ctx, "lib/place", "lib/fullscreen", {"FOUR": int(n == 4)})) for n in (1, 4)}
        self._cell = self.own(Workshop())  # target of a cell, if it is not the whole picture
        self._programs = self.own(Workshop())
        self._batched: tuple[Sequence[Run], tuple[_Batch, ...]] = (), ()

    def _program(self, fragment: str, defines: Mapping[str, int]) -> Program:
        values: dict[str, object] = {**defines, "MAP_TAPS": self.maps.taps, "EDGE_ON": _EDGE_ON}
        return self._programs.get(f"{fragment} {values}", (), lambda: Program(self.ctx, fragment, "image/gbuffer", values))

    def _batches(self, runs: Sequence[Run]) -> tuple[_Batch, ...]:
        """Return all runs as batches; the same object for the same runs."""
        self.maps.prepare(runs)
        if self._batched[0] is not runs:
            kinds: dict[tuple[object, ...], list[Run]] = {}
            for run in runs:
                kinds.setdefault((run.appearance.single_sided, *_defines(run.appearance).values()), []).append(run)
            self._batched = runs, tuple(map(self._batch, kinds.values()))
        return self._batched[1]

    def _batch(self, runs: Sequence[Run]) -> _Batch:
        appearance, surfaces, filters, glows = runs[0].appearance, [], [], []
        for run in runs:
            appearance = run.appearance
            if appearance.solid:
                surfaces.append(_draw(run, self._map_uniforms(appearance) | {"first_triangle": run.first}))
            if appearance.filters:
                tint = {"alpha_cutoff": appearance.alpha_cutoff}
                filters.append(_draw(run, self._map_uniforms(replace(appearance, emission=None, normal=None)) | tint))
                if appearance.glows:
                    glows.append(_draw(run, self._map_uniforms(replace(appearance, normal=None)) | tint))
        draws = tuple(surfaces), tuple(filters), tuple(glows)
        return _Batch(_defines(appearance), "back" if appearance.single_sided else None, *draws)

    def _map_uniforms(self, appearance: Appearance) -> Uniforms:
        """Return the uniforms of shaders/image/texture_map.glsl."""
        uniforms: Uniforms = {}
        for name, texture in (("albedo", appearance.albedo), ("emission", appearance.emission), ("normal", appearance.normal)):
            if texture is not None:
                uniforms |= {
                    f"{name}_map": self.maps(texture, name != "normal", appearance.alpha_cutoff if name == "albedo" else 0.0)
                } | map_uniforms(name, texture)
        return uniforms | ({"normal_scale": appearance.normal_scale} if appearance.normal is not None else {})

    def __call__(self, world: World, camera: Camera, target: GBufferTarget | None = None) -> GBuffer:
        """Return the g-buffer of `camera` in textures of `target` (default: this pass's), valid until its next use."""
        target = target or self.target
        part = part_drawn(camera, target.size)
        small = part.whole[0] * part.whole[1] <= CELL_PIXELS and max(part.whole) <= _CELL_SIDE
        cell = part.whole if small else (CELL, CELL)
        if cell == part.whole == part.size:
            return self._draw(world, camera, target)
        found = None
        for column, row in product(
            *(range(a // c, -(-(a + n) // c)) for a, n, c in zip(part.corner, part.size, cell, strict=True))
        ):
            found = self._draw_cell(world, camera, part, Part(part.whole, (column * cell[0], row * cell[1]), cell), target)
        assert found is not None
        return found

    def _draw_cell(self, world: World, camera: Camera, part: Part, cell: Part, target: GBufferTarget) -> GBuffer:
        """Draw the part within a cell and copy it to the target; return the whole target's g-buffer."""
        into = self._cell.get("cell", cell.size, lambda: GBufferTarget(self.ctx, cell.size))
        start = (cell.corner[0] - part.corner[0], cell.corner[1] - part.corner[1])
        low = [max(0, -a) for a in start]
        high = [min(n, m - a) for a, n, m in zip(start, cell.size, part.size, strict=True)]
        width, height = high[0] - low[0], high[1] - low[1]
        drawn = self._draw(world, part_of(camera, cell), into, (low[0], low[1], width, height))
        region = (start[0] + low[0], start[1] + low[1], width, height)

        def bring(textures: Sequence[moderngl.Texture], to: Target) -> moderngl.Texture:
            parts: Uniforms = {f"part_{i}": texture for i, texture in enumerate(textures)}
            self.places[len(textures)](to, scissor=region, start=start, **parts)
            return to.textures[0]

        bring(into.textures, target.surfaces)
        mapped = None if drawn.mapped_normal is None else bring([drawn.mapped_normal], target.also("mapped normal", 4))
        filters = drawn.filters
        if filters is not None:
            glow = None if filters.glow is None else bring([filters.glow], target.also("glow", 4))
            tint, opacity = bring([filters.tint], target.also("tint", 4)), bring([filters.opacity], target.also("opacity", 1))
            filters = Filters(tint, opacity, glow)
        position, normal, albedo, emission = target.textures
        return GBuffer(position, normal, albedo, emission, mapped, filters, drawn.emissive, part.corner)

    def _draw(self, world: World, camera: Camera, target: GBufferTarget, scissor: Region | None = None) -> GBuffer:
        """Return the g-buffer of `camera` in the target's textures; scissor: the required pixels."""
        scene, geometry = world.scene, world.geometry
        width, height = target.size
        eye = np.asarray(camera.eye, float)
        far = 1.01 * float(np.linalg.norm(scene.corners - eye, axis=1).max()) + 1e-3 * scene.diagonal
        batches = self._batches(world.runs)
        mapped = any(batch.defines["NORMAL_MAP"] for batch in batches)
        emissive = scene.emissive
        surfaces = target.also("mapped normal", 4, together=True) if mapped else target
        placed: Uniforms = {
            "clip_from_world": camera.clip_from_view(width / height, _NEAR * far, far) @ camera.view_from_world,
            "eye": eye,
            "forward": -camera.axes[2],
            "far": far,
        }
        # depth 0 marks an empty pixel, whose other textures are not read
        target.depths.clear()
        parts = world.parts
        sides = parts.sides(placed["clip_from_world"], eye, far)
        for batch in batches:
            for cull, draws in _visible(parts, batch.surfaces, sides, batch.cull):
                self._program("image/gbuffer", {**batch.defines, "MAPPED_NORMALS": int(mapped), "EMISSIVE": int(emissive)})(
                    surfaces,
                    scissor=scissor,
                    geometry=geometry,
                    draws=draws,
                    state=replace(_SURFACES, cull=cull),
                    **placed,
                    **world.raster_uniforms,
                )
        self.nothing(target.place, scissor=scissor, state=_NOTHING)  # a clear at the start would write to all pixels
        filters = self._filters(batches, world, target, placed, scissor)
        position, normal, albedo, emission = target.textures
        return GBuffer(position, normal, albedo, emission, surfaces.textures[4] if mapped else None, filters, emissive)

    def _filters(
        self, batches: Sequence[_Batch], world: World, target: GBufferTarget, placed: Uniforms, scissor: Region | None
    ) -> Filters | None:
        """Return the filters' transmittance and emission, and the nearest one's opacity; overwrites the target's depth."""
        if not any(batch.filters for batch in batches):
            return None

        def draw(what: str, into: Target, state: DrawState, empty: float) -> moderngl.Texture:
            into.use(depth_write=False)
            into.gl.clear(empty, empty, empty, empty)
            for batch in batches:
                draws = batch.glows if what == "GLOW" else batch.filters
                kept = {"NORMAL_MAP": 0} if what == "GLOW" else {"NORMAL_MAP": 0, "EMISSION_MAP": 0}
                if draws:
                    self._program(
                        "image/tint", {**batch.defines, **kept, "GLOW": 0, "NEAREST": 0, **({what: 1} if what else {})}
                    )(
                        into,
                        scissor=scissor,
                        geometry=world.geometry,
                        draws=draws,
                        state=replace(state, cull=batch.cull),
                        **placed,
                        **world.materials.uniforms,
                    )
            return into.textures[0]

        tint = draw("", target.also("tint", 4), _TINTS, 1.0)
        glow = draw("GLOW", target.also("glow", 4), _GLOWS, 0.0) if any(batch.glows for batch in batches) else None
        return Filters(tint, draw("NEAREST", target.also("opacity", 1), _SURFACES, 0.0), glow)


def _defines(appearance: Appearance) -> dict[str, int]:
    """Return the shader defines of a draw state."""
    return {
        "ALBEDO_MAP": int(appearance.albedo is not None),
        "EMISSION_MAP": int(appearance.emission is not None),
        "NORMAL_MAP": int(appearance.normal is not None),
        "MASK": int(appearance.alpha == "mask"),
        "BLEND": int(appearance.alpha == "blend"),
    }


def _visible(parts: SceneParts, draws: Sequence[Draw], sides: np.ndarray, cull: Sides) -> Iterator[tuple[Sides, list[Draw]]]:
    """Yield the culled side and the draws with it, without invisible parts, in the same order.

    sides: from SceneParts.sides. cull: side culled in any case.
    """
    now: Sides = None
    kept: list[Draw] = []
    for draw in draws:
        for side, first, count in parts.runs(draw.first // 3, draw.count // 3, sides):
            culled: Sides = "back" if side == 1 else cull
            if culled != now and kept:
                yield now, kept
                kept = []
            now = culled
            kept.append(replace(draw, first=3 * first, count=3 * count, uniforms={**draw.uniforms, "first_triangle": first}))
    if kept:
        yield now, kept


def _draw(run: Run, uniforms: Uniforms) -> Draw:
    return Draw(3 * run.first, 3 * run.count, uniforms)
