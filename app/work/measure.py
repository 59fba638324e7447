"""Work of `irrsplat measure`: light on a plane, along a line or at points, as a table, files and a summary."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from irrsplat import settings
from irrsplat.app.common.outputs import Outputs, check_distinct
from irrsplat.app.common.terminal import columns, out, progress, say
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import vector
from irrsplat.image.statistics import bounces_notice
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.plane import Grid, Plane, horizontal, line_points
from irrsplat.meter.readings import Readings, Status, Summary, Unit
from irrsplat.scene.model import Scene

_STDOUT = "-"
_ENDINGS = (".csv", ".npz")


def check(args: argparse.Namespace) -> None:
    """Raise InputError for errors on the command line that show before the scene is loaded."""
    settings.preset(args.preset, **args.values)
    given = [flag for flag in ("plane", "height", "line", "point") if getattr(args, flag) is not None]
    if not given:
        raise InputError("there is nothing to measure; give --plane, --height, --line or --point")
    if len(given) > 1:
        raise InputError(f"--{given[0]} and --{given[1]} name two different places; give one of them")
    for flag, places in (("grid", ("plane", "height", "line")), ("margin", ("plane", "height")), ("facing", ("line",))):
        if getattr(args, flag) is not None and given[0] not in places:
            words = " or ".join(f"--{place}" for place in places)
            raise InputError(f"--{flag} does not go with --{given[0]}; leave it out, or give {words}")
    if args.facing is not None and not any(args.facing):
        raise InputError("--facing is 0 0 0; give the direction that the points face")
    if args.plane is not None:
        _grid(_plane(args.plane), args)
    if args.line is not None:
        _along(args)
    if args.output is not None and args.output != _STDOUT:
        if Path(args.output).suffix.lower() not in _ENDINGS:
            raise InputError(f"unknown ending; expected {' or '.join(_ENDINGS)}, or - for CSV on stdout", args.output or "''")
        files.check_file(args.output)
    if args.stats is not None:
        files.check_file(args.stats)
    check_distinct([], [("-o", None if args.output == _STDOUT else args.output), ("--stats", args.stats)])


def run(scene: Scene, args: argparse.Namespace) -> int:
    """Measure and write the results; return the exit status. Raise InputError for a scene without extent for a plane."""
    unit: Unit = args.unit
    grid = along = None
    if args.point is not None:
        places = np.array(args.point, float)
        points, normals = places[:, :3], places[:, 3:]
    elif args.line is not None:
        points, along = _along(args)
        normals = np.tile(np.asarray(args.facing or scene.up, float), (len(points), 1))
    else:
        grid = _grid(horizontal(scene, args.height) if args.plane is None else _plane(args.plane), args)
        points, normals = grid.points, grid.normals
    with LightMeter(scene, args.preset, **args.values) as meter:
        for notice in (*scene.notices, *meter.lit.notices):
            say(f"notice: {notice}")
        with progress() as line:
            on_points = None if line is None else lambda share: line(share, f"{len(points)} points")
            readings = meter.measure(points, normals, on_points)
        how = meter.gatherer.bounces(meter.settings)
    if (missing := bounces_notice(how)) is not None:
        say(f"notice: {missing}")
    low, high = scene.bounds
    outside = ((readings.position < low) | (readings.position > high)).any(axis=1) & ~readings.total.any(axis=1)
    if outside.any():
        say(f"notice: {outside.sum()} of {len(points)} points get no light, and lie outside of the scene: {_box(low, high)}")
    summary = readings.summary(unit)
    shape = None if grid is None else [grid.columns, grid.rows]
    stats = {"scene": scene.name, "grid": shape, **summary, **how, "preset": args.preset, "settings": vars(meter.settings)}
    outputs, write = Outputs(), partial(_write, args.output, readings, unit, grid, along, files.json_text(stats, None))
    if args.output in (None, _STDOUT):
        write()
    else:
        outputs.write(args.output, write)
    outputs.write_json(args.stats, stats, 1)
    for text in _summary_lines(summary, grid, along):
        (say if args.output == _STDOUT else out)(text)
    outputs.raise_failures()
    return 0


def _box(low: np.ndarray, high: np.ndarray) -> str:
    return ", ".join(f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True)) + " m"


def _plane(values: list[float]) -> Plane:
    return Plane(vector(values[:3]), vector(values[3:6]), vector(values[6:]))


def _grid(plane: Plane, args: argparse.Namespace) -> Grid:
    margin = args.margin or 0.0
    return plane.grid(plane.usual_spacing(margin) if args.grid is None else args.grid, margin)


def _along(args: argparse.Namespace) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of --line, and their distances along it in metres."""
    return line_points(vector(args.line[:3]), vector(args.line[3:]), args.grid)


