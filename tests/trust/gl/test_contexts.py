"""Lost, shared and alternating OpenGL contexts."""

from __future__ import annotations

import moderngl
import pytest

import irrsplat
from irrsplat import LightMeter, Renderer
from irrsplat.core.errors import GLError
from irrsplat.gpu import context
from tests.renderer.test_renderer import FAST, room

SIZE = (24, 20)


@pytest.mark.parametrize("given", [False, True], ids=("own context", "a host's"))
def test_a_lost_context_raises_an_error_and_can_be_released(given: bool) -> None:
    ctx = context.create()
    renderer = Renderer(room(), SIZE, ctx=ctx if given else None, **FAST)
    renderer.render()
    meter = LightMeter(room(), ctx=renderer.ctx, bounces=1, gather_size=8, shadow_size=64)
    renderer.ctx.release()
    for use in (renderer.render, renderer.frame, lambda: renderer.resize((8, 8)), lambda: renderer.relight(())):
        with pytest.raises(GLError, match="context has been released"):
            use()
    for one in (meter, meter, renderer, renderer):
        one.release()
    with pytest.raises(GLError, match="has been released"):
        meter.measure([[0, 0, 0]], [0, 0, 1])
    ctx.release()


def test_renderers_alternate_with_a_host() -> None:
    """The host draws with its own state between rounds: each renderer has the records and pictures of a separate one."""
    scenes = room(), room(sky=0.7)
    alone = [irrsplat.render(scene, SIZE, **FAST) for scene in scenes]
    host = context.create()
    try:
        picture = host.simple_framebuffer(SIZE)
        with Renderer(scenes[1], SIZE, ctx=host, **FAST) as lent, Renderer(scenes[0], SIZE, **FAST) as own:
            for _ in range(3):
                own.frame()
                context.make_current(host)
                picture.use()
                picture.color_mask = False, True, False, True
                host.enable_only(moderngl.BLEND | moderngl.CULL_FACE | moderngl.DEPTH_TEST)
                host.front_face, host.blend_func, host.depth_func = "cw", (moderngl.ZERO, moderngl.ONE), ">"
                host.wireframe, picture.scissor = True, (1, 1, 2, 2)
                picture.clear(1.0, 0.5, 0.25)
                lent.frame()
            own_frame = own.render()
            context.make_current(host)
            lent_frame = lent.render()
            assert host.error == "GL_NO_ERROR"
        for found, one in zip((own_frame, lent_frame), alone, strict=True):
            for name in ("image", "irradiance", "records_position", "records_irradiance"):
                assert getattr(found, name).tobytes() == getattr(one, name).tobytes(), name
    finally:
        host.release()
