"""The areas of the window, and shared styles."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from imgui_bundle import imgui

from irrsplat.app.viewer.editing.objects import on_screen
from irrsplat.scene.model import Camera

MARGIN = 8.0  # window coordinates: the space around windows over the picture
_PANEL, _SHARE = 300.0, 0.42  # width of the side panel, window coordinates at scale 1; its greatest share of the window
_NAMES = 7.5  # font heights: the width of the names of widgets
_NARROWEST = 80.0  # window coordinates at scale 1: names stand above widgets if these would be narrower
_LEAST_PICTURE = 32.0  # window coordinates: if the area is smaller, the picture fills the window
AMBER, RED, WHITE = (0.98, 0.67, 0.30, 1.0), (0.75, 0.2, 0.15, 0.92), (1.0, 1.0, 1.0, 1.0)
SHADE = (0.0, 0.0, 0.0, 0.55)  # the outline of bright marks over the picture
PLAIN = (  # a window without a frame that cannot be moved and never takes the keyboard
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
    | imgui.WindowFlags_.no_move
)
Box = tuple[float, float, float, float]  # left, top, right, bottom; window coordinates


@dataclass
class Layout:
    """The parts of the window in this frame. scale: the scale of text and widgets.

    area: the window without the menu bar and the side panel. picture: the area, or the whole window if no side panel is open.
    panel: width of the side panel, window coordinates.
    """

    scale: float = 1.0
    area: Box = (0.0, 0.0, 0.0, 0.0)
    picture: Box = (0.0, 0.0, 0.0, 0.0)
    panel: float = 0.0

    def start(self, scale: float, fitted: bool) -> None:
        """Start a frame. fitted: True if the picture is fitted into the area."""
        view = imgui.get_main_viewport()
        (x, y), (width, height) = view.work_pos, view.work_size
        self.scale, self.panel = scale, float(round(min(_PANEL * scale, _SHARE * view.size.x)))
        self.area = (x, y, x + max(width, 0.0), y + max(height, 0.0))
        self.picture = self.area if fitted and min(width, height) >= _LEAST_PICTURE else (0.0, 0.0, view.size.x, view.size.y)

    @property
    def picture_size(self) -> tuple[float, float]:
        """Width and height of the picture, window coordinates."""
        return self.picture[2] - self.picture[0], self.picture[3] - self.picture[1]

    @property
    def widget(self) -> float:
        """Width of a widget in the side panel, window coordinates."""
        return self.room if self.stacked else self.room - _NAMES * imgui.get_font_size()

    @property
    def room(self) -> float:
        """Width of a line in the side panel, window coordinates."""
        style = imgui.get_style()
        return self.panel - 2.0 * style.window_padding.x - style.scrollbar_size

    @property
    def stacked(self) -> bool:
        """True if the panel is so narrow that names stand above their widgets."""
        return self.panel - (_NAMES + 2.0) * imgui.get_font_size() < _NARROWEST * self.scale

    def chosen(self, title: str, now: bool, number: int) -> bool:
        """Draw an entry of a list, which shows a long title in full under the mouse. Return True if the user chose it."""
        clicked = imgui.selectable(f"{title}##{number}", now)[0]
        if imgui.calc_text_size(title).x > self.room:
            imgui.set_item_tooltip(title)
        return bool(clicked)

    def label(self, name: str) -> str:
        """Return the label of a widget; draw its name above it if names are stacked."""
        if self.stacked:
            imgui.text_unformatted(name.split("##")[0])
        return f"##{name}" if self.stacked else name

    def seen(self, camera: Camera, point: tuple[float, float, float]) -> tuple[float, float] | None:
        """Return the place of a world point in the window, in window coordinates; None behind the eye."""
        found = on_screen(camera, self.picture_size, point)
        return None if found is None else (found[0] + self.picture[0], found[1] + self.picture[1])

    @contextmanager
    def over_picture(self) -> Iterator[imgui.ImDrawList]:
        """Yield a draw list that is clipped to the picture, below all windows."""
        draw = imgui.get_background_draw_list()
        draw.push_clip_rect(self.picture[:2], self.picture[2:])
        yield draw
        draw.pop_clip_rect()

    def pixels(self, density: float, size: tuple[int, int]) -> tuple[int, int, int, int]:
        """Return the picture's part of a window of `size` pixels: left, top, width, height. density: pixels per coordinate."""
        if self.picture[:2] == (0.0, 0.0):  # the picture fills the window, or this is before the first frame
            return 0, 0, *size
        left, top, right, bottom = (round(density * x) for x in self.picture)
        return left, top, max(min(right, size[0]) - left, 1), max(min(bottom, size[1]) - top, 1)


def dot(draw: imgui.ImDrawList, place: tuple[float, float], colour: tuple[float, float, float, float]) -> None:
    """Draw a dot with a dark ring around it."""
    draw.add_circle_filled(place, 6.0, imgui.get_color_u32(SHADE))
    draw.add_circle_filled(place, 4.0, imgui.get_color_u32(colour))


def line(draw: imgui.ImDrawList, start: tuple[float, float] | None, end: tuple[float, float] | None, width: float = 1.5) -> None:
    """Draw an amber line with a dark outline. Draw nothing if an end is behind the eye."""
    if start is not None and end is not None:
        draw.add_line(start, end, imgui.get_color_u32(SHADE), width + 2.0)
        draw.add_line(start, end, imgui.get_color_u32(AMBER), width)


def in_unit(text: str, unit: str) -> str:
    return text if unit == "1" else f"{text} {unit}"
