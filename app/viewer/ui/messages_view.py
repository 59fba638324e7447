"""Messages at the top of the picture; errors are red, and have a button that closes them."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from irrsplat.app.viewer.messages import Message, Messages
from irrsplat.app.viewer.ui.layout import MARGIN, PLAIN, RED, WHITE, Layout


def draw_waiting(text: str) -> None:
    """Draw a line in the middle of the window."""
    imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.begin("waiting", None, PLAIN | imgui.WindowFlags_.no_inputs)
    imgui.text_unformatted(text)
    imgui.end()


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
