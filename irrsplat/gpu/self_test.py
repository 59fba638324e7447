"""A self-test of OpenGL on a few pixels: the numbers of triangles in fragment shaders, which some drivers lack or confuse."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.errors import GLError
from irrsplat.gpu import context
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.shader_source import numbering_triangles
from irrsplat.gpu.target import Target

_SIZE = (4, 4)
_COMPONENTS = (1, 4, 4)  # of the outputs
_results: dict[str, bool] = {}  # of `numbers_triangles`, by driver

_TWO_TRIANGLES = """#version 330 core
out vec3 v_corner;
flat out float v_flat;
out vec4 v_constant;
void main()
{
    vec2 corners[4] = vec2[](vec2(-1.0), vec2(1.0, -1.0), vec2(-1.0, 1.0), vec2(1.0));
    vec2 corner = corners[gl_VertexID < 3 ? gl_VertexID : gl_VertexID - 2];
    gl_Position = vec4(corner, 0.0, 1.0);
    v_corner = vec3(corner, 3.0);
    v_flat = 5.0;
    v_constant = vec4(6.0, 7.0, 8.0, 9.0);
}"""
_NUMBER = """#version 330 core
in vec3 v_corner;
flat in float v_flat;
in vec4 v_constant;
layout(location = 0) out float a;
layout(location = 1) out vec4 b;
layout(location = 2) out vec4 c;
void main() { a = float(gl_PrimitiveID + 1); b = vec4(v_corner, v_flat); c = v_constant; }"""


def numbers_triangles(ctx: moderngl.Context) -> bool:
    """True if fragment shaders of `ctx` have gl_PrimitiveID without a geometry shader; tested once per driver.

    Raises GLError if they have none with a geometry shader either. The bound framebuffer is bound again.
    """
    about = context.describe(ctx)
    driver = f"{about['renderer']}; {about['version']}"
    if driver not in _results:
        bound = ctx.fbo or ctx.detect_framebuffer(0)
        try:
            plain = _passes(ctx)
            if not plain and not _passes(ctx, by_geometry_shader=True):
                other = "" if about["software"] else ", or draw on the CPU: set LIBGL_ALWAYS_SOFTWARE=1"
                raise GLError(f"the driver '{about['renderer']}' fails the self-test of gl_PrimitiveID; update it{other}")
        finally:
            bound.use()
        _results[driver] = plain
    return _results[driver]


def _passes(ctx: moderngl.Context, by_geometry_shader: bool = False) -> bool:
    """True if `_holds`, without an OpenGL error."""
    ctx.clear_errors()
    try:
        right = _holds(ctx, by_geometry_shader)
    except Exception:  # any exception of moderngl on a driver that refuses a shader or a texture
        right = False
    return right and ctx.error == "GL_NO_ERROR"


def _holds(ctx: moderngl.Context, by_geometry_shader: bool) -> bool:
    """Test the numbers and the interpolated outputs of two triangles on either side of the diagonal. Mesa 26.0's llvmpipe gives
    the right number and wrong interpolated outputs."""
    geometry, fragment = numbering_triangles(_TWO_TRIANGLES, _NUMBER, {}) if by_geometry_shader else (None, _NUMBER)
    with Target(ctx, _SIZE, _COMPONENTS) as target, Owner() as made:
        array = made.own(ctx.vertex_array(made.own(context.link(ctx, _TWO_TRIANGLES, fragment, geometry)), []))
        target.clear()
        ctx.enable_only(moderngl.NOTHING)
        array.render(vertices=6)
        values = [np.frombuffer(texture.read(), "f4").reshape(*_SIZE[::-1], -1) for texture in target.textures]
    number, corner, constant = values[0][..., 0], values[1], values[2]
    below = np.add.outer(np.arange(4), np.arange(4))
    numbered = (number[below < 3] == 1.0).all() and (number[below > 3] == 2.0).all()
    y, x = (2.0 * np.indices((4, 4)) + 1.0) / 4.0 - 1.0
    expected = np.stack([x, y, np.full_like(x, 3.0), np.full_like(x, 5.0)], -1)
    return bool(numbered and np.allclose(corner, expected, atol=1e-5) and np.allclose(constant, (6.0, 7.0, 8.0, 9.0)))
