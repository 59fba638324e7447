"""Convergence of a still view over processor time; `measure.py rest` fills docs/about/experiments.md and plots it (an hour).

Five bundled scenes, with one bounce and with all, for SECONDS of processor time each: after every step the error against
tests/reference, and the estimate.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from tables import table

import irrsplat
from irrsplat.app.common.plot import Line, loglog
from irrsplat.core.files import write_picture
from irrsplat.image.view import Progress

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.support.truth import SIZE, load_reference  # noqa: E402

SCENES = ("cornell", "cornell-paper", "curved", "door", "atrium")
COLOURS = ((27, 94, 160), (200, 80, 20), (60, 130, 60), (130, 60, 150), (90, 90, 90))
SECONDS = 60.0
TARGET = 0.4  # percent, at which a refinement ends
Point = tuple[float, int, float, float]  # seconds, records, and in percent the error and its estimate


def one(name: str, bounces: int | str) -> list[Point]:
    """Return a point for each picture of a view that is refined; the time excludes that of comparing."""
    scene, reference = irrsplat.load(name), load_reference(name)
    truth, agreement = reference.of(bounces)
    row, column = reference.pixels.T
    points: list[Point] = []
    with irrsplat.Renderer(scene, (SIZE, SIZE), bounces=bounces) as renderer:
        start = time.process_time()
        view, _ = renderer.converge()
        progress: Progress | None = None
        known: float | None = None
        while progress is None or (not progress.refined and time.process_time() - start < SECONDS):
            view, progress = renderer.refine(None, 0.01 * TARGET, seconds=0.2)
            if progress.error == known or progress.error is None:
                continue
            known, before = progress.error, time.process_time()
            sums = np.frombuffer(view.splats.sums.read(), "f4").reshape(SIZE, SIZE, 4)[::-1][row, column].astype(float)
            off = sums[:, :3] / np.maximum(sums[:, 3:], 1e-20) - truth
            error = np.sqrt(max(np.mean(off**2) / float(truth.mean()) ** 2 - (agreement / 2.0) ** 2, 0.0))
            points.append((before - start, renderer.cache.count, 100.0 * float(error), 100.0 * known))
            start += time.process_time() - before
    return points


def measured() -> dict[str, Any]:
    """Measure all scenes with one bounce and with all, and draw docs/images/measured/rest.png."""
    found = {f"{name} {bounces}": one(name, bounces) for bounces in (1, "all") for name in SCENES}
    lines = []
    for name, colour in zip(SCENES, COLOURS, strict=True):
        pale = tuple(160 + round(0.37 * channel) for channel in colour)
        for words, column, ink in ((name, 2, colour), ("its estimate", 3, pale)):
            at = (np.array([point[i] for point in found[f"{name} 1"]]) for i in (0, column))
            lines.append(Line(words, *at, (ink[0], ink[1], ink[2])))
    plot = loglog(lines, "A still view, 400 x 400, one bounce", "seconds of processor time", "error, %")
    write_picture(ROOT / "docs" / "images" / "measured" / "rest.png", plot)
    return found


def rows(found: dict[str, Any]) -> str:
    """Return a row for each scene that was measured, with one bounce and with all."""
    lines = []
    for key, points in found.items():
        if isinstance(points, list):
            name, bounces = key.split()
            cells = (f"{seconds:.0f}: {error:.2f}, {estimate:.2f}" for seconds, _, error, estimate in points)
            lines.append((f"`{name}`, {bounces}", "; ".join(cells)))
    return table(("scene, bounces", "seconds: error, estimate (percent)"), lines)
