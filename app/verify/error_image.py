"""Pictures of a comparison: signed error of irradiance in colours, and the file of verify."""

from __future__ import annotations

import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.core import files
from irrsplat.reference.truth import Traced


def signed_error(irradiance: np.ndarray, truth: Traced) -> np.ndarray:
    """Return display colours (H, W, 3) in 0..1 of the error of `irradiance` (H, W, 3), averaged over the channels.

    White is exact, red too bright, blue too dark, saturated at FULL of the reference's mean; grey is background.
    """
    mean = float(truth.irradiance[truth.valid].mean()) or 1.0
    error = (irradiance - truth.irradiance).mean(axis=-1) / (FULL * mean)
    return np.where(truth.seen[..., None], error_colours(error), np.array(GREY) / 255.0)


def write(name: str, expected: np.ndarray, picture: np.ndarray, error: np.ndarray) -> None:
    """Write a .png with reference, picture and error (H, W, 3) side by side, and the scale of `signed_error` below."""
    from PIL import Image

    from irrsplat.image.figures.legend import legend_height, write_legend

    share = f"{100.0 * FULL:g} % of the mean irradiance or more"
    lines = ((BRIGHT, f"too bright by {share}"), (DARK, f"too dark by {share}"), (GREY, "no surface; white is right"))
    strip = np.concatenate([expected, picture, error], axis=1)
    height, width = strip.shape[:2]
    font = min(max(width / 28.0, 9.0), 16.0)
    image = Image.new("RGB", (width, height + legend_height(font, lines)), (255, 255, 255))
    image.paste(Image.fromarray(files.eight_bits(strip)))
    write_legend(image, height, font, lines)
    files.write_picture(name, np.asarray(image) / 255.0)
