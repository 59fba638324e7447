"""Measure all numbers of the pages: `python docs/programs/measure.py [PART …]`, some minutes on two cores.

A part is a key of PARTS; without one, all but `rest` (an hour) are measured. Results are stored in measurements.json here, each
with its date and the load of the machine. Then the tables and numbers of the pages are written from that file; the part `fill`
does this alone. A page marks a table by <!-- NAME: made by docs/programs/measure.py -->, and a number by its keys and its format:
<!-- n: accuracy/cornell/1/error .1f -->0.7<!-- n -->.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import re
import sys
import time
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any

import cie
import numpy as np
import rest as still
import tutorial
from tables import between, table

import irrsplat
from irrsplat.app.bench import cases
from irrsplat.core.errors import InputError
from irrsplat.settings import SettingValues

ROOT = Path(__file__).resolve().parents[2]
KEPT = Path(__file__).with_name("measurements.json")
SCENES = ("cornell", "cornell-paper", "curved", "door", "atrium")
FULL = ("cornell", "door")  # with a row per technique
# Changes of the settings, in words; the tutorial's ladder has the published gather and placement
TECHNIQUES: tuple[tuple[str, SettingValues], ...] = (
    ("without gradients, and all that needs them", {"gradients": False}),
    ("weights and radii of the paper", {"weights": "paper"}),
    ("without radii that adapt", {"adapt": 0.0}),
    ("no records by inter-record variance", {"spread": 0.0}),
    ("without limits of the radius", {"radius_min": 0.0, "radius_max": 0.0}),
    ("a gather of 32²", {"gather_size": 32}),
)
NEAR, TRIES = 0.05, 8  # relative tolerance for a number of records, and the most renders for one
WARMUP = 1000 / 1511  # published: share of random records
SEEDS = (0, 1, 2)
EACH = "records", "error", "bias", "outliers"
NUMBER = re.compile(r"(<!-- n: (\S+) (\S+) -->).*?(<!-- n -->)", re.S)
Found = dict[str, Any]


def rendered(name: str, bounces: int | str = 1, **settings: Any) -> Found:
    """Render a scene; return its number of records and its errors in percent."""
    frame = irrsplat.render(irrsplat.load(name), (tutorial.SIZE,) * 2, bounces=bounces, **settings)
    found = tutorial.errors(name, frame, bounces)
    print(name, bounces, settings, found, file=sys.stderr, flush=True)
    return found


def accuracy() -> Found:
    """Measure each scene with one bounce and with all: means over SEEDS."""
    found: Found = {}
    for name in SCENES:
        found[name] = {"triangles": sum(len(mesh.faces) for mesh in irrsplat.load(name).meshes)}
        for bounces in (1, "all"):
            runs = [rendered(name, bounces, seed=seed) for seed in SEEDS]
            found[name][str(bounces)] = {key: float(np.mean([run[key] for run in runs])) for key in runs[0]}
    return found


def techniques() -> Found:
    """Measure the scenes of FULL with one technique off at a time, and by the preset `paper` with as many records."""
    found: Found = {}
    for name in FULL:
        rows = {"everything on": rendered(name)}
        rows |= {words: rendered(name, **values) for words, values in TECHNIQUES}
        rows["preset paper, as many records"] = paper = published(name, rows["everything on"]["records"])
        found[name] = {"rows": rows, "times": paper["error"] / rows["everything on"]["error"]}
    return found


def published(name: str, records: int) -> Found:
    """Render by the preset `paper` at the a that gives about `records`; its warm-up is at most the published share."""
    tried: list[Found] = []
    a, low, high = 0.3, 0.01, 2.0
    for _ in range(TRIES):
        tried.append(rendered(name, preset="paper", a=float(f"{a:.3g}"), warmup=min(1000, round(WARMUP * records))))
        count = tried[-1]["records"]
        if abs(count / records - 1.0) <= NEAR:
            break
        low, high = (a, high) if count > records else (low, a)
        guess = a * (count / records) ** 0.6  # records are about proportional to a^-1.6
        a = guess if low < guess < high else (low * high) ** 0.5
    return min(tried, key=lambda one: abs(math.log(max(one["records"], 1) / records)))


def speed() -> Found:
    """Time a picture from an empty cache, again, turned by 5° and with a light moved; seconds to full coverage."""
    found: Found = {}
    for name, preset, size, bounces in (
        ("cornell-paper", "paper", 800, 1),
        ("cornell-paper", "default", 800, 1),
        ("cornell", "default", 400, "all"),
        ("atrium", "default", 400, "all"),
    ):
        scene = irrsplat.load(name)
        with irrsplat.Renderer(scene, (size, size), preset=preset, bounces=bounces) as renderer:
            camera = scene.camera()
            cases.warm_up(renderer, camera)
            empty = cases.middle(cases.from_records(renderer, camera))
            kept = cases.records_of(renderer)
            times = {"empty": empty.seconds}
            for case, seen in (("warm", camera), ("moved", cases.turned(camera, cases.TURN))):
                times[case] = cases.middle(cases.from_records(renderer, seen, kept)).seconds
            found[f"{name} {preset}"] = {"size": size, "bounces": bounces, "records": empty.records, **times}
            print(found[f"{name} {preset}"], file=sys.stderr, flush=True)
    return found


def cie_cases() -> Found:
    """Measure the cases of CIE 171:2006; errors are relative."""
    found: Found = {}
    for case in cie.CASES:
        count, greatest, rms = case.error()
        found[f"{case.clause} {case.what}"] = {"values": count, "greatest": greatest, "rms": rms, "goal": case.goal}
    return found


PARTS: dict[str, Callable[[], Found]] = {
    "accuracy": accuracy,
    "techniques": techniques,
    "ladder": tutorial.ladder,
    "shares": tutorial.shares,
    "radii": tutorial.radii,
    "speed": speed,
    "cie": cie_cases,
    "rest": still.measured,
}


# ---- tables ------------------------------------------------------------------------------------------------------------------


def shown(run: Found) -> tuple[str, ...]:
    """Return the cells of one rendering."""
    bias = round(run["bias"], 1) + 0.0  # no negative zero
    return f"{run['records']:,.0f}", f"{run['error']:.2f} %", f"{bias:+.1f} %", f"{run['outliers']:.1f} %"


def runs(part: Found) -> list[tuple[str, Any]]:
    """Return the entries of a part without its date and load."""
    return [(key, run) for key, run in part.items() if key not in ("date", "load")]


def accuracy_table(part: Found) -> str:
    """Return a row per scene: one bounce and all."""
    head = "scene", "triangles", "one bounce: records", *EACH[1:], "all bounces: records", *EACH[1:]
    return table(head, [(f"`{n}`", str(one["triangles"]), *shown(one["1"]), *shown(one["all"])) for n, one in runs(part)])


def summary_table(part: Found) -> str:
    """Return a row per scene, of all bounces."""
    return table(
        ("scene", "triangles", *EACH[:3]), [(f"`{n}`", str(one["triangles"]), *shown(one["all"])[:3]) for n, one in runs(part)]
    )


def techniques_table(part: Found) -> str:
    """Return a row per technique, for the scenes of FULL."""
    head = "", *(f"`{name}`: {what}" if what == EACH[0] else what for name in FULL for what in EACH[:3])
    found = [part[name]["rows"] for name in FULL]
    return table(head, [(words, *(cell for rows in found for cell in shown(rows[words])[:3])) for words in found[0]])


def speed_table(part: Found) -> str:
    """Return a row per scene, preset and size."""
    rows = []
    for key, run in runs(part):
        name, preset = key.split()
        times = (f"{run[case]:.2f}" for case in ("empty", "warm", "moved"))
        rows.append((f"`{name}`, `{preset}`", f"{run['size']}²", str(run["bounces"]), *times, f"{run['records']:,}"))
    return table(("scene, preset", "pixels", "bounces", "from empty", "the same view again", "turned by 5°", "records"), rows)


def cie_table(part: Found) -> str:
    """Return a row per case."""
    rows = []
    for key, run in runs(part):
        reached = "yes" if run["greatest"] <= run["goal"] else "no"
        errors = f"{run['greatest']:.2%}", f"{run['rms']:.2%}", f"{run['goal']:.0%}"
        rows.append((*key.split(" ", 1), str(run["values"]), *errors, reached))
    return table(("clause", "case", "values", "greatest error", "RMS", "goal", "reached"), rows)


TABLES: dict[str, Callable[[Found], str]] = {  # by the name of a place in a page: PART, or PART-FORM
    "accuracy": accuracy_table,
    "accuracy-summary": summary_table,
    "techniques": techniques_table,
    "ladder": tutorial.ladder_table,
    "shares": tutorial.shares_table,
    "radii": tutorial.radii_table,
    "speed": speed_table,
    "cie": cie_table,
    "rest": still.rows,
}


def filled(text: str, found: Found) -> str:
    """Return the text of a page with its tables and numbers written from what was found."""
    for name in re.findall(r"<!-- (\S+): made by docs/programs/measure.py -->", text):
        if (part := name.split("-")[0]) in found:
            text = between(text, "measure", name, TABLES[name](found[part]))
    return NUMBER.sub(lambda m: m[1] + format(reduce(lambda part, key: part[key], m[2].split("/"), found), m[3]) + m[4], text)


def kept() -> Found:
    """Return the results of former measurements."""
    found: Found = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    return found


def pages() -> list[Path]:
    """Return README and all pages of docs."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def main() -> None:
    """Measure the named parts, then fill the pages."""
    chosen = sys.argv[1:] or [name for name in PARTS if name != "rest"]
    for name in [name for name in chosen if name != "fill"]:
        if name not in PARTS:
            raise InputError(f"there is no part {name}; the parts are {', '.join(PARTS)} and fill")
        begun, load = time.monotonic(), os.getloadavg()[0]
        part = PARTS[name]() | {"date": f"{datetime.date.today()}", "load": round(load, 1)}
        found = kept() | {name: part}
        KEPT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"{name}: {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    for page in pages():
        text = page.read_text(encoding="utf-8")
        page.write_text(filled(text, kept()), encoding="utf-8")


if __name__ == "__main__":
    main()
