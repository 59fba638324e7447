"""Scene data as immutable numpy arrays, without OpenGL: meshes, materials, lights, cameras and sky.

Constructors check their arguments, so that the rest of the program can rely on them.
"""

from __future__ import annotations

from irrsplat.scene.model.camera import Camera, Part, measure, part_drawn, part_of
from irrsplat.scene.model.lights import Light, Photometry, sun_lights
from irrsplat.scene.model.scene import Scene
from irrsplat.scene.model.surfaces import AlphaMode, Image, Material, Mesh, Texture, Wrap

__all__ = [
    "AlphaMode",
    "Camera",
    "Image",
    "Light",
    "Material",
    "Mesh",
    "Part",
    "Photometry",
    "Scene",
    "Texture",
    "Wrap",
    "measure",
    "part_drawn",
    "part_of",
    "sun_lights",
]
