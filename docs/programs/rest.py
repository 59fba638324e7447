"""Measures the convergence of a still view for docs/about/experiments.md: `python docs/programs/rest.py [SCENE …]` (an hour).

Five bundled scenes, with one bounce and with all, for SECONDS of processor time each: after every step the error against the
truth in tests/reference, and the estimate. What is measured stays in out/rest.json; the picture and the tables are made of that.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
from tables import between

import irrsplat
from irrsplat.app.common.plot import Line, loglog, palette
from irrsplat.core.files import write_picture
from irrsplat.image.view import Progress

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.support.truth import SIZE, load_reference  # noqa: E402

SCENES = ("cornell", "cornell-paper", "curved", "door", "atrium")
SECONDS = 60.0
TARGET = 0.4  # percent, at which a refinement ends
KEPT = ROOT / "out" / "rest.json"
Point = tuple[float, int, float, float]  # seconds, records, and in percent the error and its estimate


def measured(name: str, bounces: int | str) -> list[Point]:
    """A point for each picture of a view that is refined; the time goes without that of comparing."""
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
            sums = np.frombuffer(view.sums.read(), "f4").reshape(SIZE, SIZE, 4)[::-1][row, column].astype(float)
            off = sums[:, :3] / np.maximum(sums[:, 3:], 1e-20) - truth
            error = np.sqrt(max(np.mean(off**2) / float(truth.mean()) ** 2 - (agreement / 2.0) ** 2, 0.0))
            points.append((before - start, renderer.cache.count, 100.0 * float(error), 100.0 * known))
            start += time.process_time() - before
    return points


def table(found: dict[str, list[Point]]) -> str:
    """A row for each scene that was measured, with one bounce and with all."""
    lines = ["| scene, bounces | seconds: error, estimate (percent) |", "| --- | --- |"]
    for key, points in found.items():
        cells = "; ".join(f"{seconds:.0f}: {error:.2f}, {told:.2f}" for seconds, _, error, told in points)
        lines.append(f"| `{key.split()[0]}`, {key.split()[1]} | {cells} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is named, or all that is not known yet; fill experiments.md and draw images/measured/rest.png."""
    found: dict[str, list[Point]] = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    for bounces in (1, "all"):
        for name in sys.argv[1:] or SCENES:
            key = f"{name} {bounces}"
            if key not in found or sys.argv[1:]:
                found[key] = measured(name, bounces)
                KEPT.parent.mkdir(exist_ok=True)
                KEPT.write_text(json.dumps(found, indent=1))
                print(key, found[key], flush=True)
    keys = [f"{name} {bounces}" for bounces in (1, "all") for name in SCENES if found.get(f"{name} {bounces}")]
    lines = []
    for name, colour in zip(SCENES, palette(len(SCENES)), strict=True):
        pale = tuple(160 + round(0.37 * channel) for channel in colour)
        for words, column, ink in ((name, 2, colour), ("its estimate", 3, pale)):
            points = found.get(f"{name} 1") or []
            if points:
                lines.append(Line(words, *(np.array([p[i] for p in points]) for i in (0, column)), (ink[0], ink[1], ink[2])))
    title = "A view at rest, 400 x 400, one bounce"
    write_picture(
        ROOT / "docs" / "images" / "measured" / "rest.png", loglog(lines, title, "seconds of processor time", "error, %")
    )
    page = ROOT / "docs" / "about" / "experiments.md"
    text = page.read_text(encoding="utf-8")
    made = table({key: found[key] for key in keys})
    page.write_text(between(text, "rest", "rest", made), encoding="utf-8")


if __name__ == "__main__":
    main()
