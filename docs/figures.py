"""Makes the README's pictures again: the paper's figures 1 to 6 and a picture of each bundled scene, in docs/images."""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

import irrsplat
from irrsplat.scene import bundled

IMAGES = Path(__file__).resolve().parent / "images"
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


def main() -> None:
    """Render and store everything."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with irrsplat.Renderer(irrsplat.load("cornell-paper"), size=(RENDERED, RENDERED)) as renderer:
            renderer.render(figures=True).save(folder / "paper")
        for picture in sorted((folder / "paper").glob("figure*.png")):
            keep(picture, picture.name)
        for scene in bundled():
            irrsplat.render(irrsplat.load(scene), size=(RENDERED, RENDERED)).save(folder / f"{scene}.png")
            keep(folder / f"{scene}.png", f"{scene}.png")


if __name__ == "__main__":
    main()
