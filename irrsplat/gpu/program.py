"""A GPU program called like a function: its uniform declarations are the names of its arguments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal
from weakref import WeakValueDictionary

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.vertex_layout import ATTRIBUTES, FORMAT
from irrsplat.gpu import context, self_test, shader_source
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.target import Target

DEPTH_CLAMP = 0x864F
CLIP_DISTANCE0 = 0x3000


@dataclass(frozen=True)
class DrawState:
    """The complete fixed-function state of one draw; default: no depth test, blending or culling.

    depth: the test, "<" or "1" (always passes), or None. blend: "add", "over" (by the fragment's alpha), "premultiplied" (over,
    by colours times alpha), "min", "multiply" or None. cull: "front", "back" or None. depth_clamp: draw geometry before the near
    plane instead of clipping it. clip_planes: number of gl_ClipDistance in use.
    """

    depth: Literal["<", "1"] | None = None
    depth_write: bool = True
    blend: Literal["add", "over", "premultiplied", "min", "multiply"] | None = None
    cull: Literal["front", "back"] | None = None
    depth_clamp: bool = False
    clip_planes: int = 0


_BLENDS = {
    "add": (moderngl.ONE, moderngl.ONE),
    "over": (moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA),
    "premultiplied": (moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA),
    "min": (moderngl.ONE, moderngl.ONE),
    "multiply": (moderngl.DST_COLOR, moderngl.ZERO),
}


@dataclass(frozen=True)
class SampledTexture:
    """A texture with filters and wrapping other than its own."""

    texture: moderngl.Texture
    sampler: moderngl.Sampler


@dataclass(frozen=True)
class Draw:
    """One of several draws of a geometry: `count` indices from `first` on, with its own uniforms."""

    first: int
    count: int
    uniforms: Mapping[str, Any]


class _Linked:
    """A linked program, which all Programs of equal text in a context share. users: their number.

    Many passes differ in their sizes alone, and software OpenGL compiles each linked program anew at its first draw.
    """

    _all: ClassVar[WeakValueDictionary[tuple[object, ...], _Linked]] = WeakValueDictionary()

    def __init__(self, ctx: moderngl.Context, vertex: str, fragment: str, geometry: str | None) -> None:
        self.ctx, self.texts, self.users = ctx, (vertex, fragment, geometry), 0
        self.gl = context.link(ctx, vertex, fragment, geometry)

    @staticmethod
    def of(ctx: moderngl.Context, vertex: str, fragment: str, geometry: str | None) -> _Linked:
        """Return the linked program of these vertex, fragment and geometry shaders, with a user more.

        Raises moderngl.Error if it does not compile or link.
        """
        key = id(ctx), vertex, fragment, geometry  # an entry keeps its context alive, so that no id is reused
        found = _Linked._all.get(key) or _Linked(ctx, vertex, fragment, geometry)
        _Linked._all[key] = found
        found.users += 1
        return found

    def release(self) -> None:
        """Leave the program; the last user frees it."""
        self.users -= 1
        if not self.users:
            self._all.pop((id(self.ctx), *self.texts), None)
            self.gl.release()


class Program:
    """`Program(ctx, "image/gbuffer")` is shaders/image/gbuffer.vert and .frag, compiled and linked at its first draw.

    Each call must give every declared uniform by name (samplers take textures), and no other; else TypeError. A compiler error is
    a ShaderError at the first draw, not in the constructor.
    """

    def __init__(
        self, ctx: moderngl.Context, fragment: str, vertex: str | None = None, defines: Mapping[str, object] | None = None
    ) -> None:
        self.ctx = ctx
        self.name = fragment
        self._files = f"{vertex or fragment}.vert", f"{fragment}.frag"
        self._defines = dict(defines or {})
        self._arrays: dict[tuple[int, int], moderngl.VertexArray] = {}
        self._linked: _Linked | None = None

    @cached_property
    def _source(self) -> list[shader_source.Source]:
        """The vertex and the fragment shader. Many programs are never drawn: their files are not read."""
        return [shader_source.load(file, self._defines) for file in self._files]

    @cached_property
    def uniforms(self) -> dict[str, str]:
        """The declared uniforms: name → type."""
        return {name: kind for source in self._source for name, kind in source.uniforms.items()}

    @cached_property
    def units(self) -> dict[str, int]:
        """The texture unit of each sampler."""
        return {name: unit for unit, name in enumerate(name for name, kind in self.uniforms.items() if "sampler" in kind)}

    def _link(self) -> _Linked:
        vertex, fragment, geometry = self._source[0].text, self._source[1].text, None
        if "gl_PrimitiveID" in fragment and not self_test.numbers_triangles(self.ctx):
            geometry, fragment = shader_source.numbering_triangles(vertex, fragment, self._defines)
        try:
            return _Linked.of(self.ctx, vertex, fragment, geometry)
        except moderngl.Error as error:
            log = str(error)
            faulty = self._source[0] if "vertex_shader" in log.lower().replace(" ", "_") else self._source[1]
            raise shader_source.ShaderError(shader_source.explain(log, faulty)) from error

    @property
    def gl(self) -> moderngl.Program:
        """The linked program; raises ShaderError if it does not compile."""
        if self._linked is None:
            linked = self._link()
            self.active = set(linked.gl)
            for name in self.units.keys() & self.active:
                linked.gl[name].value = self.units[name]  # type: ignore[union-attr]
            self._array_inputs: list[Any] = []  # keeps the arrays' inputs alive, so that no id is reused
            self._linked = linked  # last: marks the program as linked
        return self._linked.gl

    def declared(self, uniforms: Uniforms) -> dict[str, Any]:
        """Return the uniforms that the shaders declare."""
        return {name: value for name, value in uniforms.items() if name in self.uniforms}

    def __call__(
        self,
        target: Target,
        *,
        state: DrawState = DrawState(),
        geometry: Geometry | None = None,
        draws: Sequence[Draw] | None = None,
        instances: int = 1,
        numbers: moderngl.Buffer | None = None,
        part: str = "all",
        vertices: int = 3,
        mode: int = moderngl.TRIANGLES,
        viewport: tuple[int, int, int, int] | None = None,
        scissor: tuple[int, int, int, int] | None = None,
        **uniforms: Any,
    ) -> None:
        """Draw `geometry` (its `part`, or `draws` of it) into `target`.

        Without geometry, draw `vertices` without attributes, which the vertex shader places by gl_VertexID (default: a triangle
        that covers the target). mode: their primitive, e.g. moderngl.TRIANGLE_STRIP, LINES or POINTS. numbers: int32 attribute
        in_number, one per instance. viewport, scissor: (x, y, width, height) in pixels; default the whole target, and none.
        uniforms: textures, numbers, tuples and arrays; a matrix is (rows, columns), as in numpy.
        """
        names = uniforms.keys() | {name for draw in draws or () for name in draw.uniforms}
        if names != self.uniforms.keys():
            missing, unknown = self.uniforms.keys() - names, names - self.uniforms.keys()
            raise TypeError(f"program '{self.name}': missing uniforms {sorted(missing)}, unknown uniforms {sorted(unknown)}")
        given: dict[str, Any] = {}
        self._set_uniforms(uniforms, given)
        target.use(viewport, scissor, depth_write=state.depth_write)
        self._apply(state)
        array = self._array(geometry, numbers)
        if geometry is None:
            array.render(mode, vertices=vertices, instances=instances)
        elif draws is not None:
            for draw in draws:
                self._set_uniforms(draw.uniforms, given)
                array.render(moderngl.TRIANGLES, vertices=draw.count, first=draw.first)
        else:
            first, count = geometry.parts[part]
            if count:
                array.render(moderngl.TRIANGLES, vertices=count, first=first, instances=instances)
        for i in range(state.clip_planes):
            self.ctx.disable_direct(CLIP_DISTANCE0 + i)
        if state.depth_clamp:
            self.ctx.disable_direct(DEPTH_CLAMP)
        for name in self.units.keys() & given.keys():
            if isinstance(given[name], SampledTexture):
                given[name].sampler.clear(self.units[name])

    def _set_uniforms(self, uniforms: Mapping[str, Any], given: dict[str, Any]) -> None:
        """Set these uniforms, except those whose value in `given` is unchanged."""
        program = self.gl
        for name in uniforms.keys() & self.active:
            value = uniforms[name]
            if given.get(name) is value:
                continue
            given[name] = value
            if name in self.units:
                if isinstance(value, SampledTexture):
                    value.texture.use(self.units[name])
                    value.sampler.use(self.units[name])
                else:
                    value.use(self.units[name])
            elif isinstance(value, np.ndarray) and value.ndim == 2:
                uniform = program[name]
                # OpenGL's matrices are column-major; a compiler may truncate an array after the last used element
                rows = value.T if self.uniforms[name].startswith("mat") else value[: uniform.array_length]  # type: ignore[union-attr]
                uniform.write(rows.astype("f4").tobytes())  # type: ignore[union-attr]
            else:
                program[name].value = tuple(value) if isinstance(value, np.ndarray) else value  # type: ignore[union-attr]

    def _apply(self, state: DrawState) -> None:
        ctx = self.ctx
        flags = (moderngl.DEPTH_TEST if state.depth else 0) | (moderngl.BLEND if state.blend else 0)
        ctx.enable_only(flags | (moderngl.CULL_FACE if state.cull else 0))
        if state.depth:
            ctx.depth_func = state.depth
        if state.blend:
            ctx.blend_equation = moderngl.MIN if state.blend == "min" else moderngl.FUNC_ADD  # type: ignore[assignment]
            ctx.blend_func = _BLENDS[state.blend]
        ctx.wireframe = False
        ctx.front_face = "ccw"  # determines gl_FrontFacing
        if state.cull:
            ctx.cull_face = state.cull
        if state.depth_clamp:
            ctx.enable_direct(DEPTH_CLAMP)
        for i in range(state.clip_planes):
            ctx.enable_direct(CLIP_DISTANCE0 + i)

    def _array(self, geometry: Geometry | None, numbers: moderngl.Buffer | None) -> moderngl.VertexArray:
        key = id(geometry), id(numbers)
        if key not in self._arrays:
            content: list[Any] = []
            if geometry is not None:
                content.append(self._content(geometry.vertices))
            if numbers is not None:
                content.append((numbers, "1i/i", "in_number"))
            index = None if geometry is None else geometry.indices
            array = self.ctx.vertex_array(self.gl, content, index, skip_errors=True)
            self._array_inputs += [geometry, numbers]
            self._arrays[key] = array
        return self._arrays[key]

    def _content(self, buffer: moderngl.Buffer) -> tuple[Any, ...]:
        """Return moderngl's (buffer, format, names…); attributes that the compiler removed are padding."""
        used = [name in self.active for name in ATTRIBUTES]
        padded = [w if u else f"{int(w[:-1]) * 4}x" for w, u in zip(FORMAT.split(), used, strict=True)]
        return (buffer, " ".join(padded), *(n for n, u in zip(ATTRIBUTES, used, strict=True) if u))

    def release(self) -> None:
        """Free the program and its vertex arrays."""
        for array in self._arrays.values():
            array.release()
        self._arrays.clear()
        linked, self._linked = self._linked, None
        if linked is not None:
            linked.release()
