"""Renders the pictures of docs/tutorial and measures its tables: `python docs/programs/tutorial.py` (a minute on two cores).

Errors are against the path-traced pixels of tests/reference, at 400x400 with one bounce: RMSE relative to the truth's mean.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import irrsplat
from irrsplat.core.color import LUMINANCE, srgb
from irrsplat.image.frame import Frame
from irrsplat.settings import PRESETS, SETTINGS, SettingValues

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.support.truth import SIZE, load_reference  # noqa: E402

PAGES = ROOT / "docs" / "tutorial"
IMAGES = ROOT / "docs" / "images" / "tutorial"
LADDER: tuple[tuple[str, str, SettingValues], ...] = (  # from the preset paper to the default: name, words, what it switches on
    ("published", "as published, its radiometry mended", {}),
    ("tiles", "placement coarse to fine, not in scan order", {"placement": "tiles"}),
    ("hemisphere", "the whole hemisphere, not one plane", {"gather": "trace"}),
    ("kernel", "weights that fall to 0 at the rim", {"kernel": "smooth"}),
    ("front", "records in front or behind say nothing", {"in_front": True}),
    ("gradients", "irradiance vector and translation gradient", {"gradients": True}),
    ("second", "second derivatives", {"second_order": True}),
    ("limits", "a radius of 0.5 to 7 % of the picture's height", {"radius_min": 0.5, "radius_max": 7.0}),
    ("hessian", "radii from the Hessian, along and across", {"radius": "hessian"}),
    ("adapt", "records that contradict others shrink", {"adapt": 0.6}),
    ("spread", "more records where some contradict each other", {"spread": 0.05}),
)
SHOWN = ("published", "hemisphere", "kernel", "gradients", "limits", "spread")
SHARED: SettingValues = {
    "a": 0.6,
    "bounces": 1,
    "warmup": 220,
}  # random records: two thirds of those that there are, as published
DARKER = 10.0  # docs/METHOD.md, 2.2: "by more than a factor of ten"


def save(name: str, display: np.ndarray) -> None:
    """Store display values 0..1 (H, W, 3) as docs/images/tutorial/`name`.png."""
    target = IMAGES / f"{name}.png"
    Image.fromarray((255.0 * np.clip(display, 0.0, 1.0) + 0.5).astype(np.uint8)).save(target, optimize=True)
    if target.stat().st_size > 150_000:
        Image.open(target).quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(target, optimize=True)
    print(f"{target.name}: {target.stat().st_size // 1000} kB")


def error(scene: str, frame: Frame, bounces: int | str = 1) -> tuple[float, float]:
    """Relative RMSE and bias of a frame's irradiance, in percent, without the truth's own noise."""
    reference = load_reference(scene)
    truth, agreement = reference.of(bounces)
    row, column = reference.pixels.T
    off = frame.irradiance[row, column] - truth
    rmse = np.sqrt(max(float(np.mean(off**2)) / float(truth.mean()) ** 2 - (agreement / 2.0) ** 2, 0.0))
    return 100.0 * float(rmse), 100.0 * float(off.mean() / truth.mean())


def records(frame: Frame) -> str:
    """How many records a frame was made of."""
    return f"{len(frame.records_radius):,}"


def ladder(scene: str = "cornell") -> str:
    """A table with a row for each technique that is added, and the pictures of some."""
    values: SettingValues = {**PRESETS["paper"], **SHARED}
    rows, white = "", 0.0
    for name, words, added in LADDER:
        values = {**values, **added}
        frame = irrsplat.render(irrsplat.load(scene), (SIZE, SIZE), preset="default", **values)
        white = white or float(np.percentile(frame.irradiance @ LUMINANCE, 97))
        rmse, bias = error(scene, frame)
        switched = " ".join(f"`{SETTINGS[key].flag} {word(value)}`" for key, value in added.items()) or "`--preset paper`"
        rows += f"| {words} | {switched} | {records(frame)} | {rmse:.1f} % | {bias:+.1f} % |\n"
        print(name, records(frame), f"{rmse:.2f} {bias:+.2f}", flush=True)
        if name in SHOWN:
            save(name, srgb(np.clip(frame.irradiance / white, 0.0, 1.0)))
    return "| added | setting | records | RMSE | bias |\n| --- | --- | ---: | ---: | ---: |\n" + rows


def word(value: object) -> str:
    """A setting's value as on the command line."""
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def sums(scene: str = "cornell-paper") -> None:
    """Pictures of how the published program added direct and indirect light, and of the sum that is meant."""
    found = irrsplat.render(irrsplat.load(scene), (SIZE, SIZE), preset="paper", **SHARED)
    direct = np.clip(found.direct, 0.0, 1.0)  # eight bits have no more, and nothing was exposed
    save("sum_published", np.clip(found.indirect / DARKER + 0.5 * direct, 0.0, 1.0))
    frame = irrsplat.render(irrsplat.load(scene), (SIZE, SIZE), bounces=1)
    save("sum_ours", frame.picture)


