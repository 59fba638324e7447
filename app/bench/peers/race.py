"""`irrsplat bench --peers`: time against error, ours and the renderers of table.py, as tables and a plot."""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from irrsplat.app.bench.cases import TURN, machine, turned
from irrsplat.app.bench.peers.judging import CPUS, Series, judged_view
from irrsplat.app.bench.peers.table import PEERS, Notify, others
from irrsplat.app.common import plot as plots
from irrsplat.app.common.plot import Line, loglog
from irrsplat.app.common.terminal import columns, doing, out, say
from irrsplat.core import files
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.image import frame
from irrsplat.reference.timed_levels import JudgedView
from irrsplat.reference.truth import in_words
from irrsplat.scene.model import Scene
from irrsplat.settings import All

DEFAULT_SCENES = ("cornell",)
SIZE = [400, 400]
TARGETS = 0.05, 0.025  # relative RMSE of the comparison; the first one also for further views
INSTALL = "pip install 'irrsplat[peers]'"
LEGEND = (
    "rmse: of indirect irradiance, relative to its mean, at 2000 smooth pixels",
    "seconds: processor time by all threads, for all pixels of the view",
    f"further: the view turned by {TURN:g}°, with the kept records or ambient file; Mitsuba keeps no light",
    *(peer.note for peer in PEERS if peer.note),
)


def check(args: Namespace) -> None:
    """Raise InputError or IrrsplatError for errors that show before any rendering."""
    if not any(peer.package and find_spec(peer.package) for peer in PEERS):
        raise IrrsplatError(f"--peers: of {others()} none is installed; run: {INSTALL}")
    if args.preset is not None or args.compare is not None:
        raise InputError("--peers chooses its own presets, by error; leave --preset and --compare out")
    if args.output is not None:
        if os.path.splitext(args.output)[1].lower() != ".png":
            raise InputError("the plot of --peers is a .png", args.output)
        if len(args.scenes) > 1 or len(args.size or []) > 1:
            raise InputError("-o plots one scene of one size; name one, or leave -o out")
        plots.require()
        frame.check_writable(args.output)


def run(scenes: Sequence[Scene], args: Namespace, bounces: int | All) -> dict[str, object]:
    """Measure every scene and size, print tables, plot on request; return the part of the JSON."""
    import irrsplat

    about: dict[str, object] = {}
    rows: list[dict[str, object]] = []
    for scene in scenes:
        for notice in scene.notices:
            say(f"notice: {notice}")
        for width, height in args.size or [SIZE]:
            with irrsplat.Renderer(scene, size=(width, height), bounces=bounces, shadow_size=2048) as renderer:
                about = machine(renderer.about)
                doing(f"{scene.name}: the truth")
                camera = scene.camera()
                views = [judged_view(renderer, one) for one in (camera, turned(camera, TURN))]
            found = list(measured(scene, (width, height), bounces, views, doing))
            doing("")
            title = f"{scene.name}, {scene.triangles} triangles, {width} x {height}, {in_words(bounces)}, {CPUS} CPUs"
            out("\n".join(report(title, found)))
            same: dict[str, object] = {"scene": scene.name, "size": [width, height], "bounces": bounces}
            for series in found:
                rows += [same | asdict(one) for one in series.measurements] or [same | {"failed": series.about}]
            if args.output is not None:
                files.write_picture(args.output, plot(title, found))
    return {"machine": about, "peers": rows}


def measured(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Yield the series of every peer; an absent peer has an empty series with the reason."""
    for peer in PEERS:
        try:
            yield from import_module(f"{__package__}.{peer.module}").measure(scene, size, bounces, views, notify)
        except IrrsplatError as error:
            if not peer.package:
                raise
            yield Series((), f"{peer.name}: {error}")


def report(title: str, found: Sequence[Series]) -> Iterator[str]:
    """Yield the table of a scene, and its summary."""
    yield from ("", title, *LEGEND)
    rows = [("system", "quality", "seconds", "rmse", "further s", "rmse")]
    for series in found:
        for one in series.measurements:
            numbers = f"{one.seconds:.3f}", f"{one.rmse:.1%}", f"{one.further:.3f}", f"{one.further_rmse:.1%}"
            rows.append((one.system, one.quality, *numbers))
    yield from columns(rows, left=2)
    for series in found:
        yield f"{series.measurements[0].system}: {series.about}" if series.measurements else series.about
    yield from verdict(found)


def verdict(found: Sequence[Series]) -> Iterator[str]:
    """Yield each peer's time to the targets and for a further view, with its ratio to the first peer's."""
    lines = [(f"to {target:.1%} relative RMSE", target, False) for target in TARGETS]
    for words, target, further in (*lines, (f"a further view to {TARGETS[0]:.1%}", TARGETS[0], True)):
        parts = []
        base: float | None = None
        for series in found:
            if not series.measurements:
                continue
            name, time_to_target = series.measurements[0].system, reached(series, target, further)
            if time_to_target is None:
                parts.append(f"{name} does not get there ({min(one.rmse for one in series.measurements):.1%} at best)")
                continue
            seconds, was_measured = time_to_target
            if base is None and series is found[0]:
                base = seconds
                parts.append(f"{name} {seconds:.3f} s")
            else:
                times = "" if base is None else f", {seconds / base:,.1f} times as long"
                parts.append(f"{name} {'' if was_measured else 'by 1/√samples some '}{seconds:,.2f} s{times}")
        yield f"{words}: {'; '.join(parts)}"


def reached(series: Series, target: float, further: bool = False) -> tuple[float, bool] | None:
    """Return the seconds to `target` and True if they are measured, False if extrapolated by 1/√samples.

    further: of a further view with the first measurement that reaches the target. None: the target is out of reach.
    """
    there = [one for one in series.measurements if one.rmse <= target]
    if there:
        return there[0].further if further else there[0].seconds, True
    if not series.keeps_nothing or not series.measurements:
        return None
    last = series.measurements[-1]
    return last.seconds * (last.rmse / target) ** 2, False


def plot(title: str, found: Sequence[Series]) -> np.ndarray:
    """Return display values (H, W, 3) in 0..1: rmse in percent over seconds, both logarithmic, one line per system."""
    lines = []
    for series in found:
        if series.measurements:
            x, y = (np.array([getattr(one, name) for one in series.measurements]) for name in ("seconds", "rmse"))
            lines.append(Line(series.measurements[0].system, x, 100.0 * y, series.colour))
    return loglog(lines, title, "seconds of processor time for all pixels of a view", "relative RMSE of irradiance, %")
