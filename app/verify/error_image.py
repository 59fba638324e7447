"""Pictures of a comparison: signed error of irradiance in colours, FLIP's map, and the files of verify."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.core import files
from irrsplat.core.errors import IrrsplatError
from irrsplat.image import frame
from irrsplat.reference.truth import Traced

PIXELS_PER_DEGREE = 67.0  # for FLIP: a screen 0.7 m wide with 3840 pixels, seen from 0.7 m


def flip(truth: np.ndarray, picture: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Return FLIP (Andersson et al. 2020) of two (H, W, 3) display images 0..1: its map as (H, W, 3) colours, and its mean.

    None without the package `flip-evaluator`.
    """
    try:
        import flip_evaluator
    except ImportError:
        return None
    one, other = (np.ascontiguousarray(it, np.float32) for it in (truth, picture))
    shown, mean, _ = flip_evaluator.evaluate(one, other, "LDR", parameters={"ppd": PIXELS_PER_DEGREE})
    return np.asarray(shown), float(mean)


def signed_error(irradiance: np.ndarray, truth: Traced) -> np.ndarray:
    """Return display colours (H, W, 3) in 0..1 of the error of `irradiance` (H, W, 3), averaged over the channels.

    White is exact, red too bright, blue too dark, saturated at FULL of the reference's mean; grey is background.
    """
    mean = float(truth.irradiance[truth.valid].mean()) or 1.0
    error = (irradiance - truth.irradiance).mean(axis=-1) / (FULL * mean)
    return np.where(truth.seen[..., None], error_colours(error), np.array(GREY) / 255.0)


def write(name: str, shown: tuple[np.ndarray, np.ndarray], error: np.ndarray, flipped: np.ndarray | None) -> None:
    """Write a .png with reference, picture and error side by side, or a folder with one of each, and FLIP's map."""
    if frame.check_writable(name):
        files.write_picture(name, _with_legend(np.concatenate([*shown, error], axis=1)))
        return
    pictures = {"reference": shown[0], "picture": shown[1], "error": _with_legend(error)} | (
        {} if flipped is None else {"flip": flipped}
    )
    try:
        Path(name).mkdir(exist_ok=True)
    except OSError as failed:
        raise IrrsplatError(f"{name}: cannot write: {failed.strerror or failed}") from failed
    for stem, picture in pictures.items():
        files.write_picture(Path(name) / f"{stem}.png", picture)


def _with_legend(picture: np.ndarray) -> np.ndarray:
    """Append the scale of `signed_error` below a picture (H', W, 3)."""
    from PIL import Image

    from irrsplat.image.figures.legend import legend_height, write_legend

    share = f"{100.0 * FULL:g} % of the mean irradiance or more"
    lines = ((BRIGHT, f"too bright by {share}"), (DARK, f"too dark by {share}"), (GREY, "no surface; white is right"))
    height, width = picture.shape[:2]
    font = min(max(width / 28.0, 9.0), 16.0)
    image = Image.new("RGB", (width, height + legend_height(font, lines)), (255, 255, 255))
    image.paste(Image.fromarray(np.round(picture * 255.0).astype(np.uint8)))
    write_legend(image, height, font, lines)
    return np.asarray(image) / 255.0
