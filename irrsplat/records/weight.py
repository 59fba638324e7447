"""How far records reach in a view: the radius a·R, kept within what the view allows."""

from __future__ import annotations

from typing import Any

import numpy as np

from irrsplat.scene.model import Camera
from irrsplat.settings import Settings, record_uniforms


def splat_radius(R: Any, distance: Any, camera: Camera, settings: Settings) -> np.ndarray:
    """The radius a·R in metres within radius_min and radius_max, as shaders/records/reach.glsl has it.

    R: what a record reaches by itself; distance: of the records from the eye; metres, any one shape.
    """
    percent = camera.screen * np.asarray(distance) / 100.0  # of the image height, in metres
    r = np.maximum(settings.a * np.asarray(R), settings.radius_min * percent)
    return np.minimum(r, settings.radius_max * percent) if settings.radius_max > 0.0 else r


def reach_uniforms(camera: Camera, settings: Settings) -> dict[str, Any]:
    """The uniforms of shaders/records/reach.glsl apart from the records'."""
    screen = camera.screen
    return {
        "eye": camera.eye,
        **record_uniforms(settings),
        "reach": (settings.radius_min / 100.0 * screen, settings.radius_max / 100.0 * screen),
    }
