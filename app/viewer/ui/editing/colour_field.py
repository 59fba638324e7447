"""A colour field: sRGB for the user, linear light for the scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imgui_bundle import imgui

from irrsplat.core.color import linear_from_srgb, srgb


def edit_colour(label: str, linear: Sequence[float]) -> tuple[bool, tuple[float, float, float]]:
    """Draw the field of a linear colour, with 0..255 and hex values in sRGB. Return True if it was changed, and the colour.

    A component above 1 sets the scale: the field shows the colour relative to the largest component.
    """
    scale = max(1.0, *linear)
    shown = srgb(np.asarray(linear, float) / scale).tolist()
    changed, values = imgui.color_edit3(label, shown)
    red, green, blue = (scale * linear_from_srgb(np.clip(values, 0.0, 1.0))).tolist() if changed else linear
    return changed, (red, green, blue)
