"""Flags of `irrsplat bake`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

DESCRIPTION = "Bake light into a lightmap or vertex colours, for programs without indirect light."
EPILOG = (
    "A lightmap requires the extra: pip install 'irrsplat[bake]'. A .png (16 bits) and an .exr\n"
    "next to the .glb have the same map. docs/baking.md describes the conventions for other programs."
)
KINDS = ("lightmap", "vertices")


def add(parser: argparse.ArgumentParser, number: Callable[[str], float], whole: Callable[[str], int]) -> None:
    """Add the bake flags. number, whole: parsers of a finite number and of a positive whole number."""
    add = parser.add_argument
    add("-o", "--output", metavar="OUT", required=True, help="a .glb")
    add("--to", choices=KINDS, default="lightmap", help="target of the bake (default: lightmap)")
    words = "all light, or indirect light only (default: all)"
    add("--light", choices=("all", "indirect"), default="all", help=words)
    words = "lightmap: black materials that emit the map, for any program; or the materials of the scene and a map in W/m²"
    add("--form", choices=("radiance", "irradiance"), help=f"{words} (default: radiance)")
    add("--size", type=whole, metavar="N", help="lightmap: texels along a side (default: 1024)")
    words = "lightmap: samples of lights and textures per texel (default: 8)"
    add("--texel-samples", type=whole, metavar="N", help=words)
    words = "vertices: largest relative error of light at the middle of an edge before the edge is cut (default: 0.05)"
    add("--cut", type=number, metavar="X", help=words)
    add("--most", type=whole, metavar="N", help="vertices: largest number of vertices (default: 200000)")
    add("--stats", metavar="FILE.json", help="write sizes, records, times and settings to this file")
