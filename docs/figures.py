"""Makes the README's pictures again, in docs/images: the paper's figures 1 to 6, and the bundled scenes that it shows."""

from __future__ import annotations

import re
import tempfile
import time
from pathlib import Path

from PIL import Image

import irrsplat

ROOT = Path(__file__).resolve().parent.parent
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
    """What the README shows: the file names of the paper's figures, and the names of bundled scenes."""
    names = re.findall(r"\(docs/images/([\w-]+)\.png\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    figures = [f"{name}.png" for name in names if name.startswith("figure")]
    return figures, [name for name in names if not name.startswith(("figure", "view"))]


def main() -> None:
    """Render and store everything."""
    IMAGES.mkdir(exist_ok=True)
    figures, scenes = shown()
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
                    keep(folder / "paper" / figure, figure)
            if scene in scenes:
                frame.save(folder / f"{scene}.png")
                keep(folder / f"{scene}.png", f"{scene}.png")


if __name__ == "__main__":
    main()