def shares() -> str:
    """A table of how much of the light is indirect, in each scene, by luminance over all pixels."""
    rows = ""
    for scene in ("cornell", "cornell-paper", "curved", "door", "atrium"):
        loaded = irrsplat.load(scene)
        one = irrsplat.render(loaded, (200, 200), bounces=1)
        every = irrsplat.render(loaded, (200, 200))
        seen = np.isfinite(every.depth)
        direct, first, all_of_it = (float((b @ LUMINANCE)[seen].mean()) for b in (every.direct, one.indirect, every.indirect))
        rows += f"| `{scene}` | {100 * first / (direct + first):.0f} % | {100 * all_of_it / (direct + all_of_it):.0f} % "
        rows += f"| {all_of_it / first:.2f} |\n"
        print(scene, rows.splitlines()[-1], flush=True)
    return "| scene | indirect, one bounce | indirect, all bounces | all over one |\n| --- | ---: | ---: | ---: |\n" + rows


def near_and_far() -> str:
    """A table of how far records reach in `cornell`, near edges of the room and away from them."""
    frame = irrsplat.render(irrsplat.load("cornell"), (SIZE, SIZE), bounces=1)
    scene = irrsplat.load("cornell")
    places = np.concatenate([mesh.positions for mesh in scene.meshes])
    low, high = places.min(0), places.max(0)
    gaps = np.sort(np.minimum(frame.records_position - low, high - frame.records_position), axis=1)
    corner = gaps[:, 1]  # metres from the second nearest wall: the nearest is the record's own
    rows = ""
    for words, chosen in (
        ("less than 0.2 m", corner < 0.2),
        ("0.2 to 0.5 m", (corner >= 0.2) & (corner < 0.5)),
        ("0.5 to 1 m", (corner >= 0.5) & (corner < 1.0)),
        ("farther", corner >= 1.0),
    ):
        rows += f"| {words} | {int(chosen.sum())} | {float(np.median(frame.records_radius[chosen])):.2f} m |\n"
    print(rows, low, high)
    return "| from the next wall | records | median of R |\n| --- | ---: | ---: |\n" + rows


def filled(text: str, tables: dict[str, str]) -> str:
    """`text` with those of the marked tables that it has made anew."""
    for name, table in tables.items():
        start = f"<!-- {name}: made by docs/programs/tutorial.py -->\n"
        text = re.sub(
            f"({re.escape(start)}).*?(<!-- end -->)", lambda m, table=table: m[1] + "\n" + table + m[2], text, flags=re.S
        )
    return text


def main() -> None:
    """Render and measure everything, and fill the pages."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    sums()
    tables = {"ladder": ladder(), "shares": shares(), "radii": near_and_far()}
    for page in sorted(PAGES.glob("*.md")):
        page.write_text(filled(page.read_text(encoding="utf-8"), tables), encoding="utf-8")
    (ROOT / "out").mkdir(exist_ok=True)
    (ROOT / "out" / "tutorial.txt").write_text("\n".join(f"{name}\n{table}" for name, table in tables.items()), encoding="utf-8")


if __name__ == "__main__":
    main()
