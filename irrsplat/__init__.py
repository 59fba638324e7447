"""irrsplat: real-time indirect light for diffuse scenes by irradiance cache splatting.

The names below are imported when they are first used (PEP 562), so that reading a scene never loads OpenGL.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from irrsplat.core.errors import GLError, InputError, IrrsplatError
    from irrsplat.image.frame import Frame
    from irrsplat.meter.light_meter import LightMeter, irradiance
    from irrsplat.renderer import Renderer, render
    from irrsplat.scene import load
    from irrsplat.scene.io.arrays import make_mesh, make_scene
    from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene
    from irrsplat.settings import Settings, preset

__version__ = "0.2.0"
__all__ = [
    "Camera",
    "Frame",
    "GLError",
    "InputError",
    "IrrsplatError",
    "Light",
    "LightMeter",
    "Material",
    "Mesh",
    "Renderer",
    "Scene",
    "Settings",
    "irradiance",
    "load",
    "make_mesh",
    "make_scene",
    "preset",
    "render",
]

_NAMES = {  # module: what it gives, as in the imports above
    "irrsplat.core.errors": ("GLError", "InputError", "IrrsplatError"),
    "irrsplat.image.frame": ("Frame",),
    "irrsplat.meter.light_meter": ("LightMeter", "irradiance"),
    "irrsplat.renderer": ("Renderer", "render"),
    "irrsplat.scene": ("load",),
    "irrsplat.scene.io.arrays": ("make_mesh", "make_scene"),
    "irrsplat.scene.model": ("Camera", "Light", "Material", "Mesh", "Scene"),
    "irrsplat.settings": ("Settings", "preset"),
}
_HOMES = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'irrsplat' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
