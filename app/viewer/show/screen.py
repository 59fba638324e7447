"""Shared parts of all drawing: the window as a target, programs that are made on first use, colour maps, single texels."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Uniforms
from irrsplat.core.color import srgb
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Region, Screen, Target
from irrsplat.image.tonemap import viridis
from irrsplat.scene.model import Camera

__all__ = ["Picture", "Programs", "Region", "Screen", "clear", "scale", "texel", "view_uniforms"]

_COLOURS = 1024  # texels in each row of the colour table


def texel(texture: moderngl.Texture, x: int, y: int) -> np.ndarray:
    """Return the components of one texel, float32, without a copy of the whole texture. (0, 0) is the upper left texel."""
    framebuffer = texture.ctx.framebuffer([texture])
    found = np.frombuffer(framebuffer.read((x, texture.height - 1 - y, 1, 1), texture.components, dtype="f4"), np.float32)
    framebuffer.release()
    return found


def some_rows(texture: moderngl.Texture, most: int) -> np.ndarray:
    """Return (N, 4) the texels of about `most` rows of a float32 texture."""
    framebuffer, step = texture.ctx.framebuffer([texture]), max(texture.height // most, 1)
    rows = [framebuffer.read((0, y, texture.width, 1), 4, dtype="f4") for y in range(0, texture.height, step)]
    framebuffer.release()
    return np.frombuffer(b"".join(rows), np.float32).reshape(-1, 4)


class Picture(Target):
    """Display colours, opaque over the cleared window. filter: by which the window enlarges them."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], filter: int = moderngl.NEAREST) -> None:
        texture = ctx.texture(size, 4)
        texture.swizzle, texture.filter = "RGB1", (filter, filter)
        texture.repeat_x = texture.repeat_y = False
        super().__init__(ctx, size, textures=[texture])

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.gl, *self.textures)


class Programs(Owner):
    """The shared tools of all drawing: programs, each made on first use and kept.

    colours: the table for shaders/viewer/colours.glsl over 0..1. Its lower row is viridis, its upper row sRGB.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        t = np.linspace(0.0, 1.0, _COLOURS)
        rows = np.stack([viridis(t), np.repeat(srgb(t)[:, None], 3, axis=1)])
        self.colours = ctx.texture((_COLOURS, 2), 3, rows.astype("f4").tobytes(), dtype="f4")  # linear filter by default
        self._made = Workshop()

    def owned(self) -> tuple[Resource, ...]:
        return (self.colours, self._made)

    def forget(self) -> None:
        self._made.clear()

    def __call__(self, fragment: str, vertex: str = "lib/fullscreen", defines: Mapping[str, object] | None = None) -> Program:
        """Return the program of these shaders and defines."""
        key = f"{fragment} {vertex} {sorted((defines or {}).items())}"
        return self._made.get(key, None, lambda: Program(self.ctx, fragment, vertex, defines))


def scale(target: Target, gbuffer: GBuffer) -> tuple[float, float]:
    """Return the pixels of the view per pixel of the target, in x and y."""
    return gbuffer.position.width / target.size[0], gbuffer.position.height / target.size[1]


def clear(target: Target, colour: tuple[float, float, float], region: Region | None = None) -> None:
    """Fill the target, or a region of it, with a display colour."""
    target.use(scissor=region)
    target.gl.clear(*colour, 1.0, viewport=region)


def view_uniforms(target: Target, gbuffer: GBuffer, camera: Camera) -> Uniforms:
    """Return the uniforms of shaders/viewer/markers/hidden.glsl and of all programs that draw in the view.

    With depth clamp on, the planes of `clip_from_world` at 1e-3 and 1e3 m clip nothing.
    """
    width, height = gbuffer.position.size
    return {
        "position": gbuffer.position,
        "normal": gbuffer.normal,
        "albedo": gbuffer.albedo,
        "pixel": camera.screen / height,
        "scale": scale(target, gbuffer),
        "clip_from_world": camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
    }