# ---- output ------------------------------------------------------------------------------------------------------------


def _write(output: str | None, readings: Readings, unit: Unit, grid: Grid | None, along: np.ndarray | None, stats: str) -> None:
    """Write the readings to a file, or print them. along: (N,) metres along a line; None for other points."""
    if output is None:
        for line in columns(list(_rows(readings, unit, along, "{:.4g}")), 0):
            out(line)
    elif output == _STDOUT or output.lower().endswith(".csv"):
        text = "".join(",".join(row) + "\n" for row in _rows(readings, unit, along, "{:.7g}"))
        if output == _STDOUT:
            sys.stdout.write(text)
        else:
            files.write_text(output, text)
    else:
        arrays: dict[str, np.ndarray] = {
            "position": readings.position,
            "normal": readings.normal,
            **readings.values(unit),
            "status": readings.status.astype(np.uint8),
            "stats": np.array(stats),
        }
        if grid is not None:
            arrays["grid"] = np.array([grid.columns, grid.rows])
        if along is not None:
            arrays["along"] = along
        files.write_arrays(output, arrays)


def _rows(readings: Readings, unit: Unit, along: np.ndarray | None, form: str) -> Iterator[list[str]]:
    """Yield the rows of the table with a header: distance along a line, place, direct, indirect and total light, status.

    The light of invalid points is empty.
    """
    parts = readings.values(unit)
    names = [name + colour for name in parts for colour in (("",) if unit == "lux" else ("_r", "_g", "_b"))]
    places, axes = readings.position, ["x", "y", "z"]
    if along is not None:
        places, axes = np.column_stack([along, places]), ["along", *axes]
    yield [*axes, *names, "status"]
    exact = form if readings.position.dtype == np.float32 else "{:.12g}"  # far from the origin
    light = np.concatenate([values.reshape(len(values), -1) for values in parts.values()], axis=1)
    for place, values, status in zip(places.tolist(), light.tolist(), readings.status.tolist(), strict=True):
        shown = [form.format(v) if status == Status.OK else "" for v in values]
        yield [*(exact.format(v) for v in place), *shown, Status(status).name.lower()]


def _summary_lines(summary: Summary, grid: Grid | None, along: np.ndarray | None) -> Iterator[str]:
    unit = "lux" if summary["unit"] == "lux" else "W/m²"
    if grid is not None:
        yield f"points      {grid.columns} x {grid.rows}, {summary['points']} of them count"
    if along is not None:
        yield f"points      {len(along)} along {along[-1]:.4g} m, {summary['points']} of them count"
    for left_out, why in ((summary["inside"], "within solids"), (summary["behind"], "with a surface on them")):
        if left_out:
            yield f"left out    {left_out} {why}"
    mean, low, high, even = (summary[name] for name in ("mean", "minimum", "maximum", "uniformity"))
    if mean is None:
        yield "mean        none: no point counts"
        return
    yield f"mean        {mean:.4g} {unit}"
    yield f"minimum     {low:.4g} {unit}"
    yield f"maximum     {high:.4g} {unit}"
    yield "uniformity  U0 = " + ("none in the dark" if even is None else f"{even:.3f} (minimum/mean)")
