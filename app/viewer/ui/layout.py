"""Where the windows of the interface stand, and how they look: what they share so that they do not overlap."""

from __future__ import annotations

from dataclasses import dataclass

from imgui_bundle import imgui

from irrsplat.app.viewer.buffers.tiles import Margins

MARGIN = 8.0  # window coordinates around what stands over the picture
MENU_BAR = 30.0  # window coordinates at scale 1 that the menu bar takes
STATISTICS_WIDTH = 212.0  # at least, of times and numbers
PANEL_WIDTH = 346.0  # of the panels, window coordinates at scale 1
_FREE = 0.35  # of the window's width that must stay free for what stands clear of the panels
WIDGET_WIDTH = 128.0  # of a slider, window coordinates at scale 1
AMBER, RED, WHITE = (0.98, 0.67, 0.30, 1.0), (0.75, 0.2, 0.15, 0.92), (1.0, 1.0, 1.0, 1.0)
PLAIN = (  # a window without a frame, that cannot be moved and never takes the keyboard
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
    | imgui.WindowFlags_.no_move
)


@dataclass
class Layout:
    """What windows took in the last frame, window coordinates, for others to keep clear of. scale: of text and widgets."""

    scale: float = 1.0
    legend_height: float = 0.0
    panel_right: float = 0.0  # where the settings' panel ends
    legend_right: float = 0.0  # where the left side's legend ends
    hints_height: float = 0.0  # that the line at the bottom takes where it reaches under the statistics
    statistics_size: tuple[float, float] = (0.0, 0.0)

    def margins(self, panel: bool, numbers: bool, hidden: bool) -> Margins:
        """What the settings' `panel`, the `numbers`, the menu bar and the legend take of the window, where they are open: so that
        what fills the picture can stand clear of them. Where that leaves too little, it is the height alone that counts."""
        view = imgui.get_main_viewport().size
        if hidden:
            return Margins()
        left = self.panel_right + MARGIN if panel and self.panel_right < 0.5 * view.x else 0.0
        right = self.statistics_size[0] + 2.0 * MARGIN if numbers else 0.0
        beside = left > self.legend_right
        if view.x - max(left, self.legend_right) - right < _FREE * view.x:
            left = right = 0.0
            beside = False
        bottom = 0.0 if beside else self.legend_height / view.y
        return Margins(max(left, 0.0) / view.x, right / view.x, MENU_BAR * self.scale / view.y, bottom)

    def place_panel(self, column: int, tall: bool = False, numbers: bool = False) -> None:
        """Place the next window below the menu bar at first, in a column of panels, and keep it above the legends. tall: it takes
        all the height that there is, until the user makes it another. numbers: those stand at the right."""
        view, top = imgui.get_main_viewport(), MENU_BAR * self.scale
        left, width = (MARGIN + column * PANEL_WIDTH) * self.scale, PANEL_WIDTH * self.scale
        if view.size.x > 1.5 * width:  # else it would cover the picture
            left = min(left, view.size.x - width)
        imgui.set_next_window_pos((left, top), imgui.Cond_.first_use_ever)
        height = max(view.size.y - top - self.legend_height, 40.0)
        least = (120.0, 40.0) if tall else (0.0, 0.0)
        imgui.set_next_window_size_constraints(least, (max(min(2.0 * PANEL_WIDTH * self.scale, view.size.x), 120.0), height))
        if tall:
            beside = view.size.x - 2.0 * MARGIN - (STATISTICS_WIDTH * self.scale + MARGIN if numbers else 0.0)
            width = min(PANEL_WIDTH * self.scale - MARGIN, max(beside, 0.3 * view.size.x))
            imgui.set_next_window_size((width, height), imgui.Cond_.first_use_ever)

    def keep_inside(self) -> None:
        """Move the present window back where a part of it stands outside of the main one, which may be smaller than last time."""
        view, place, size = imgui.get_main_viewport(), imgui.get_window_pos(), imgui.get_window_size()
        top = MENU_BAR * self.scale
        x = max(min(place.x, view.size.x - size.x), 0.0)
        y = max(min(place.y, view.size.y - size.y), min(top, place.y) if place.y >= 0.0 else 0.0)
        if (x, y) != (place.x, place.y):
            imgui.set_window_pos((x, y))


def accent() -> tuple[float, float, float, float]:
    """The colour of what stands out in text, by the theme."""
    colour = imgui.get_style_color_vec4(imgui.Col_.check_mark)
    return colour.x, colour.y, colour.z, colour.w


def in_unit(text: str, unit: str) -> str:
    """A number with its unit, where it has one."""
    return text if unit == "1" else f"{text} {unit}"
