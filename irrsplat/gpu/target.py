"""Textures, and framebuffers with float attachments and an optional depth buffer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import moderngl
import numpy as np

from irrsplat.core.errors import GLError
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu import context
from irrsplat.gpu.resource import Owner

Region = tuple[int, int, int, int]  # x, y, width, height in pixels, from the lower left corner

_LARGE = 8192  # texels along a side: a larger texture may be as large as OpenGL allows
_BAND = 110_000  # pixels: about 25 ms of a processor for a software renderer in the slower passes


def bands(size: tuple[int, int]) -> Iterator[Region]:
    """Yield regions of at most _BAND pixels that cover a picture of `size` (width, height), so that work can stop between two."""
    rows = max(_BAND // size[0], 1)
    return ((0, y, size[0], min(rows, size[1] - y)) for y in range(0, size[1], rows))


def float_texture(ctx: moderngl.Context, size: tuple[int, int], components: int = 4) -> moderngl.Texture:
    """Return a float32 texture of `size` (width, height) for texelFetch: no filter, no repeat."""
    texture = ctx.texture(size, components, dtype="f4")
    texture.filter = moderngl.NEAREST, moderngl.NEAREST
    texture.repeat_x = texture.repeat_y = False
    return texture


def integer_texture(ctx: moderngl.Context, size: tuple[int, int], components: int = 1, dtype: str = "i4") -> moderngl.Texture:
    """Return a texture of int32 or, with the dtype "u4", uint32 components, of `size` (width, height), for texelFetch."""
    texture = ctx.texture(size, components, dtype=dtype)
    texture.filter = moderngl.NEAREST, moderngl.NEAREST
    return texture


def uneven(side: int) -> int:
    """Return the least number from `side` on that is no power of two; a `side` from _LARGE on stays.

    Mesa's software renderer compiles a program anew for textures with a side that is a power of two. Textures whose sides change
    from draw to draw avoid these sides.
    """
    return side if side & (side - 1) or side >= _LARGE else max(side + 1, 3)


def table_texture(ctx: moderngl.Context, rows: np.ndarray, varying: bool = False) -> moderngl.Texture:
    """Return an RGBA32F texture of `rows` (R, C, 4): texel (c, r) is rows[r, c].

    varying: True for a texture with `uneven` sides, except a width of whole table rows.
    """
    rows = np.ascontiguousarray(rows, "f4")
    height, width = rows.shape[:2]
    size = (width if width % TABLE_COLUMNS == 0 else uneven(width), uneven(height)) if varying else (width, height)
    texture = float_texture(ctx, size)
    texture.write(rows, viewport=(0, 0, width, height))
    return texture


def depth_texture(ctx: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    """Return a depth texture of `size` for texelFetch (no comparison)."""
    texture = ctx.depth_texture(size)
    texture.compare_func = ""
    texture.filter = moderngl.NEAREST, moderngl.NEAREST
    texture.repeat_x = texture.repeat_y = False
    return texture


def pixels(texture: moderngl.Texture) -> np.ndarray:
    """Return a float texture as a read-only array (H, W, C) float32, top row first; C is 1 for a scalar texture too.

    Raises GLError if its context has been released.
    """
    context.check_alive(texture.ctx)
    return np.frombuffer(texture.read(), "f4").reshape(texture.height, texture.width, texture.components)[::-1]


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


class Target(Owner):
    """A framebuffer that owns its textures: `textures` in the order of the shader's outputs, `depth` or None."""

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        components: Sequence[int] = (),
        depth: bool = False,
        textures: Sequence[moderngl.Texture] | None = None,
        depth_attachment: moderngl.Texture | None = None,
    ) -> None:
        self.ctx = ctx
        self.size = size
        self.textures = [self.own(float_texture(ctx, size, n)) for n in components] if textures is None else list(textures)
        self.depth = depth_attachment or (self.own(depth_texture(ctx, size)) if depth else None)
        self._outputs = len(self.textures)
        try:
            self.gl = self.own(ctx.framebuffer(self.textures, self.depth))
        except moderngl.Error as error:  # drivers report this when textures could not be allocated
            super().release()
            found = f"OpenGL takes no {size[0]}x{size[1]} pixels ({error})"
            raise GLError(f"{found}: memory may not suffice; take a smaller size") from None

    def use(self, viewport: Region | None = None, scissor: Region | None = None, depth_write: bool = True) -> None:
        """Bind for drawing, with the whole area as viewport by default, and an optional scissor."""
        self.gl.viewport = viewport or (0, 0, *self.size)
        self.gl.scissor = scissor  # type: ignore[assignment]
        self.gl.color_mask = (True,) * 4 if self._outputs == 1 else ((True,) * 4,) * self._outputs  # type: ignore[assignment]
        self.gl.depth_mask = depth_write
        self.gl.use()

    def clear(self, value: float = 0.0, depth: float = 1.0) -> None:
        """Fill every attachment with `value`, and the depth buffer with `depth`."""
        self.use()
        self.gl.clear(value, value, value, value, depth=depth)

    def read(self, attachment: int = 0) -> np.ndarray:
        """Return the attachment as (H, W, C) float32, top row first; C is 1 for a scalar texture too."""
        return pixels(self.textures[attachment])

    def release(self) -> None:
        """Free the framebuffer and the textures that it made."""
        if self.ctx.fbo is self.gl:
            self.ctx.detect_framebuffer(0).use()  # moderngl would bind the released framebuffer again
        super().release()


class Screen(Target):
    """A framebuffer of another owner, such as a window's, as a target; size (width, height) in pixels."""

    def __init__(self, framebuffer: moderngl.Framebuffer, size: tuple[int, int] | None = None) -> None:
        self.ctx = framebuffer.ctx
        self.size = size or framebuffer.size
        self.textures, self.depth, self._outputs = [], None, 1
        self.gl = framebuffer

    def release(self) -> None:
        """Do nothing: the owner frees the framebuffer."""
