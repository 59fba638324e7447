"""Render the pictures in docs/images: the paper's figures 1 to 6, some bundled scenes, slopes of irradiance."""

from __future__ import annotations

import re
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

import irrsplat
from irrsplat.core.color import LUMINANCE, srgb
from irrsplat.image.frame import Frame
from irrsplat.scene import bundled

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"
PAPER = "cornell-paper"  # the scene of the paper's figures
SIDE = 400  # pixels, as shown
RENDERED = 800  # pixels, then halved: four samples a pixel
LIMIT = 200_000  # bytes a picture


def keep(picture: Path, name: str) -> None:
    """Store `picture`, downsized, as docs/images/`name`, with fewer colours where it would be over the limit."""
    target = IMAGES / name
    with Image.open(picture) as full:
        small = full.convert("RGB").resize((SIDE, SIDE * full.height // full.width), Image.Resampling.LANCZOS)
    small.save(target, optimize=True)
    if target.stat().st_size > LIMIT:
        small.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(target, optimize=True)
    assert target.stat().st_size <= LIMIT, f"{target} has {target.stat().st_size} bytes"
    print(f"{target.name}: {target.stat().st_size // 1000} kB")


def shown() -> tuple[list[str], list[str]]:
    """Return the file names of the paper's figures and the names of bundled scenes that README and docs show."""
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "README.md", *sorted(IMAGES.parent.rglob("*.md"))))
    names = list(dict.fromkeys(re.findall(r"[(/]images/([\w/-]+)\.png\)", pages)))
    figures = [f"{name}.png" for name in names if name.startswith("paper/")]
    return figures, [name for name in names if name in bundled()]


def slope(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """|∇E| (H, W) of the irradiance's luminance along the surface, W/m³, and where (H, W): not at edges of surfaces.

    By central differences on screen: with ∂p and ∂E of a step in x and in y, ∇E = g·∂p where g solves (∂p·∂pᵀ)·g = ∂E.
    """
    E = frame.irradiance @ LUMINANCE
    (E_y, E_x), (p_y, p_x, _) = np.gradient(E), np.gradient(frame.position)
    xx, xy, yy = (p_x * p_x).sum(-1), (p_x * p_y).sum(-1), (p_y * p_y).sum(-1)
    squared = (yy * E_x**2 - 2.0 * xy * E_x * E_y + xx * E_y**2) / np.maximum(xx * yy - xy**2, 1e-30)
    off = np.abs(np.stack([(step * frame.normal).sum(-1) for step in (p_x, p_y)])).max(0)
    turn = np.abs(np.stack(np.gradient(frame.normal, axis=(0, 1)))).max((0, -1))
    even = np.isfinite(frame.depth) & (turn < 0.1) & (off < 0.2 * np.sqrt(np.maximum(xx, yy)))
    return np.sqrt(np.maximum(squared, 0.0)), even


def rims(scene: str) -> None:
    """Store the slope of the paper's irradiance and of ours, on one scale, as docs/images/rims_….png: a rim is a line."""
    found = {}
    for preset in ("default", "paper"):
        found[preset] = slope(irrsplat.render(irrsplat.load(scene), (SIDE, SIDE), preset=preset, bounces=1))
    values, even = found["default"]
    white = np.percentile(values[even], 98)
    for preset, (values, even) in found.items():
        target = IMAGES / f"rims_{preset}.png"
        Image.fromarray((255.0 * srgb(np.where(even, values / white, 0.0)) + 0.5).astype(np.uint8)).save(target, optimize=True)
        assert target.stat().st_size <= LIMIT, f"{target} has {target.stat().st_size} bytes"
        print(f"{target.name}: {target.stat().st_size // 1000} kB")


def main() -> None:
    """Render and store everything."""
    IMAGES.mkdir(exist_ok=True)
    figures, scenes = shown()
    rims("cornell")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for scene in [PAPER, *scenes]:
            start = time.perf_counter()
            with irrsplat.Renderer(irrsplat.load(scene), size=(RENDERED, RENDERED)) as renderer:
                frame = renderer.render(figures=scene == PAPER)
            print(f"{scene}: {frame.stats['records']} records, {time.perf_counter() - start:.1f} s")
            if scene == PAPER:
                frame.save(folder / "paper")
                for figure in figures:
                    keep(folder / figure, figure)
            if scene in scenes:
                frame.save(folder / f"{scene}.png")
                keep(folder / f"{scene}.png", f"{scene}.png")


if __name__ == "__main__":
    main()
