"""`irrsplat verify --techniques`: error with all techniques, without each one, and of the published algorithm."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

from irrsplat.app.common.terminal import columns, out, progress
from irrsplat.app.verify.error_curve import at, scaled
from irrsplat.app.verify.measure import Measured, measurer, percent, silent
from irrsplat.settings import SettingValues

if TYPE_CHECKING:
    from irrsplat.scene.model import Camera, Scene

# Changes to the preset, in words and in settings
TECHNIQUES: tuple[tuple[str, SettingValues], ...] = (
    ("without gradients, and all that needs them", {"gradients": False}),
    ("weights and radii of the paper", {"weights": "paper"}),
    ("without radii that adapt", {"adapt": 0.0}),
    ("no records by inter-record variance", {"spread": 0.0}),
    ("without limits of the radius", {"radius_min": 0.0, "radius_max": 0.0}),
    ("one plane of 150°, not the hemisphere", {"gather": "plane"}),
    ("a gather of 32²", {"gather_size": 32}),
    ("the paper's placement", {"placement": "scan"}),
)
CURVE = (1.6, 0.65)  # further points of the preset's curve: factors of its records' radii
NEAR = 0.05  # tolerance for a number of records, relative
TRIES = 8
WARMUP = 1000 / 1511  # published: share of random records

Rendered = Callable[[str, SettingValues], Measured]  # by preset and settings


def run(scene: Scene, camera: Camera, args: Namespace, heading: str) -> None:
    """Measure every row and print the table."""
    out(heading)
    out("\n".join(columns(rows(*measured(scene, camera, args)), left=1)))


def measured(
    scene: Scene, camera: Camera, args: Namespace, chosen: Sequence[tuple[str, SettingValues]] = TECHNIQUES
) -> tuple[list[tuple[str, Measured]], list[Measured]]:
    """Return the renderings of the table's rows, and the method's curve with all techniques.

    The rows are all techniques on, each of `chosen`, and the published algorithm.
    """
    steps = len(chosen) + len(CURVE) + 2
    done: list[Measured] = []
    with progress() as line:
        notify = line or silent
        measure = measurer(scene, camera, args, notify)

        def render(name: str, values: SettingValues) -> Measured:
            done.append(measure(name, values, lambda part, words: notify(min(len(done) + part, steps) / steps, words)))
            return done[-1]

        whole = render(args.preset, args.values)
        curve = [whole, *(render(args.preset, scaled(args.preset, args.values, factor)) for factor in CURVE)]
        found = [("everything on", whole)]
        found += [(name, render(args.preset, args.values | values)) for name, values in chosen]
        if args.preset != "paper":
            found.append(("preset paper, as many records", paper(render, whole.records, args.values)))
    return found, curve


def paper(render: Rendered, records: int, given: SettingValues) -> Measured:
    """Measure the preset `paper` at the a that gives about `records`; its warm-up is at most the published share."""
    shared = cast(SettingValues, {k: v for k, v in given.items() if k in ("bounces", "seed", "shadow_size")})
    warmup = min(1000, round(WARMUP * records))
    best: Measured | None = None
    a, bounds = 0.3, (0.01, 2.0)
    for _ in range(TRIES):
        found = render("paper", shared | {"a": float(f"{a:.3g}"), "warmup": warmup})
        if best is None or abs(math.log(max(found.records, 1) / records)) < abs(math.log(max(best.records, 1) / records)):
            best = found
        if abs(found.records / records - 1.0) <= NEAR:
            break
        bounds = (a, bounds[1]) if found.records > records else (bounds[0], a)
        guess = a * (found.records / records) ** 0.6  # records are about proportional to a^-1.6
        a = guess if bounds[0] < guess < bounds[1] else math.sqrt(bounds[0] * bounds[1])
    assert best is not None
    return best


def rows(found: Sequence[tuple[str, Measured]], curve: Sequence[Measured]) -> list[tuple[str, ...]]:
    """Return the table's cells with a header.

    The last column is the row's error divided by the full method's error at an equal number of records.
    """
    table: list[tuple[str, ...]] = [("", "records", "RMSE", "bias", "off by > 30 %", "seconds", "at equal records")]
    for name, one in found:
        full = at(curve, one.records)
        ratio = "" if full is None or one.rmse is None else f"{one.rmse / full:.2f} x"
        errors = percent(one.rmse), percent(one.bias, "+"), percent(one.outliers)
        table.append((name, f"{one.records:,}", *errors, f"{one.seconds:.1f}", ratio))
    return table
