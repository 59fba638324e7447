"""The interface over the picture: all its parts in their order, and messages at the top."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.messages import Message, Messages
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.handles import draw_handles
from irrsplat.app.viewer.ui.layout import MARGIN, PLAIN, RED, WHITE, Box, Layout
from irrsplat.app.viewer.ui.legends import draw_legends, draw_record
from irrsplat.app.viewer.ui.line_plot import draw_line, draw_plot
from irrsplat.app.viewer.ui.menus import draw_context_menu, draw_menus
from irrsplat.app.viewer.ui.panels.editing_panels import draw_rings
from irrsplat.app.viewer.ui.panels.light_panels import draw_sight_lines, draw_values
from irrsplat.app.viewer.ui.prompt_view import PromptView
from irrsplat.app.viewer.ui.side_panel import SidePanel


def draw_messages(messages: Messages, layout: Layout) -> None:
    """Draw the lines on show, clear of the side panel; open menus and dialogs stay in front of them."""
    left, top, right, _ = layout.area
    place, width = 0.5 * (left + right), right - left - 2.0 * MARGIN
    if messages.errors:
        imgui.push_style_color(imgui.Col_.window_bg, RED)
        imgui.push_style_color(imgui.Col_.text, WHITE)
        top += _lines("errors", messages.errors, (place, top), width, PLAIN, messages.close_errors)
        imgui.pop_style_color(2)
    if notices := [line for line in messages.lines if not line.error]:
        _lines("messages", notices, (place, top), width, PLAIN | imgui.WindowFlags_.no_inputs)


def _lines(
    name: str, lines: list[Message], place: tuple[float, float], width: float, flags: int, close: Callable[[], None] | None = None
) -> float:
    """Draw lines in a window of their own, centred at a place; return its height. close: what its button does."""
    imgui.set_next_window_pos(place, imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_size_constraints((0.0, 0.0), (max(width, 1.0), imgui.get_main_viewport().size.y))
    imgui.begin(name, None, flags | imgui.WindowFlags_.no_bring_to_front_on_focus)
    imgui.push_text_wrap_pos(width - 2.0 * imgui.get_style().window_padding.x)
    for line in lines:
        imgui.text_wrapped(line.text)
    imgui.pop_text_wrap_pos()
    if close is not None and imgui.small_button("close"):
        close()
    height = imgui.get_window_height()
    imgui.end()
    return height


class Interface:
    """The windows that are open; call `draw` between the backend's `begin` and `draw`."""

    def __init__(self, actions: Actions, display: Display) -> None:
        self.actions, self.display, self.layout = actions, display, Layout()
        self.prompt = PromptView()
        self.side_panel = SidePanel(actions, display, self.layout)

    def draw(
        self,
        scale: float,
        inspected: InspectedRecord | None,
        cursor: tuple[int, int] | None,
        own_cursor: bool,
        paint: Callable[[Box], None] | None = None,
    ) -> None:
        """Draw all windows. scale: of text and widgets. cursor: the pixel under the mouse. own_cursor: show an arrow there.
        paint: puts the picture below all else."""
        actions, panels, layout, display = self.actions, self.actions.panels, self.layout, self.display
        layout.start(scale, panels.controls and not panels.hidden)
        if paint is not None:
            paint(layout.picture)
        actions.editor.handles_used = actions.editor.dragging = False
        if panels.close_menus:
            imgui.internal.close_popups_except_modals()
            panels.close_menus = False
        if not panels.hidden:
            if display.shows_scene:
                draw_rings(actions, layout)
                draw_values(actions, layout)
                draw_sight_lines(actions, display, layout)
                draw_handles(actions, layout)
                draw_line(actions, layout)
            draw_menus(actions)
            draw_context_menu(actions)
            self.side_panel.draw()
            draw_legends(actions, display, layout, cursor)
            if inspected is not None:
                draw_record(inspected, layout)
            draw_plot(actions, display, layout)
        self.prompt.draw(actions, layout)
        if not imgui.is_any_item_active() and not imgui.is_mouse_down(imgui.MouseButton_.left):
            actions.editor.settle()
        actions.messages.expire()
        if not panels.hidden or actions.messages.errors:
            draw_messages(actions.messages, layout)
        if own_cursor:
            imgui.set_mouse_cursor(imgui.MouseCursor_.arrow)
