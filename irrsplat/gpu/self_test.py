"""A self-test of OpenGL on a few pixels: a driver without a feature may draw nothing and report no error."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import moderngl
import numpy as np

from irrsplat.core import paths
from irrsplat.core.errors import GLError, IrrsplatError
from irrsplat.core.files import write_text
from irrsplat.gpu import context
from irrsplat.gpu.resource import Resource
from irrsplat.gpu.shader_source import numbering_triangles

_FILE, _MOST = "self-test.json", 50  # entries
_VERSION = 3  # of the tests: raise it with FEATURES
_DEPTH_CLAMP, _CLIP_DISTANCE0 = 0x864F, 0x3000
_SIZE = (4, 4)

# A triangle that covers the target, and the half below its diagonal, as instances 0, 1, 2 …
_COVERS = """#version 330 core
flat out int v_instance;
void main()
{
    v_instance = gl_InstanceID;
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
"""


@dataclass(frozen=True)
class Abilities:
    """The abilities of an OpenGL. missing: names of required features. numbers_triangles: True if fragment shaders have
    gl_PrimitiveID without a geometry shader."""

    missing: tuple[str, ...]
    numbers_triangles: bool


T = TypeVar("T", bound=Resource)
_abilities: dict[str, Abilities] = {}  # by driver


def check(ctx: moderngl.Context) -> None:
    """Raise GLError, naming the features, if `ctx` lacks required ones."""
    require(context.describe(ctx), abilities(ctx))


def require(about: context.Description, found: Abilities) -> None:
    """Raise GLError, naming the features, if the abilities `found` of the OpenGL described by `about` lack required ones."""
    if found.missing:
        other = "" if about["software"] else ", or draw on the CPU: set LIBGL_ALWAYS_SOFTWARE=1"
        raise GLError(f"the driver '{about['renderer']}' fails the self-test of {', '.join(found.missing)}; update it{other}")


def abilities(ctx: moderngl.Context) -> Abilities:
    """Return the abilities of `ctx`, tested once per driver. A file keeps passed tests for later processes."""
    extensions = hashlib.sha256(" ".join(sorted(ctx.extensions)).encode()).hexdigest()[:12]
    about = context.describe(ctx)
    name = f"{about['renderer']}; {about['version']}; extensions {extensions}"
    if name not in _abilities:
        _abilities[name] = _stored(name) or _test_and_store(ctx, name)
    return _abilities[name]


def tried(ctx: moderngl.Context) -> Abilities:
    """Return the abilities of `ctx`, tested now; the bound framebuffer is bound again."""
    bound = ctx.fbo or ctx.detect_framebuffer(0)
    try:
        missing = tuple(name for name, holds in FEATURES if not _passes(ctx, holds))
        plain = _passes(ctx, _numbered_triangles)
        if not plain and not _passes(ctx, _numbered_by_geometry_shader):
            missing = (*missing, "gl_PrimitiveID")
    finally:
        bound.use()
    return Abilities(missing, plain)


def _passes(ctx: moderngl.Context, feature: Callable[[moderngl.Context], bool]) -> bool:
    """True if a feature gives the correct result and no OpenGL error."""
    ctx.clear_errors()
    try:
        right = feature(ctx)
    except Exception:  # any exception of moderngl on a driver that refuses a shader or a texture
        right = False
    finally:
        ctx.enable_only(moderngl.NOTHING)
    return right and ctx.error == "GL_NO_ERROR"


# ---- the features ------------------------------------------------------------------------------------------------------


@contextmanager
def _drawing(
    ctx: moderngl.Context, fragment: str, *formats: tuple[int, str], vertex: str = _COVERS, geometry: str | None = None
) -> Iterator[tuple[moderngl.Framebuffer, moderngl.VertexArray]]:
    """Yield a cleared framebuffer with textures of `formats` (components, dtype) and depth, and a program for it; all are
    freed."""
    with ExitStack() as stack:

        def kept(thing: T) -> T:
            stack.callback(thing.release)
            return thing

        textures = [kept(ctx.texture(_SIZE, components, dtype=dtype)) for components, dtype in formats]
        depth = kept(ctx.depth_texture(_SIZE))
        target = kept(ctx.framebuffer(textures, depth))
        text = fragment if fragment.startswith("#version") else "#version 330 core\n" + fragment
        program = kept(context.link(ctx, vertex, text, geometry))
        target.use()
        target.clear()
        ctx.enable_only(moderngl.NOTHING)
        array = kept(ctx.vertex_array(program, []))
        stack.callback(lambda: ctx.detect_framebuffer(0).use())  # moderngl would bind the released framebuffer again
        yield target, array


def _read(target: moderngl.Framebuffer, attachment: int = 0, dtype: str = "f4") -> np.ndarray:
    """Return (height, width, components), bottom row first."""
    texture = target.color_attachments[attachment]
    assert isinstance(texture, moderngl.Texture)
    return np.frombuffer(texture.read(), dtype).reshape(*_SIZE[::-1], texture.components)


def _float_blending(ctx: moderngl.Context) -> bool:
    fragment = """
    flat in int v_instance;
    layout(location = 0) out vec4 a; layout(location = 1) out vec2 b;
    void main() { a = vec4(1e6, 1e-6, -1.0, 0.1) * float(v_instance + 1); b = a.xw; }"""
    with _drawing(ctx, fragment, (4, "f4"), (2, "f4")) as (target, array):
        ctx.enable(moderngl.BLEND)
        ctx.blend_equation = moderngl.FUNC_ADD  # type: ignore[assignment]
        ctx.blend_func = moderngl.ONE, moderngl.ONE
        array.render(vertices=3, instances=3)
        sums, others = _read(target, 0), _read(target, 1)
    six = 6.0 * np.array((1e6, 1e-6, -1.0, 0.1))
    return np.allclose(sums, six, rtol=1e-5, atol=0.0) and np.allclose(others, six[[0, 3]], rtol=1e-5, atol=0.0)


def _clip_distances(ctx: moderngl.Context) -> bool:
    """Cut off the left half by the fifth plane."""
    vertex = """#version 330 core
    out float gl_ClipDistance[5];
    void main()
    {
        gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
        for (int i = 0; i < 4; ++i) gl_ClipDistance[i] = 1.0;
        gl_ClipDistance[4] = gl_Position.x;
    }"""
    with _drawing(ctx, "out float a; void main() { a = 1.0; }", (1, "f4"), vertex=vertex) as (target, array):
        for i in range(5):
            ctx.enable_direct(_CLIP_DISTANCE0 + i)
        array.render(vertices=3)
        for i in range(5):
            ctx.disable_direct(_CLIP_DISTANCE0 + i)
        return bool((_read(target)[..., 0] == (0.0, 0.0, 1.0, 1.0)).all())


def _depth_clamp(ctx: moderngl.Context) -> bool:
    """Draw geometry before the near plane."""
    vertex = _COVERS.replace("0.0, 1.0);", "-3.0, 1.0);")
    with _drawing(ctx, "out float a; void main() { a = 1.0; }", (1, "f4"), vertex=vertex) as (target, array):
        ctx.enable(moderngl.DEPTH_TEST)
        ctx.depth_func = "<"
        ctx.enable_direct(_DEPTH_CLAMP)
        array.render(vertices=3)
        ctx.disable_direct(_DEPTH_CLAMP)
        return bool((_read(target) == 1.0).all())


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


def _numbered_triangles(ctx: moderngl.Context, behind_geometry_shader: bool = False) -> bool:
    """Test the numbers and the interpolated outputs of two triangles on either side of the diagonal. Mesa 26.0's llvmpipe gives
    the right number and wrong interpolated outputs."""
    geometry, fragment = None, _NUMBER
    if behind_geometry_shader:
        geometry, fragment = numbering_triangles(_TWO_TRIANGLES, _NUMBER, {})
    formats = (1, "f4"), (4, "f4"), (4, "f4")
    with _drawing(ctx, fragment, *formats, vertex=_TWO_TRIANGLES, geometry=geometry) as (target, array):
        array.render(vertices=6)
        found, corner, constant = _read(target)[..., 0], _read(target, 1), _read(target, 2)
    below = np.add.outer(np.arange(4), np.arange(4))
    numbered = (found[below < 3] == 1.0).all() and (found[below > 3] == 2.0).all()
    y, x = (2.0 * np.indices((4, 4)) + 1.0) / 4.0 - 1.0
    expected = np.stack([x, y, np.full_like(x, 3.0), np.full_like(x, 5.0)], -1)
    return bool(numbered and np.allclose(corner, expected, atol=1e-5) and np.allclose(constant, (6.0, 7.0, 8.0, 9.0)))


def _numbered_by_geometry_shader(ctx: moderngl.Context) -> bool:
    return _numbered_triangles(ctx, behind_geometry_shader=True)


FEATURES: tuple[tuple[str, Callable[[moderngl.Context], bool]], ...] = (
    ("blending of floats", _float_blending),
    ("gl_ClipDistance", _clip_distances),
    ("GL_DEPTH_CLAMP", _depth_clamp),
)


# ---- the file ----------------------------------------------------------------------------------------------------------


def _test_and_store(ctx: moderngl.Context, name: str) -> Abilities:
    """Return `tried`, and store the result in the file under this name if nothing is missing and the file can be written."""
    found = tried(ctx)
    path = _path()
    if path is not None and not found.missing:
        with suppress(OSError, IrrsplatError):
            path.parent.mkdir(parents=True, exist_ok=True)
            entries = dict(list((_entries(path) | {name: found.numbers_triangles}).items())[-_MOST:])
            write_text(path, json.dumps({"version": _VERSION, "numbers_triangles": entries}, indent=1) + "\n")
    return found


def _stored(name: str) -> Abilities | None:
    """Return the abilities that an earlier process stored under this name; it stores only complete ones."""
    path = _path()
    numbers_triangles = None if path is None else _entries(path).get(name)
    return None if numbers_triangles is None else Abilities((), numbers_triangles)


def _path() -> Path | None:
    folder = paths.cache_folder()
    return None if folder is None else folder / _FILE


def _entries(path: Path) -> dict[str, bool]:
    """Return the file's entries; empty for a file of another format."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        data = json.loads(path.read_bytes())
        if data["version"] == _VERSION:
            return {str(name): value for name, value in data["numbers_triangles"].items() if isinstance(value, bool)}
    return {}
