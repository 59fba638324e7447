"""irrsplat: real-time indirect light for diffuse scenes by irradiance cache splatting."""

from irrsplat.errors import GLError, InputError, IrrsplatError
from irrsplat.output import Frame
from irrsplat.renderer import Renderer, render
from irrsplat.scene import load
from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene
from irrsplat.settings import Settings, preset

__version__ = "0.1.0"
__all__ = [
    "Camera",
    "Frame",
    "GLError",
    "InputError",
    "IrrsplatError",
    "Light",
    "Material",
    "Mesh",
    "Renderer",
    "Scene",
    "Settings",
    "load",
    "preset",
    "render",
]
