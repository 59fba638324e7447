"""Options of the view, and the open parts of the interface: plain values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
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
KEPT = ("points", "discs", "wire", "controls", "settings", "lights", "outliner")  # from one session to the next
_INTERFACE = (
    "controls",
    "settings",
    "lights",
    "outliner",
    "hidden",
    "fullscreen",
    "close_menus",
    "context_menu",
    "sought",
    "scale",
)
_OTHERWISE = ("buffers", "line", "surface")  # reach the picture by its sides, and by what is drawn over it
SECTIONS = ("settings", "lights", "outliner", "why", "plane")  # of the side panel


def point_of(values: np.ndarray | Sequence[float]) -> Point:
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


@dataclass
class ViewOptions:
    """The buffers on show, the split, overlays, what is measured, and the open parts of the interface."""

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

    def of_picture(self) -> dict[str, object]:
        """Return the options that the picture depends on directly. Parts of the interface open without a new picture."""
        return {name: value for name, value in vars(self).items() if name not in (*_INTERFACE, *_OTHERWISE)}

    def kept(self) -> dict[str, object]:
        """Return what is on of all that is kept from one session to the next, plain JSON."""
        return {name: getattr(self, name) for name in KEPT}

    def restore(self, choices: dict[str, object]) -> None:
        """Set the choices of an earlier session."""
        for name in KEPT:
            setattr(self, name, bool(choices.get(name, getattr(self, name))))
