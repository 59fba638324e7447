"""`irrsplat bake`: baked light for other programs, and a short summary."""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path
from typing import Any

from irrsplat.app.commands.shared import flags
from irrsplat.app.common.outputs import Outputs, check_distinct
from irrsplat.app.common.terminal import out, progress, say, wrote
from irrsplat.core.errors import InputError
from irrsplat.settings import preset

_OWN = {"lightmap": ("form", "size", "texel_samples"), "vertices": ("cut", "most")}  # flags of a single kind of bake


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "bake",
        help="bake light into a lightmap or vertex colours",
        description="Bake light into a lightmap or vertex colours, for programs without indirect light.",
        epilog="A lightmap requires the extra: pip install 'irrsplat[bake]'. An .exr next to the .glb has the same map.\n"
        "docs/baking.md describes the conventions for other programs.",
    )
    flags.add_scene(parser)
    add = parser.add_argument
    add("-o", "--output", metavar="OUT", required=True, help="a .glb")
    add("--to", choices=tuple(_OWN), default="lightmap", help="target of the bake (default: lightmap)")
    words = "all light, or indirect light only (default: all)"
    add("--light", choices=("all", "indirect"), default="all", help=words)
    words = "lightmap: black materials that emit the map, for any program; or the materials of the scene and a map in W/m²"
    add("--form", choices=("radiance", "irradiance"), help=f"{words} (default: radiance)")
    add("--size", type=flags.count, metavar="N", help="lightmap: texels along a side (default: 1024)")
    words = "lightmap: samples of lights and textures per texel (default: 8)"
    add("--texel-samples", type=flags.count, metavar="N", help=words)
    words = "vertices: largest relative error of light at the middle of an edge before the edge is cut (default: 0.05)"
    add("--cut", type=flags.number, metavar="X", help=words)
    add("--most", type=flags.count, metavar="N", help="vertices: largest number of vertices (default: 200000)")
    add("--stats", metavar="FILE.json", help="write sizes, records, times and settings to this file")
    flags.add_preset(parser, "default")
    flags.add_settings(parser, stages=("shadow", "gather", "splat", "examine"), besides=("placement", "warmup"))
    parser.set_defaults(run=run)


def _check(args: argparse.Namespace) -> None:
    """Raise InputError for errors on the command line that show before the scene is loaded."""
    from irrsplat.core import files

    preset(args.preset, **args.values)
    for kind, own in _OWN.items():
        for name in own:
            if kind != args.to and getattr(args, name) is not None:
                raise InputError(f"--{name.replace('_', '-')} is for --to {kind}; leave it out")
    if Path(args.output).suffix.lower() != ".glb":
        raise InputError("unknown ending; a bake is a .glb", args.output or "''")
    outputs = [args.output, *([str(Path(args.output).with_suffix(".exr"))] if args.to == "lightmap" else [])]
    for path in (*outputs, *([] if args.stats is None else [args.stats])):
        files.check_file(path)
    check_distinct(outputs, [("--stats", args.stats)])


def run(args: argparse.Namespace) -> int:
    """Bake, write the files and print a summary; return the exit status."""
    _check(args)

    import irrsplat
    from irrsplat.app import bake

    scene = irrsplat.load(args.scene, **vars(args.loading))
    for notice in scene.notices:
        say(f"notice: {notice}")
    start = time.perf_counter()
    own = {name: value for name in _OWN[args.to] if (value := getattr(args, name)) is not None}
    form = (own.pop("form", "radiance"),) if args.to == "lightmap" else ()
    with progress("baking") as line:
        make = getattr(bake, f"bake_{args.to}")
        made: Any = make(scene, light=args.light, preset=args.preset, on_bake=line, **own, **args.values)
        seconds = time.perf_counter() - start
    outputs = Outputs()
    if outputs.write(args.output, partial(made.save, args.output, *form)) and form:
        wrote(Path(args.output).with_suffix(".exr"))
    stats = {"scene": scene.name, "to": args.to, "light": args.light, "seconds": seconds, **made.summary}
    stats |= {"preset": args.preset, "settings": vars(preset(args.preset, **args.values))}
    outputs.write_json(args.stats, stats, 1)
    if not made.converged:
        say("notice: stopped before every point was covered; raise --a")
    out(made.words)
    out(f"records     {made.records:,}")
    out(f"time        {seconds:.1f} s")
    outputs.raise_failures()
    return 0
