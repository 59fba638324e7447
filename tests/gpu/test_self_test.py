"""The self-test: a driver passes, or is refused by name; and triangles numbered by a geometry shader."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.errors import GLError
from irrsplat.gpu import self_test
from irrsplat.gpu.target import Target
from tests.renderer.test_renderer import room


@pytest.fixture(autouse=True)
def anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget the drivers that were tested before."""
    monkeypatch.setattr(self_test, "_results", {})


def test_this_opengl_passes_and_is_left_as_it_was(ctx: moderngl.Context) -> None:
    target = Target(ctx, (3, 2), (4,))
    target.clear(7.0)
    self_test.numbers_triangles(ctx)
    assert ctx.fbo is target.gl and (target.read() == 7.0).all()
    target.release()


def test_triangles_numbered_by_a_geometry_shader_are_the_same(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """For drivers that give fragment shaders no gl_PrimitiveID otherwise (softpipe), or confuse varyings next to it (llvmpipe of
    Mesa 26.0): all buffers."""
    if not self_test.numbers_triangles(ctx):
        pytest.skip("this driver has no other way to compare with")
    pictures = []
    for plain in (True, False):
        monkeypatch.setattr(self_test, "numbers_triangles", lambda ctx, plain=plain: plain)
        with Renderer(room(), (24, 16), ctx=ctx, gather="plane", bounces=1, gather_size=16, shadow_size=64) as renderer:
            pictures.append(renderer.render())
    for name, tolerance in (("position", 1e-5), ("normal", 1e-5), ("albedo", 1e-6), ("emission", 1e-6), ("irradiance", 2e-2)):
        one, other = (getattr(picture, name) for picture in pictures)  # a driver may begin a triangle at another corner
        assert one.any() and np.abs(one - other).max() <= tolerance * np.abs(one).max(), name


def test_a_driver_without_numbers(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """A geometry shader that numbers triangles suffices. A driver without either is refused by each call."""
    monkeypatch.setattr(self_test, "_holds", lambda ctx, by: by)
    assert not self_test.numbers_triangles(ctx)
    monkeypatch.setattr(self_test, "_holds", lambda ctx, by: False)
    self_test._results.clear()
    for _ in range(2):
        with pytest.raises(GLError, match="fails the self-test of gl_PrimitiveID; update it"):
            self_test.numbers_triangles(ctx)
