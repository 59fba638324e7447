"""Render the pictures of docs/tutorial: `python docs/programs/tutorial.py` (a minute). `measure.py` fills the tables."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from tables import table, word

import irrsplat
from irrsplat.core.color import LUMINANCE, srgb
from irrsplat.image.frame import Frame
from irrsplat.settings import PRESETS, SETTINGS, SettingValues

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.support.truth import SIZE, compare, load_reference  # noqa: E402

IMAGES = ROOT / "docs" / "images" / "tutorial"
LADDER: tuple[tuple[str, str, SettingValues], ...] = (  # from the preset paper to the default: name, words, what it switches on
    ("published", "as published, with corrected radiometry", {}),
    ("tiles", "placement from coarse to fine instead of in scan order", {"placement": "tiles"}),
    ("hemisphere", "the whole hemisphere instead of one plane", {"gather": "auto"}),
    ("gradients", "irradiance vector and translation gradient", {"gradients": True}),
    ("limits", "a radius of 0.5 to 7 % of the picture's height", {"radius_min": 0.5, "radius_max": 7.0}),
    ("weights", "weights and radii from the Hessian", {"weights": "hessian"}),
    ("adapt", "smaller radii where records disagree", {"adapt": 0.6}),
    ("spread", "further records where records disagree", {"spread": 0.05}),
)
SHOWN = ("published", "hemisphere", "gradients", "limits", "weights", "spread")
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


def errors(scene: str, frame: Frame, bounces: int | str = 1) -> dict[str, float]:
    """Return a frame's number of records, and in percent error, bias and outliers of its irradiance against tests/reference."""
    off = compare(frame, load_reference(scene), bounces)
    relative = {to: 100.0 * off[key] for to, key in (("error", "rmse"), ("bias", "bias"), ("outliers", "outliers"))}
    return {"records": frame.stats["records"], **relative}


def ladder(scene: str = "cornell", pictures: bool = False) -> dict[str, Any]:
    """Measure each step of LADDER, and write the pictures of some on request."""
    values: SettingValues = {**PRESETS["paper"], **SHARED}
    found: dict[str, Any] = {}
    white = 0.0
    for name, _, added in LADDER:
        values = {**values, **added}
        frame = irrsplat.render(irrsplat.load(scene), (SIZE, SIZE), preset="default", **values)
        found[name] = errors(scene, frame)
        white = white or float(np.percentile(frame.irradiance @ LUMINANCE, 97))
        if pictures and name in SHOWN:
            save(name, srgb(np.clip(frame.irradiance / white, 0.0, 1.0)))
    return found


def ladder_table(found: dict[str, Any]) -> str:
    """Return a row for each technique that is added."""
    rows = []
    for name, words, added in LADDER:
        switched = " ".join(f"`{SETTINGS[key].flag} {word(value)}`" for key, value in added.items()) or "`--preset paper`"
        step = found[name]
        rows.append((words, switched, f"{step['records']:,}", f"{step['error']:.1f} %", f"{round(step['bias'], 1) + 0.0:+.1f} %"))
    return table(("added", "setting", "records", "RMSE", "bias"), rows)


def sums(scene: str = "cornell-paper") -> None:
    """Pictures of how the published program added direct and indirect light, and of the sum that is meant."""
    found = irrsplat.render(irrsplat.load(scene), (SIZE, SIZE), preset="paper", **SHARED)
    direct = np.clip(found.direct, 0.0, 1.0)  # eight bits have no more, and nothing was exposed
    save("sum_published", np.clip(found.indirect / DARKER + 0.5 * direct, 0.0, 1.0))
    frame = irrsplat.render(irrsplat.load(scene), (SIZE, SIZE), bounces=1)
    save("sum_ours", frame.picture)


def shares() -> dict[str, Any]:
    """Measure the share of indirect light in percent, by luminance over all pixels, and the ratio of all bounces to one."""
    found = {}
    for scene in ("cornell", "cornell-paper", "curved", "door", "atrium"):
        loaded = irrsplat.load(scene)
        one = irrsplat.render(loaded, (200, 200), bounces=1)
        every = irrsplat.render(loaded, (200, 200))
        seen = np.isfinite(every.depth)
        direct, first, all_of_it = (float((b @ LUMINANCE)[seen].mean()) for b in (every.direct, one.indirect, every.indirect))
        shares = {"1": 100 * first / (direct + first), "all": 100 * all_of_it / (direct + all_of_it)}
        found[scene] = {**shares, "ratio": all_of_it / first}
    return found


def shares_table(found: dict[str, Any]) -> str:
    """Return a row for each scene."""
    rows = [
        (f"`{scene}`", f"{one['1']:.0f} %", f"{one['all']:.0f} %", f"{one['ratio']:.2f}")
        for scene, one in found.items()
        if isinstance(one, dict)
    ]
    return table(("scene", "indirect, one bounce", "indirect, all bounces", "ratio, all to one"), rows)


def radii() -> dict[str, Any]:
    """Measure the reach of records in `cornell`, near edges of the room and away from them: number, and median of R in metres."""
    scene = irrsplat.load("cornell")
    frame = irrsplat.render(scene, (SIZE, SIZE), bounces=1)
    places = np.concatenate([mesh.positions for mesh in scene.meshes])
    gaps = np.sort(np.minimum(frame.records_position - places.min(0), places.max(0) - frame.records_position), axis=1)
    corner = gaps[:, 1]  # metres from the second nearest wall: the nearest is the record's own
    found = {}
    for words, least, most in (
        ("less than 0.2 m", -np.inf, 0.2),
        ("0.2 to 0.5 m", 0.2, 0.5),
        ("0.5 to 1 m", 0.5, 1.0),
        ("farther", 1.0, np.inf),
    ):
        chosen = (corner >= least) & (corner < most)
        found[words] = {"records": int(chosen.sum()), "radius": float(np.median(frame.records_radius[chosen]))}
    return found


def radii_table(found: dict[str, Any]) -> str:
    """Return a row for each distance."""
    rows = [(words, f"{one['records']}", f"{one['radius']:.2f} m") for words, one in found.items() if isinstance(one, dict)]
    return table(("distance from the nearest wall", "records", "median of R"), rows)


if __name__ == "__main__":
    IMAGES.mkdir(parents=True, exist_ok=True)
    sums()
    ladder(pictures=True)
