"""`irrsplat measure`: the light on a plane or at points, as a table, in files, and summed up."""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from irrsplat import settings
from irrsplat.app.common.terminal import columns, progress, say
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.plane import Grid, Plane, horizontal
from irrsplat.meter.readings import Readings, Status, Summary, Unit
from irrsplat.scene.model import Scene

_STDOUT = "-"
_ENDINGS = (".csv", ".npz")


def check(args: argparse.Namespace) -> None:
    """Raises InputError for what is wrong with the command line, as far as that can be said before the scene is there."""
    settings.preset(args.preset, **args.values)
    given = [flag for flag in ("plane", "height", "point") if getattr(args, flag) is not None]
    if not given:
        raise InputError("there is nothing to measure; give --plane, --height or --point")
    if len(given) > 1:
        raise InputError(f"--{given[0]} and --{given[1]} say two different places; give one of them")
    for flag in ("grid", "margin"):
        if args.point is not None and getattr(args, flag) is not None:
            raise InputError(f"--{flag} is for a plane; leave it out, or give --plane or --height")
    if args.plane is not None:
        _grid(_plane(args.plane), args)
    if args.output is not None and args.output != _STDOUT:
        if Path(args.output).suffix.lower() not in _ENDINGS:
            raise InputError(f"unknown ending; expected {' or '.join(_ENDINGS)}, or - for CSV on stdout", args.output or "''")
        files.check_file(args.output)
    if args.stats is not None:
        files.check_file(args.stats)
        if args.output is not None and os.path.realpath(args.stats) == os.path.realpath(args.output):
            raise InputError("--stats and the output are one file; give another name", args.stats)


def run(scene: Scene, args: argparse.Namespace) -> int:
    """Measure, and write what is asked for; the exit status. Raises InputError where the scene has no extent for a plane."""
    unit: Unit = args.unit
    grid = None
    if args.point is not None:
        places = np.array(args.point, float)
        points, normals = places[:, :3], places[:, 3:]
    else:
        grid = _grid(horizontal(scene, args.height) if args.plane is None else _plane(args.plane), args)
        points, normals = grid.points, grid.normals
    with LightMeter(scene, args.preset, **args.values) as meter:
        for notice in (*scene.notices, *meter.world.materials.notices):
            say(f"notice: {notice}")
        with progress() as line:
            on_points = None if line is None else lambda share: line(share, f"{len(points)} points")
            readings = meter.measure(points, normals, on_points)
        how = meter.gatherer.bounces(meter.settings)
    summary = readings.summary(unit)
    shape = None if grid is None else [grid.columns, grid.rows]
    stats = {"scene": scene.name, "grid": shape, **summary, **how, "preset": args.preset, "settings": vars(meter.settings)}
    _write(args.output, readings, unit, grid, json.dumps(stats))
    if args.stats is not None:
        files.write_text(args.stats, json.dumps(stats, indent=1) + "\n")
    for told in _told(summary, grid):
        print(told, file=sys.stderr if args.output == _STDOUT else sys.stdout)
    return 0


def _plane(values: list[float]) -> Plane:
    """The plane of --plane's nine numbers."""
    corner, u, v = ((values[i], values[i + 1], values[i + 2]) for i in (0, 3, 6))
    return Plane(corner, u, v)


def _grid(plane: Plane, args: argparse.Namespace) -> Grid:
    """The points on the plane, as the flags have them."""
    margin = args.margin or 0.0
    return plane.grid(plane.usual_spacing(margin) if args.grid is None else args.grid, margin)


# ---- what is written ---------------------------------------------------------------------------------------------------


def _write(output: str | None, readings: Readings, unit: Unit, grid: Grid | None, stats: str) -> None:
    """Write the readings to a file, or print them."""
    if output is None:
        for line in columns(list(_rows(readings, unit, "{:.4g}")), 0):
            print(line)
    elif output == _STDOUT or output.lower().endswith(".csv"):
        text = "".join(",".join(row) + "\n" for row in _rows(readings, unit, "{:.7g}"))
        if output == _STDOUT:
            sys.stdout.write(text)
        else:
            files.write_text(output, text)
    else:
        arrays: dict[str, np.ndarray] = {"position": readings.position, "normal": readings.normal, **readings.values(unit)}
        arrays |= {"status": readings.status.astype(np.uint8), "stats": np.array(stats)}
        if grid is not None:
            arrays["grid"] = np.array([grid.columns, grid.rows])
        data = io.BytesIO()
        np.savez_compressed(data, **arrays)  # type: ignore[arg-type]  # numpy's stub takes a further keyword for an array
        files.write_bytes(output, data.getvalue())


def _rows(readings: Readings, unit: Unit, form: str) -> Iterator[list[str]]:
    """The rows of the table, its head first: place, direct, indirect and total light, none where it does not count, status."""
    parts = readings.values(unit)
    colours = ("",) if unit == "lux" else ("_r", "_g", "_b")
    yield ["x", "y", "z", *(name + colour for name in parts for colour in colours), "status"]
    light = np.concatenate([values.reshape(len(values), -1) for values in parts.values()], axis=1)
    for place, values, status in zip(readings.position.tolist(), light.tolist(), readings.status.tolist(), strict=True):
        shown = [form.format(v) if status == Status.OK else "" for v in values]
        yield [*(form.format(v) for v in place), *shown, Status(status).word]


def _told(summary: Summary, grid: Grid | None) -> Iterator[str]:
    """The lines that sum it up."""
    unit = "lux" if summary["unit"] == "lux" else "W/m²"
    if grid is not None:
        yield f"points      {grid.columns} x {grid.rows}, {summary['points']} of them count"
    for status, why in ((Status.INSIDE, "within solids"), (Status.BEHIND, "with a surface on them")):
        left_out = summary["inside"] if status == Status.INSIDE else summary["behind"]
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
