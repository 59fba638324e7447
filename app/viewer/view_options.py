"""Options of the view, and the open parts of the interface: plain values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from irrsplat.meter.light_scale import LightScale

Point = tuple[float, float, float]
Surface = tuple[Point, Point]  # a point and its unit normal

Split = Literal["off", "buffers", "presets"]
SPLITS: dict[Split, str] = {  # and their titles
    "off": "one picture",
    "buffers": "two buffers",
    "presets": "two presets",
}

SCALES = (0.75, 2.0)  # least and greatest of the interface
SECTIONS = ("settings", "lights", "outliner", "why", "plane")  # of the side panel


def point_of(values: np.ndarray | Sequence[float]) -> Point:
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


@dataclass
class ViewOptions:
    """Options of the picture: the buffers, the split, overlays, and what is measured."""

    buffers: list[str] = field(default_factory=lambda: ["image", "irradiance"])  # of the left and of the right side
    split: Split = "off"
    side: int = 0  # that keys and panels change
    divider: float = 0.5  # of the window's width; at its ends one side fills the picture
    points: bool = False
    discs: bool = False
    wire: bool = False
    inspect: bool = False
    profile: bool = False  # whether lines are measured along
    line: tuple[Point, Point] | None = None  # that buffers are measured along
    plane: bool = False  # whether a horizontal plane is measured
    why: bool = False  # whether a click on a surface shows where its light comes from
    surface: Surface | None = None  # that was clicked on for this
    frozen: bool = False
    light_scale: LightScale = LightScale()  # it is frozen

    @property
    def copy(self) -> ViewOptions:
        """A copy of the present options, for a memo."""
        return replace(self, buffers=list(self.buffers))


@dataclass
class Panels:
    """The open parts of the interface; they need no new picture."""

    controls: bool = True  # the slim panel at the side; the picture is fitted into the rest, and fills the window without it
    settings: bool = False
    lights: bool = False
    outliner: bool = False
    hidden: bool = False
    fullscreen: bool = False
    close_menus: bool = False  # and lists, in the next frame
    context_menu: bool = False  # opens in the next frame
    sought: str = ""  # the setting that its list scrolls to
    scale: float = 1.0  # of text and widgets; the monitor has another one
