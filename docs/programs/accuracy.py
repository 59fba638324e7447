"""Measures the errors of the bundled scenes for docs/measurements.md and README.md: `python docs/programs/accuracy.py`.

Renders of three seeds, 400×400, with one bounce and with all, against the truth in tests/reference; some minutes on two cores.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from tables import between, table

import irrsplat
from irrsplat.settings import All

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.support.truth import SIZE, compare, load_reference  # noqa: E402

SCENES = ("cornell", "cornell-paper", "curved", "door", "atrium")
SEEDS = (0, 1, 2)


def measured(name: str, bounces: int | All) -> np.ndarray:
    """(4,) records, and in percent error, bias and outliers: means over SEEDS."""
    scene, reference, found = irrsplat.load(name), load_reference(name), []
    for seed in SEEDS:
        frame = irrsplat.render(scene, (SIZE, SIZE), bounces=bounces, seed=seed)
        off = compare(frame, reference, bounces)
        found.append((frame.stats["records"], *(100.0 * off[what] for what in ("rmse", "bias", "outliers"))))
        print(name, bounces, seed, found[-1], file=sys.stderr, flush=True)
    return np.mean(found, axis=0)


def main() -> None:
    """Measure all, then fill both pages."""
    whole: list[tuple[str, ...]] = []
    short: list[tuple[str, ...]] = []
    for name in SCENES:
        triangles = str(sum(len(mesh.faces) for mesh in irrsplat.load(name).meshes))
        one, every = measured(name, 1), measured(name, "all")
        shown = [(f"{m[0]:.0f}", f"{m[1]:.2f} %", f"{m[2]:+.1f} %", f"{m[3]:.1f} %") for m in (one, every)]
        whole.append((f"`{name}`", triangles, *shown[0], *shown[1]))
        short.append((f"`{name}`", triangles, f"{every[0]:.0f}", f"{every[1]:.1f} %", f"{every[2]:+.1f} %"))
    each = "records", "error", "bias", "outliers"
    head = ("scene", "triangles", "one bounce: records", *each[1:], "all bounces: records", *each[1:])
    for page, columns, rows in (
        (ROOT / "docs" / "measurements.md", head, whole),
        (ROOT / "README.md", ("scene", "triangles", *each[:3]), short),
    ):
        text = between(page.read_text(encoding="utf-8"), "accuracy", "accuracy", table(columns, rows))
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
