"""Options of the picture and of the interface, as plain values."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float, float]
Surface = tuple[Point, Point]  # a point and its unit normal

SECTIONS = ("settings", "lights", "outliner", "why", "plane")  # the optional sections of the side panel


@dataclass
class ViewOptions:
    """Options of the picture (buffer, split, overlays, measurements), and the open parts of the interface."""

    buffer: str = "image"
    split: bool = False  # True if two presets are shown side by side
    side: int = 0  # the side that keys and panels change
    divider: float = 0.5  # share of the window's width; at 0 or 1, one side fills the picture
    discs: bool = False
    inspect: bool = False
    profile: bool = False  # True if buffers are measured along a line
    line: tuple[Point, Point] | None = None  # the measuring line
    plane: bool = False  # True if a horizontal plane is measured
    why: bool = False  # True if a click on a surface shows the sources of its light
    surface: Surface | None = None  # the surface of the last such click
    frozen: bool = False
    controls: bool = True  # the side panel; without it the picture fills the window
    settings: bool = False
    lights: bool = False
    outliner: bool = False
    hidden: bool = False
    close_menus: bool = False  # True if menus and lists close in the next frame
    context_menu: bool = False  # True if it opens in the next frame
    sought: str = ""  # the setting to which the list of settings scrolls
