"""What `irrsplat info` and `irrsplat doctor` print: the contents of a scene, and the state of this machine."""

from __future__ import annotations

import platform
from collections.abc import Iterable
from importlib import metadata
from typing import TYPE_CHECKING

from irrsplat.app.common.version import version
from irrsplat.core.errors import IrrsplatError

if TYPE_CHECKING:
    from irrsplat.core.load_options import LoadOptions
    from irrsplat.scene.model import Light

LIBRARIES = ("moderngl", "glcontext", "numpy", "trimesh", "Pillow", "OpenEXR", "rich")


def scene(source: str, options: LoadOptions) -> None:
    """Print what the scene at a path, or the bundled one of that name, consists of; raises InputError as `irrsplat.load`."""
    from irrsplat.scene import load

    it = load(source, **vars(options))
    low, high = it.bounds
    print(f"{it.name}" + (f"  ({it.path})" if it.path else ""))
    closed = sum(mesh.closed for mesh in it.meshes)
    meshes = _count(len(it.meshes), "mesh", "meshes")
    print(f"  triangles  {it.triangles:,} in {meshes}: {closed} closed, {len(it.meshes) - closed} open")
    print(f"  bounds     {_point(low)} to {_point(high)}, diagonal {it.diagonal:g} m")
    emissive = [mesh for mesh in it.meshes if any(mesh.material.emission)]
    print(
        f"  lights     {len(it.lights)}"
        + (f", and {_count(len(emissive), 'emissive mesh', 'emissive meshes')}" if emissive else "")
    )
    for light in it.lights:
        print(f"    {_light(light)}")
    print(f"  sky        {_point(it.sky) if any(it.sky) else 'black'}")
    print(f"  cameras    {len(it.cameras)}")
    for i, camera in enumerate(it.cameras):
        name = (f"'{camera.name}'" if camera.name else "(no name)") + (" default" if i == 0 else "")
        print(f"    {name}: eye {_point(camera.eye)}, target {_point(camera.target)}, fov {camera.fov:g}°")
    for notice in it.notices:
        print(f"  notice     {notice}")


def bundled() -> None:
    """Print a table of the bundled scenes."""
    from irrsplat.scene import bundled as names
    from irrsplat.scene import load

    rows = [("scene", "triangles", "lights", "emissive", "sky", "cameras")]
    for name in names():
        it = load(name)
        emissive = sum(any(mesh.material.emission) for mesh in it.meshes)
        sky = "yes" if any(it.sky) else "-"
        named = ", ".join(camera.name for camera in it.cameras if camera.name)
        cameras = f"{len(it.cameras)}" + (f" ({named})" if named else "")
        rows.append((name, f"{it.triangles:,}", str(len(it.lights)), str(emissive or "-"), sky, cameras))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def doctor() -> int:
    """Print the versions and the OpenGL here; 0 where that is enough. Raises the IrrsplatError that says what mends it else."""
    print(f"irrsplat    {version()}")
    print(f"python      {platform.python_version()} on {platform.platform()}")
    missing = []
    for name in LIBRARIES:
        try:
            print(f"{name:<11} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            print(f"{name:<11} missing")
            missing.append(name)
    if missing:
        raise IrrsplatError(f"libraries are missing; run: python3 -m pip install {' '.join(missing)}")
    from irrsplat.gather import autotune
    from irrsplat.gpu import context

    ctx = context.create()  # its GLError is the advice
    try:
        found = context.describe(ctx)
    finally:
        ctx.release()
    print(f"OpenGL      {found['version']}")
    print(f"renderer    {found['renderer']} by {found['vendor']}" + (", on the CPU" if found["software"] else ""))
    print(f"pictures    up to {found['max_texture_size']} pixels a side")
    if times := autotune.kept(found):
        rasters = sum(map(autotune.rasters, times))
        print(f"gathers     one bounce: by rasters in {rasters} of the {len(times)} scenes timed here, by rays in the others")
    print("enough: OpenGL 3.3 is there" + ("; a GPU with its driver would be faster" if found["software"] else ""))
    return 0


def _light(light: Light) -> str:
    where = ("from " if light.directional else "at ") + _point(light.position)
    power = f"intensity {_point(light.color)} W/sr" if light.physical else f"diffuse {_point(light.color)} (OpenGL)"
    cone = f", towards {_point(light.spot_target)}, {light.spot_cutoff:g}° half angle" if light.spot_target is not None else ""
    return f"{light.kind} {where}{cone}, {power}" + (f" '{light.name}'" if light.name else "")


def _point(values: Iterable[float]) -> str:
    return "(" + " ".join(f"{float(v):.4g}" for v in values) + ")"


def _count(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"
