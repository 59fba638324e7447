"""Measures tables and plot of docs/about/techniques.md: `python docs/programs/techniques.py` (needs the extra `reference`)."""

from __future__ import annotations

import sys
from pathlib import Path

from tables import between

import irrsplat
from irrsplat.app import grammar
from irrsplat.app.verify import ablation, error_curve
from irrsplat.app.verify.measure import percent
from irrsplat.app.verify.verify import heading
from irrsplat.core.files import write_picture

PAGE = Path(__file__).resolve().parents[1] / "about/techniques.md"
FULL = ("cornell", "door")  # with a row per technique
SCENES = ("cornell", "cornell-paper", "curved", "door", "atrium")
WORDS = ("--size", "400", "400", "--samples", "512", "--bounces", "1")


def table(rows: list[tuple[str, ...]]) -> str:
    """A Markdown table of rows, the head first; all but the first column to the right."""
    lines = [rows[0], ("---", *("---:" for _ in rows[0][1:])), *rows[1:]]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def main() -> None:
    """Measure all, then write the page and its picture."""
    made = {"techniques": "", "paper": "", "curve": ""}
    against: list[tuple[str, ...]] = [("scene", "records", "RMSE", "records of paper", "its RMSE", "times")]
    for name in SCENES:
        print(name, file=sys.stderr)
        args, scene = grammar.parse(["verify", name, *WORDS]), irrsplat.load(name)
        chosen = ablation.TECHNIQUES if name in FULL else ()
        found, line = ablation.measured(scene, scene.camera(), args, chosen)
        if chosen:
            made["techniques"] += f"\n{heading(scene, args)}:\n\n{table(ablation.rows(found, line))}"
        (_, ours), (_, paper) = found[0], found[-1]
        assert ours.rmse and paper.rmse
        pair = f"{ours.records:,}", percent(ours.rmse), f"{paper.records:,}", percent(paper.rmse)
        against.append((f"`{name}`", *pair, f"{paper.rmse / ours.rmse:.1f}"))
        if name == FULL[0]:
            curves = error_curve.measured(scene, scene.camera(), args)
            for preset, points in curves.items():
                made["curve"] += f"\n{table(error_curve.rows(preset, points))}\nHere {error_curve.steepness(points)}.\n"
            write_picture(PAGE.parents[1] / "images" / "measured" / "curve.png", error_curve.plot(curves, heading(scene, args)))
    made["paper"] = "\n" + table(against)
    text = PAGE.read_text(encoding="utf-8")
    for key, value in made.items():
        text = between(text, "techniques", key, value)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
