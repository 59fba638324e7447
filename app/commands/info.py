"""`irrsplat info` and `irrsplat doctor`: contents of a scene, and state of this machine."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from irrsplat import __version__
from irrsplat.app.commands.shared import flags
from irrsplat.app.common.terminal import columns, out
from irrsplat.core.errors import IrrsplatError

if TYPE_CHECKING:
    from irrsplat.core.load_options import LoadOptions
    from irrsplat.scene.model import Camera, Light, Scene
    from irrsplat.sky.environment import Environment

LIBRARIES = ("moderngl", "glcontext", "numpy", "trimesh", "Pillow", "OpenEXR", "rich")
_ORTHOGRAPHIC = 500.0  # scene diagonals: a more distant camera represents an orthographic one


def add(commands: Any) -> None:
    parser = commands.add_parser("info", help="print the content of a scene", description="Print the content of a scene.")
    parser.add_argument(
        "scene", nargs="?", metavar="SCENE", help="a path or the name of a bundled scene (default: list the bundled scenes)"
    )
    flags.add_loading(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the contents of a scene, or the table of bundled scenes."""
    _scene(args.scene, args.loading) if args.scene is not None else _bundled()
    return 0


def add_doctor(commands: Any) -> None:
    """Add `irrsplat doctor`, which has no flags."""
    words = "check OpenGL on this machine"
    description = "Print the OpenGL version of this machine, the result of the self-test, and remedies."
    commands.add_parser("doctor", help=words, description=description).set_defaults(run=run_doctor)


def _scene(source: str, options: LoadOptions) -> None:
    """Print the contents of the scene at a path, or of a bundled one; raise InputError as `irrsplat.load`."""
    from irrsplat.scene import load
    from irrsplat.scene.stand_ins.light import SKY

    it = load(source, **vars(options))
    low, high = it.bounds
    out(f"{it.name}" + (f"  ({it.path})" if it.path else ""))
    closed = sum(mesh.closed for mesh in it.meshes)
    meshes = _count(len(it.meshes), "mesh", "meshes")
    out(f"  triangles  {it.triangles:,} in {meshes}: {closed} closed, {len(it.meshes) - closed} open")
    out(f"  bounds     {_point(low)} to {_point(high)}, diagonal {it.diagonal:g} m, up {_point(it.up)}")
    _materials(it)
    stand_in = not it.own_sky and any(it.sky)
    key = stand_in and it.sky == SKY  # a lone sun has none
    emissive = [mesh for mesh in it.meshes if any(mesh.material.emission)]
    out(
        f"  lights     {len(it.lights)}"
        + (f", and {_count(len(emissive), 'emissive mesh', 'emissive meshes')}" if emissive else "")
    )
    for light in it.lights:
        out(f"    {_light(light)}" + (", added by default" if key and light is it.lights[-1] else ""))
    above = f", brighter above by {_point(it.sky_gradient)}" if any(it.sky_gradient) else ""
    sky = _environment(it.environment) if it.environment is not None else _point(it.sky) + above if any(it.sky) else "black"
    out(f"  sky        {sky}" + (", added by default" if stand_in else ""))
    out(f"  cameras    {len(it.cameras)}")
    for i, camera in enumerate(it.cameras):
        name = (f"'{camera.name}'" if camera.name else "(no name)") + (" default" if i == 0 else "")
        out(f"    {name}: eye {_point(camera.eye)}, target {_point(camera.target)}, {_lens(camera, it.diagonal)}")
    for notice in it.notices:
        out(f"  notice     {notice}")


def _environment(sky: Environment) -> str:
    suns = f", of which {_count(len(sky.suns), 'sun is a light', 'suns are lights')}" if sky.suns else ""
    return f"{sky.about}, mean radiance {_point(sky.mean)}{suns}"


def _materials(scene: Scene) -> None:
    """Print the number of materials and their special kinds, and the textures."""
    materials = list(scene.materials)
    kinds = (
        ("emits", sum(any(m.emission) for m in materials)),
        ("cut out", sum(m.alpha_mode == "mask" for m in materials)),
        ("lets light pass", sum(m.filters for m in materials)),
        ("seen from its front alone", sum(not m.double_sided for m in materials)),
    )
    special = ", ".join(f"{count} {kind}" for kind, count in kinds if count)
    out(f"  materials  {len(materials)}" + (f": {special}" if special else ""))
    images = {id(texture.image): texture.image.pixels for m in materials for texture in m.textures}
    texels = sum(pixels.shape[0] * pixels.shape[1] for pixels in images.values())
    out(f"  textures   {len(images)}" + (f", {texels / 1e6:.3g} megapixels" if images else ""))


