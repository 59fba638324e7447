"""Targets: pictures come back top row first, and a draw's state is its own."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.buffers.shown_buffer import Picture
from irrsplat.core.errors import GLError
from irrsplat.gpu.target import Target, float_texture


def test_the_top_row_comes_first(ctx: moderngl.Context) -> None:
    texture = float_texture(ctx, (2, 3), 1)
    texture.write(np.array([[0, 1], [2, 3], [4, 5]], "f4").tobytes())  # OpenGL's first row is the bottom one
    assert np.array_equal(Target(ctx, (2, 3), textures=[texture]).read()[..., 0], [[4, 5], [2, 3], [0, 1]])


def test_clear_fills_every_attachment_whatever_was_set_before(ctx: moderngl.Context) -> None:
    target = Target(ctx, (4, 4), (4, 1), depth=True)
    target.use(viewport=(0, 0, 1, 1), scissor=(0, 0, 1, 1))
    target.clear(0.25, depth=0.5)
    assert (target.read(0) == 0.25).all() and (target.read(1) == 0.25).all()
    assert target.depth is not None
    assert np.allclose(np.frombuffer(target.depth.read(alignment=1), "f4"), 0.5)


def test_a_driver_without_memory_is_one_line(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """The textures are freed, with and without depth, but for those that the caller gave."""

    def full(*_: object, **__: object) -> None:
        raise moderngl.Error("the framebuffer is not complete (UNSUPPORTED)")

    monkeypatch.setattr(moderngl.Context, "framebuffer", full)
    mine = float_texture(ctx, (3, 2), 1)
    for options in ({"depth": True}, {"depth": False}, {"textures": [mine]}):
        with pytest.raises(GLError, match=r"takes no 3x2 pixels \(the framebuffer is not complete .* take a smaller size"):
            Target(ctx, (3, 2), () if "textures" in options else (4,), **options)
    with pytest.raises(GLError, match="takes no 3x2 pixels"):  # the picture in a viewer's window
        Picture(ctx, (3, 2))
    assert not isinstance(mine.mglo, moderngl.InvalidObject)
