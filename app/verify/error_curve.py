"""`irrsplat verify --curve`: error against the number of records, as a table with log-log slopes, and as a plot."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, cast

import numpy as np

from irrsplat.app.common.terminal import columns, out, progress
from irrsplat.app.verify.measure import Measured, measurer, percent, silent
from irrsplat.core import files
from irrsplat.settings import SETTINGS, SettingValues, preset

if TYPE_CHECKING:
    from irrsplat.scene.model import Camera, Scene

# Curve of a preset: A replaces its a, and related settings change in proportion. A record of half the radius has half the error
# tolerance and twice the gather resolution, so that the gather never limits.
A = (1.1, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25)
WITH_A = ("radius_min", "radius_max", "adapt", "spread")
AGAINST_A = ("gather_size",)
# The published algorithm has only a and the number of random records before its traversal, a lower bound.
PAPER: tuple[SettingValues, ...] = (
    {"a": 0.6, "warmup": 250},
    {"a": 0.4, "warmup": 500},
    {"a": 0.3, "warmup": 1000},
    {"a": 0.2, "warmup": 1000},
    {"a": 0.15, "warmup": 1000},
)


def points(name: str, given: SettingValues) -> list[SettingValues]:
    """Return the settings on top of preset `name` for each point of its curve, fewest records first; `given` ones are fixed."""
    if name == "paper":
        return [values | given for values in PAPER]
    return [scaled(name, given, a / preset(name, **given).a) for a in A]


def scaled(name: str, given: SettingValues, factor: float) -> SettingValues:
    """Return the settings on top of preset `name` that scale a record's radius by `factor`; `given` settings are fixed."""
    base = preset(name, **given)
    found: dict[str, float] = {"a": base.a * factor}
    found |= {key: getattr(base, key) * factor for key in WITH_A}
    found |= {key: 4 * round(getattr(base, key) / factor / 4) for key in AGAINST_A}
    for key, value in found.items():
        low, high = SETTINGS[key].low, SETTINGS[key].high
        assert low is not None and high is not None
        found[key] = min(max(value, low), high)
    return cast(SettingValues, found | given)


def run(scene: Scene, camera: Camera, args: Namespace, heading: str) -> None:
    """Measure the preset's curve and that of `paper`; print both, and plot them for `-o`."""
    curves = measured(scene, camera, args)
    out(heading)
    for name, found in curves.items():
        out("\n".join(["", *columns(rows(name, found), left=1), f"  {steepness(found)}"]))
    if args.output is not None:
        files.write_picture(args.output, plot(curves, heading))


def measured(scene: Scene, camera: Camera, args: Namespace) -> dict[str, list[Measured]]:
    """Return the points of each preset's curve by its name."""
    names = list(dict.fromkeys((args.preset, "paper")))
    plan = [(name, values) for name in names for values in points(name, args.values)]
    curves: dict[str, list[Measured]] = {name: [] for name in names}
    with progress() as line:
        notify = line or silent
        measure = measurer(scene, camera, args, notify)
        for k, (name, values) in enumerate(plan):

            def show(share: float, words: str, k: int = k) -> None:
                notify((k + share) / len(plan), f"{k + 1} of {len(plan)}: {words}")

            curves[name].append(measure(name, values, show))
    return curves


def rows(name: str, found: Sequence[Measured]) -> list[tuple[str, ...]]:
    """Return the cells of one curve's table: a header and a row per point."""
    table: list[tuple[str, ...]] = [
        (f"preset {name}", "a", "gather", "records", "RMSE", "slope", "bias", "off by > 30 %", "seconds")
    ]
    for before, point in zip((None, *found), found, strict=False):
        settings = preset(name, **point.values)
        step = None if before is None else slope((before, point))
        errors = percent(point.rmse), "" if step is None else f"{step:.2f}", percent(point.bias, "+"), percent(point.outliers)
        sizes = f"{settings.a:.3g}", f"{settings.gather_size}", f"{point.records:,}"
        table.append(("", *sizes, *errors, f"{point.seconds:.1f}"))
    return table


def steepness(found: Sequence[Measured]) -> str:
    """Return a curve's slope as a sentence."""
    whole = slope(found)
    if whole is None:
        return "no slope: there is no light, or all points have as many records"
    return f"the error goes with the records to the power of {whole:.2f} (least squares of logarithms)"


def slope(found: Sequence[Measured]) -> float | None:
    """Return d log(rmse)/d log(records) by least squares; None for too few points."""
    at = logarithms(found)
    if len(at) < 2 or not np.ptp(at[:, 0]):
        return None
    return float(np.polyfit(at[:, 0], at[:, 1], 1)[0])


def logarithms(found: Sequence[Measured]) -> np.ndarray:
    """Return natural logarithms (N, 2) of records and rmse, of the points with both."""
    return np.array([(math.log(m.records), math.log(m.rmse)) for m in found if m.records and m.rmse]).reshape(-1, 2)


def at(found: Sequence[Measured], records: int) -> float | None:
    """Return the rmse of a curve at `records`, by log-log interpolation; None outside its ends."""
    for (x, y), (u, v) in pairwise(sorted(map(tuple, logarithms(found)))):
        if x <= math.log(max(records, 1)) <= u:
            share = (math.log(records) - x) / (u - x) if u > x else 0.0
            return math.exp(y + share * (v - y))
    return None


def plot(curves: dict[str, list[Measured]], heading: str) -> np.ndarray:
    """Return display values (H, W, 3) in 0..1: rmse in percent over records, both logarithmic, one line per preset."""
    from irrsplat.app.common.plot import Line, loglog, palette

    lines = []
    for (name, found), colour in zip(curves.items(), palette(len(curves)), strict=True):
        at, whole = np.exp(logarithms(found)), slope(found)
        words = f"preset {name}" + ("" if whole is None else f", slope {whole:.2f}")
        lines.append(Line(words, at[:, 0], 100.0 * at[:, 1], colour))
    return loglog(lines, heading, "records", "relative RMSE of irradiance, %")
