"""Flags of `irrsplat bake`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

DESCRIPTION = "Bake light into a lightmap, vertex colours or probes, for programs that only show it."
EPILOG = (
    "A lightmap needs the extra: pip install 'irrsplat[bake]'; --check needs pip install 'irrsplat[reference]'. Beside the .glb\n"
    "lie a .png of 16 bits and an .exr with the same map. docs/baking.md has the conventions, and what other programs need."
)
KINDS = ("lightmap", "vertices", "probes")


def add(parser: argparse.ArgumentParser, number: Callable[[str], float], whole: Callable[[str], int]) -> None:
    """Add the bake flags. number, whole: parsers of a finite number and of a positive whole number."""
    add = parser.add_argument
    add("-o", "--output", metavar="OUT", required=True, help="a .glb; of probes a .json or .npz")
    add("--to", choices=KINDS, default="lightmap", help="what the light is baked into (default: lightmap)")
    words = "all, or indirect: without direct light (default: all)"
    add("--light", choices=("all", "indirect"), default="all", help=words)
    words = (
        "of a lightmap: black materials that emit the map, for any program; or the scene's own materials and a map of W/m² apart"
    )
    add("--form", choices=("radiance", "irradiance"), help=f"{words} (default: radiance)")
    add("--size", type=whole, metavar="N", help="texels along a lightmap's side (default: 1024)")
    words = "points per texel at which lights and textures are sampled (default: 8)"
    add("--texel-samples", type=whole, metavar="N", help=words)
    words = "of vertex colours: how far an edge's middle may be off, as a share of the light, before it is cut (default: 0.05)"
    add("--cut", type=number, metavar="X", help=words)
    add("--most", type=whole, metavar="N", help="of vertex colours: vertices at most (default: 200000)")
    add("--grid", type=number, metavar="M", help="of probes: metres between them at most (default: an eighth of the scene)")
    words = "compare N texels or vertices with a path tracer, and print the errors"
    add("--check", type=whole, metavar="N", help=words)
    add("--stats", metavar="FILE.json", help="write sizes, records, times, the errors of --check and settings to this file")
