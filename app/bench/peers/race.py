"""`irrsplat bench --peers`: time against error, ours beside Radiance and Mitsuba, as a table and a plot."""

from __future__ import annotations

import importlib.util
import os
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from irrsplat.app.bench import machine
from irrsplat.app.bench.cases import TURN, turned
from irrsplat.app.bench.peers import contestants, radiance
from irrsplat.app.bench.peers.contestants import CPUS, Entry
from irrsplat.app.common.terminal import columns, doing, say
from irrsplat.core import files
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.image import frame
from irrsplat.reference.truth import in_words
from irrsplat.scene.model import Scene
from irrsplat.settings import All

DEFAULT_SCENES = ("cornell",)
SIZE = [400, 400]
TARGET = 0.05  # relative RMSE that all are timed to
INSTALL = "pip install 'irrsplat[peers]'"
LEGEND = f"""\
rmse: of indirect irradiance, relative to its mean, at 2000 smooth pixels; seconds: for all pixels of the view
further: the same view turned by {TURN:g}°, with the records or the ambient file kept; Mitsuba keeps nothing, and begins anew
Mitsuba: its own integrator, `direct` for one bounce and `path` for more, on cosine-distributed rays from each pixel
lamps joined: its rays in our own integrator (that of `verify`), which joins every vertex to what each lamp shines on as well\
"""
_COLOURS = ((27, 94, 160), (226, 150, 90), (190, 70, 10), (60, 140, 60), (130, 80, 160))


def check(args: Namespace) -> None:
    """Raises InputError or IrrsplatError for what can be told to be wrong before anything is rendered."""
    if radiance.installed() is None and importlib.util.find_spec("mitsuba") is None:
        raise IrrsplatError(f"--peers: neither Radiance nor Mitsuba is installed; run: {INSTALL}")
    if args.preset is not None or args.compare is not None:
        raise InputError("--peers times the default preset by error, not by case; leave --preset and --compare out")
    if args.output is not None:
        if os.path.splitext(args.output)[1].lower() != ".png":
            raise InputError("the plot of --peers is a .png", args.output)
        if len(args.scenes) > 1 or len(args.size or []) > 1:
            raise InputError("-o plots one scene of one size; name one, or leave -o out")
        frame.check_writable(args.output)


def run(scenes: Sequence[Scene], args: Namespace, bounces: int | All) -> dict[str, Any]:
    """Measure every scene and size, print tables, plot where asked for; what the JSON says of them."""
    import irrsplat

    written: dict[str, Any] = {"machine": {}, "peers": []}
    for scene in scenes:
        for notice in scene.notices:
            say(f"notice: {notice}")
        for width, height in args.size or [SIZE]:
            with irrsplat.Renderer(scene, size=(width, height), bounces=bounces, shadow_size=2048) as renderer:
                written["machine"] = machine.about(renderer.about)
                doing(f"{scene.name}: the truth")
                camera = scene.camera()
                views = [contestants.view(renderer, one) for one in (camera, turned(camera, TURN))]
            entries = list(contestants.all_of(scene, (width, height), bounces, views, doing))
            doing("")
            title = f"{scene.name}, {scene.triangles} triangles, {width} x {height}, {in_words(bounces)}, {CPUS} CPUs"
            print("\n".join(report(title, entries)), flush=True)
            same = {"scene": scene.name, "size": [width, height], "bounces": bounces}
            for entry in entries:
                written["peers"] += [same | asdict(point) for point in entry.points] or [same | {"failed": entry.about}]
            if args.output is not None:
                files.write_picture(args.output, plot(title, entries))
    return written


def report(title: str, entries: Sequence[Entry]) -> Iterator[str]:
    """The table of a scene, and what follows from it."""
    yield from ("", title, LEGEND)
    rows = [("system", "quality", "seconds", "rmse", "further s", "rmse")]
    for entry in entries:
        for p in entry.points:
            further = ("-", "-") if p.further is None or p.further_rmse is None else (f"{p.further:.3f}", f"{p.further_rmse:.1%}")
            rows.append((p.system, p.quality, f"{p.seconds:.3f}", f"{p.rmse:.1%}", *further))
    yield from columns(rows, left=2)
    for entry in entries:
        yield f"{entry.points[0].system}: {entry.about}" if entry.points else entry.about
    yield from verdict(entries)


def verdict(entries: Sequence[Entry]) -> Iterator[str]:
    """How long each takes to the target, and for a further view as good, and how many times as long as ours that is."""
    for words, further in ((f"to {TARGET:.0%} relative RMSE", False), ("a further view as good", True)):
        told = []
        base: float | None = None
        for entry in entries:
            if not entry.points:
                continue
            name, found = entry.points[0].system, reached(entry, further)
            if found is None:
                told.append(f"{name} does not get there ({min(p.rmse for p in entry.points):.1%} at best)")
                continue
            seconds, sure = found
            if base is None and entry is entries[0]:
                base = seconds
                told.append(f"{name} {seconds:.3f} s")
            else:
                times = "" if base is None else f", {seconds / base:,.1f} times as long"
                told.append(f"{name} {'' if sure else 'by 1/√samples some '}{seconds:,.2f} s{times}")
        yield f"{words}: {'; '.join(told)}"


def reached(entry: Entry, further: bool = False) -> tuple[float, bool] | None:
    """Seconds to TARGET, or of a further view with what first got there; False: not measured, but by 1/√samples. None: never."""
    there = [point for point in entry.points if point.rmse <= TARGET]
    if there:
        seconds = there[0].further if further else there[0].seconds
        return None if seconds is None else (seconds, True)
    if not entry.anew or not entry.points:
        return None
    last = entry.points[-1]
    return last.seconds * (last.rmse / TARGET) ** 2, False


def plot(title: str, entries: Sequence[Entry]) -> np.ndarray:
    """(H, W, 3) display values 0..1: rmse in percent over seconds, both logarithmic, a line a system."""
    from irrsplat.app.common.plot import Line, loglog

    lines = []
    for entry, colour in zip((e for e in entries if e.points), _COLOURS, strict=False):
        x, y = (np.array([getattr(p, name) for p in entry.points]) for name in ("seconds", "rmse"))
        lines.append(Line(entry.points[0].system, x, 100.0 * y, colour))
    return loglog(lines, title, "seconds for all pixels of a view", "relative RMSE of irradiance, %")
