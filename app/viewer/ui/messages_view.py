"""Messages at the top, clear of what else stands there; errors are red, and have a button that closes them."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.messages import Messages
from irrsplat.app.viewer.ui.layout import MARGIN, PLAIN, RED, WHITE, Layout, accent
from irrsplat.core.timing import clock


def draw_waiting(text: str) -> None:
    """Draw a line in the middle of the window: what it waits for."""
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos((0.5 * view.size.x, 0.5 * view.size.y), imgui.Cond_.always, (0.5, 0.5))
    imgui.begin("waiting", None, PLAIN | imgui.WindowFlags_.no_inputs)
    imgui.text_unformatted(text)
    imgui.end()


def draw_lost(layout: Layout) -> None:
    """Draw the way back in the middle of the lower edge, for a camera outside of the scene."""
    left, _, right, bottom = layout.area
    imgui.set_next_window_pos((0.5 * (left + right), bottom - MARGIN), imgui.Cond_.always, (0.5, 1.0))
    imgui.begin("lost", None, PLAIN | imgui.WindowFlags_.no_inputs)
    imgui.text_colored(accent(), "the camera is outside of the scene; Home leads back")
    imgui.end()


def draw_messages(messages: Messages, layout: Layout, numbers: bool, typing: bool) -> None:
    """Draw the lines on show, in front of all panels where there is no room beside them. numbers: whether those are on show.
    typing: a dialog is open that takes text, and stays in front."""
    if not messages.lines:
        return
    view, (left, right) = imgui.get_main_viewport(), layout.free_span(numbers)
    width = right - left - 2.0 * MARGIN
    imgui.set_next_window_pos((0.5 * (left + right), layout.area[1]), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_size_constraints((0.0, 0.0), (width, view.size.y))
    errors, now = messages.errors, clock.now()
    if errors:
        imgui.push_style_color(imgui.Col_.window_bg, RED)
        imgui.push_style_color(imgui.Col_.text, WHITE)
    else:
        imgui.set_next_window_bg_alpha(0.9 * max(message.opacity(now) for message in messages.lines))
    imgui.begin("messages", None, PLAIN | (0 if errors else imgui.WindowFlags_.no_inputs))
    if not typing:
        imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
    imgui.push_text_wrap_pos(width - 2.0 * imgui.get_style().window_padding.x)
    for message in messages.lines:
        imgui.push_style_var(imgui.StyleVar_.alpha, max(message.opacity(now), 0.01))
        imgui.text_wrapped(message.text)
        imgui.pop_style_var()
    imgui.pop_text_wrap_pos()
    if errors and imgui.small_button("close"):
        messages.close_errors()
    imgui.end()
    if errors:
        imgui.pop_style_color(2)
