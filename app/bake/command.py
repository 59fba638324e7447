"""`irrsplat bake`: bake light into files for other programs and print a short summary."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irrsplat import settings
from irrsplat.app import bake
from irrsplat.app.common.outputs import Outputs, twins
from irrsplat.app.common.terminal import out, progress, say, wrote
from irrsplat.core import files
from irrsplat.core.errors import InputError

if TYPE_CHECKING:
    from irrsplat.app.bake.lightmap import Lightmap
    from irrsplat.app.bake.vertices import VertexLight
    from irrsplat.scene.model import Scene

_OWN = {  # flags of a single kind of bake, and their parameter names
    "lightmap": {"form": "form", "size": "size", "texel_samples": "texel_samples"},
    "vertices": {"cut": "cut", "most": "most"},
}


def check(args: argparse.Namespace) -> None:
    """Raise InputError for errors on the command line that show before the scene is loaded."""
    settings.preset(args.preset, **args.values)
    for kind, own in _OWN.items():
        for name in own:
            if kind != args.to and getattr(args, name) is not None:
                raise InputError(f"--{name.replace('_', '-')} is for --to {kind}; leave it out")
    if Path(args.output).suffix.lower() != ".glb":
        raise InputError("unknown ending; a bake is a .glb", args.output or "''")
    outputs = _outputs(args)
    for path in (*outputs, *([] if args.stats is None else [args.stats])):
        files.check_file(path)
    for twin in twins(outputs, [("--stats", args.stats)]):
        raise InputError(twin)


def run(scene: Scene, args: argparse.Namespace) -> int:
    """Bake, write the files and print a summary; return the exit status."""
    for notice in scene.notices:
        say(f"notice: {notice}")
    start = time.perf_counter()
    own = {handed: getattr(args, name) for name, handed in _OWN[args.to].items() if getattr(args, name) is not None}
    form = own.pop("form", "radiance")
    with progress("baking") as line:
        make, on_bake = getattr(bake, f"bake_{args.to}"), None if line is None else partial(_show, line)
        made: Any = make(scene, light=args.light, preset=args.preset, on_bake=on_bake, **own, **args.values)
        seconds = time.perf_counter() - start
    outputs = Outputs()
    save = partial(made.save, args.output, form) if args.to == "lightmap" else partial(made.save, args.output)
    outputs.write(args.output, save)
    for path in _outputs(args)[1:] if not outputs.failures else ():
        wrote(path)
    summary = _SUMMARIES[args.to](made)
    if args.stats is not None:
        stats = {"scene": scene.name, "to": args.to, "light": args.light, "seconds": seconds, **summary,
                 "preset": args.preset, "settings": vars(settings.preset(args.preset, **args.values))}  # fmt: skip
        outputs.write(args.stats, partial(files.write_text, args.stats, files.json_text(stats, 1) + "\n"))
    if not summary["converged"]:
        say("notice: stopped before every point was covered; raise --a")
    for words in _lines(summary, seconds):
        out(words)
    outputs.raise_failures()
    return 0


def _outputs(args: argparse.Namespace) -> list[str]:
    """Return all files of the bake, the file of -o first."""
    more = (".png", ".exr") if args.to == "lightmap" else ()
    return [args.output, *(str(Path(args.output).with_suffix(ending)) for ending in more)]


def _show(line: Callable[..., None], share: float, words: str) -> None:
    line(share, words)


# ---- the two kinds -------------------------------------------------------------------------------------------------------


def _lightmap_summary(made: Lightmap) -> dict[str, Any]:
    share = float((made.owner >= 0).mean())
    return {"texels": made.charts.size, "used": share, "texel_metres": made.texel, "charts": int(made.charts.chart.max()) + 1,
            "records": made.records, "converged": made.converged}  # fmt: skip


def _vertices_summary(made: VertexLight) -> dict[str, Any]:
    return {"vertices": len(made.cut.root), "triangles": len(made.cut.faces), "complete": made.complete,
            "records": made.records, "converged": made.converged}  # fmt: skip


_SUMMARIES: dict[str, Callable[[Any], dict[str, Any]]] = {
    "lightmap": _lightmap_summary,
    "vertices": _vertices_summary,
}


def _lines(summary: dict[str, Any], seconds: float) -> Iterator[str]:
    """Yield the lines of the summary."""
    if "texels" in summary:
        yield (
            f"lightmap    {summary['texels']} x {summary['texels']} texels, {summary['used']:.0%} used by "
            f"{summary['charts']:,} charts, "
            f"{1000.0 * summary['texel_metres']:.3g} mm a texel"
        )
    if "vertices" in summary:
        yield f"vertices    {summary['vertices']:,} of {summary['triangles']:,} triangles"
        if not summary["complete"]:
            yield "not all     edges are cut that should be; raise --most or --cut"
    yield f"records     {summary['records']:,}"
    yield f"time        {seconds:.1f} s"