def _lens(camera: Camera, diagonal: float) -> str:
    """Return a camera's field of view, or "orthographic" for a very distant camera."""
    distance = math.dist(camera.eye, camera.target)
    if distance > _ORTHOGRAPHIC * diagonal:
        return f"orthographic, {distance * camera.screen:.4g} m high (a pinhole far away)"
    return f"fov {camera.fov:g}°"


def _bundled() -> None:
    from irrsplat.scene import bundled, load

    rows = [("scene", "triangles", "lights", "emissive", "sky", "cameras")]
    for name in bundled():
        it = load(name)
        emissive = sum(any(mesh.material.emission) for mesh in it.meshes)
        sky = "yes" if any(it.sky) or it.environment is not None else "-"
        named = ", ".join(camera.name for camera in it.cameras if camera.name)
        cameras = f"{len(it.cameras)}" + (f" ({named})" if named else "")
        rows.append((name, f"{it.triangles:,}", str(len(it.lights)), str(emissive or "-"), sky, cameras))
    out("\n".join(columns(rows, len(rows[0]))))


def run_doctor(args: argparse.Namespace) -> int:
    """Print versions and OpenGL; return 0 if it suffices, else raise IrrsplatError with the remedy."""
    import platform
    from importlib import metadata  # takes 25 ms, which other commands do without

    out(f"irrsplat    {__version__}")
    out(f"python      {platform.python_version()} on {platform.platform()}")
    missing = []
    for name in LIBRARIES:
        try:
            out(f"{name:<11} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            out(f"{name:<11} missing")
            missing.append(name)
    if missing:
        raise IrrsplatError(f"libraries are missing; run: python3 -m pip install {' '.join(missing)}")
    from irrsplat.gpu import context, self_test

    ctx = context.create()  # its GLError is the advice
    try:
        found, numbered = context.describe(ctx), self_test.numbers_triangles(ctx)
    finally:
        ctx.release()
    out(f"OpenGL      {found['version']}")
    out(f"renderer    {found['renderer']} by {found['vendor']}" + (", on the CPU" if found["software"] else ""))
    out(f"pictures    up to {found['max_texture_size']} pixels a side")
    out("self-test   passed" + ("" if numbered else "; gl_PrimitiveID by geometry shaders"))
    out("enough: OpenGL 3.3 is there" + ("; a GPU with its driver would be faster" if found["software"] else ""))
    return 0


def _light(light: Light) -> str:
    where = ("from " if light.directional else "at ") + _point(light.position)
    if light.directional:
        power = f"irradiance {_point(c * (1.0 if light.physical else math.pi) for c in light.color)} W/m²"
    elif light.physical:
        power = f"intensity {_point(light.color)} W/sr"
    else:
        power = f"diffuse {_point(light.color)} (OpenGL)"
    if light.photometry is not None:
        return f"luminaire {where}, {_luminaire(light)}" + (f" '{light.name}'" if light.name else "")
    cone = f", towards {_point(light.spot_target)}, {light.spot_cutoff:g}° half angle" if light.spot_target is not None else ""
    return f"{light.kind} {where}{cone}, {power}" + (f" '{light.name}'" if light.name else "")


def _luminaire(light: Light) -> str:
    """Return a luminaire's direction, total and peak output; its colour is weighted by luminance."""
    assert light.photometry is not None
    lumens, candela = light.output
    power = f"{lumens:.4g} lm, at most {candela:.4g} cd"
    if light.color != (1.0, 1.0, 1.0):
        power += f", intensity {_point(light.color)}"
    width, length, _ = light.photometry.opening
    opening = f", {width:.3g} x {length:.3g} m (taken as a point)" if max(width, length) > 0.0 else ""
    return f"aimed along {_point(-light.frame[2] + 0.0)}, 0° towards {_point(light.frame[0] + 0.0)}, {power}{opening}"


def _point(values: Iterable[float]) -> str:
    return "(" + " ".join(f"{float(v):.4g}" if abs(v) < 1e4 else f"{round(float(v), 2):.15g}" for v in values) + ")"


def _count(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"
