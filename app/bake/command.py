"""`irrsplat bake`: bake light into files for other programs and print a short summary."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
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
    from irrsplat.app.bake.check import Checked
    from irrsplat.app.bake.lightmap import Lightmap
    from irrsplat.app.bake.probes import Probes
    from irrsplat.app.bake.vertices import VertexLight
    from irrsplat.scene.model import Scene

_OWN = {  # flags of a single kind of bake, and their parameter names
    "lightmap": {"form": "form", "size": "size", "texel_samples": "texel_samples"},
    "vertices": {"cut": "cut", "most": "most"},
    "probes": {"grid": "grid"},
}
_ENDINGS = {"lightmap": (".glb",), "vertices": (".glb",), "probes": (".json", ".npz")}


def check(args: argparse.Namespace) -> None:
    """Raise InputError for errors on the command line that show before the scene is loaded."""
    settings.preset(args.preset, **args.values)
    for kind, own in _OWN.items():
        for name in own:
            if kind != args.to and getattr(args, name) is not None:
                raise InputError(f"--{name.replace('_', '-')} is for --to {kind}; leave it out")
    if args.to == "probes" and (args.light != "all" or args.check is not None):
        raise InputError("probes hold all light and are not checked; leave --light and --check out")
    expected = _ENDINGS[args.to]
    if Path(args.output).suffix.lower() not in expected:
        raise InputError(f"unknown ending; --to {args.to} writes {' or '.join(expected)}", args.output or "''")
    if args.check is not None:
        from irrsplat.reference import worker

        worker.require()
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
    form, values = own.pop("form", "radiance"), args.values
    if args.to == "probes":
        values = {name: value for name, value in values.items() if settings.SETTINGS[name].stage in ("shadow", "gather")}
    else:
        own["light"] = args.light
    with progress("baking") as line:
        make, on_bake = getattr(bake, f"bake_{args.to}"), None if line is None else partial(_show, line)
        made: Any = make(scene, preset=args.preset, on_bake=on_bake, **own, **values)
        seconds = time.perf_counter() - start
        checked = None if args.check is None else _checked(made, args, line)
    outputs = Outputs()
    save = partial(made.save, args.output, form) if args.to == "lightmap" else partial(made.save, args.output)
    outputs.write(args.output, save)
    for path in _outputs(args)[1:] if not outputs.failures else ():
        wrote(path)
    summary = _SUMMARIES[args.to](made)
    if args.stats is not None:
        stats = {"scene": scene.name, "to": args.to, "light": args.light, "seconds": seconds, **summary,
                 "check": None if checked is None else asdict(checked), "preset": args.preset,
                 "settings": vars(settings.preset(args.preset, **args.values))}  # fmt: skip
        outputs.write(args.stats, partial(files.write_text, args.stats, files.json_text(stats, 1) + "\n"))
    if not summary.get("converged", True):
        say("notice: stopped before every point was covered; raise --a")
    for words in _lines(summary, seconds, checked):
        out(words)
    outputs.raise_failures()
    return 0


def _outputs(args: argparse.Namespace) -> list[str]:
    """Return all files of the bake, the file of -o first."""
    more = (".png", ".exr") if args.to == "lightmap" else ()
    return [args.output, *(str(Path(args.output).with_suffix(ending)) for ending in more)]


def _show(line: Callable[..., None], share: float, words: str) -> None:
    line(share, words)


# ---- the three kinds -----------------------------------------------------------------------------------------------------


def _lightmap_summary(made: Lightmap) -> dict[str, Any]:
    share = float((made.owner >= 0).mean())
    return {"texels": made.charts.size, "used": share, "texel_metres": made.texel, "charts": int(made.charts.chart.max()) + 1,
            "records": made.records, "converged": made.converged}  # fmt: skip


def _vertices_summary(made: VertexLight) -> dict[str, Any]:
    return {"vertices": len(made.cut.root), "triangles": len(made.cut.faces), "complete": made.complete,
            "records": made.records, "converged": made.converged}  # fmt: skip


def _probes_summary(made: Probes) -> dict[str, Any]:
    return {"probes": list(made.counts), "valid": int(made.valid.sum())}


_SUMMARIES: dict[str, Callable[[Any], dict[str, Any]]] = {
    "lightmap": _lightmap_summary,
    "vertices": _vertices_summary,
    "probes": _probes_summary,
}


def _checked(made: Lightmap | VertexLight, args: argparse.Namespace, line: Any) -> Checked:
    from irrsplat.app.bake.check import check as against_truth

    bounces = settings.preset(args.preset, **args.values).bounces
    notify = None if line is None else lambda share: line(share, "tracing the truth", "truth")
    return against_truth(made, args.check, bounces, notify)


def _lines(summary: dict[str, Any], seconds: float, checked: Checked | None) -> Iterator[str]:
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
    if "probes" in summary:
        yield f"probes      {' x '.join(map(str, summary['probes']))}, {summary['valid']:,} of them not within solids"
    if "records" in summary:
        yield f"records     {summary['records']:,}"
    yield f"time        {seconds:.1f} s"
    if checked is not None:
        yield checked.words
