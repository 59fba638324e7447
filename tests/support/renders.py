"""Pictures of bundled scenes for read-only use: each is rendered once for all tests."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Unpack

import numpy as np

import irrsplat
from irrsplat.image.frame import Frame
from irrsplat.settings import SettingValues
from tests.support.truth import SIZE


def rendered(
    name: str, size: tuple[int, int] = (SIZE, SIZE), preset: str = "default", **settings: Unpack[SettingValues]
) -> Frame:
    """Return the bundled scene from its first camera; its arrays are shared and read-only."""
    return _rendered(name, size, preset, tuple(sorted(settings.items())))


@cache
def _rendered(name: str, size: tuple[int, int], preset: str, settings: tuple[tuple[str, object], ...]) -> Frame:
    frame = irrsplat.render(irrsplat.load(name), size, preset=preset, **dict(settings))  # type: ignore[arg-type]
    for field in fields(frame):
        if isinstance(array := getattr(frame, field.name), np.ndarray):
            array.flags.writeable = False
    return frame
