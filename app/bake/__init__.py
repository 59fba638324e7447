"""Baked lighting for other programs: lightmaps and vertex colours, for `irrsplat bake` and for Python programs.

`bake_lightmap` and `bake_vertices` take a scene and return values with a `save` method.
"""

from irrsplat.app.bake.lightmap import bake_lightmap
from irrsplat.app.bake.vertices import bake_vertices

__all__ = ["bake_lightmap", "bake_vertices"]
