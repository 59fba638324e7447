"""Where the windows of the interface stand, and how they look: what they share so that they do not overlap."""

from __future__ import annotations

from dataclasses import dataclass

from imgui_bundle import imgui

MARGIN = 8.0  # window coordinates around what stands over the picture
MENU_BAR = 30.0  # window coordinates at scale 1 that the menu bar takes
PANEL_WIDTH = 268.0  # of the panels, window coordinates at scale 1
WIDGET_WIDTH = 128.0  # of a slider, window coordinates at scale 1
AMBER, RED = (0.98, 0.67, 0.30, 1.0), (0.75, 0.2, 0.15, 0.92)
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
    statistics_size: tuple[float, float] = (0.0, 0.0)

    def place_panel(self, column: int) -> None:
        """Place the next window below the menu bar at first, in a column of panels, and keep it above the legends."""
        view, top = imgui.get_main_viewport(), MENU_BAR * self.scale
        imgui.set_next_window_pos(((MARGIN + column * PANEL_WIDTH) * self.scale, top), imgui.Cond_.first_use_ever)
        height = max(view.size.y - top - self.legend_height, 40.0)
        imgui.set_next_window_size_constraints((0.0, 0.0), (2.0 * PANEL_WIDTH * self.scale, height))


def in_unit(text: str, unit: str) -> str:
    """A number with its unit, where it has one."""
    return text if unit == "1" else f"{text} {unit}"
