"""Baked lighting for other programs: lightmaps and vertex colours, for `irrsplat bake` and for Python programs.

`bake_lightmap` and `bake_vertices` take a scene and return values with a `save` method.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irrsplat.app.bake.lightmap import bake_lightmap
    from irrsplat.app.bake.vertices import bake_vertices

__all__ = ["bake_lightmap", "bake_vertices"]
_FROM = {"bake_lightmap": "lightmap", "bake_vertices": "vertices"}


def __getattr__(name: str) -> object:
    """Import a bake function at its first use: the command line's flags need none of them."""
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_FROM[name]}"), name)
