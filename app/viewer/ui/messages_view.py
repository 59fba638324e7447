"""Messages at the top in the middle; errors are red, and have a button that closes them."""

from __future__ import annotations

import time

from imgui_bundle import imgui

from irrsplat.app.viewer.messages import Messages
from irrsplat.app.viewer.ui.layout import PLAIN, RED, WHITE, Layout


def draw_waiting(text: str) -> None:
    """Draw a line in the middle of the window: what it waits for."""
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos((0.5 * view.size.x, 0.5 * view.size.y), imgui.Cond_.always, (0.5, 0.5))
    imgui.begin("waiting", None, PLAIN | imgui.WindowFlags_.no_inputs)
    imgui.text_unformatted(text)
    imgui.end()


def draw_messages(messages: Messages, layout: Layout) -> None:
    """Draw the lines on show."""
    if not messages.lines:
        return
    view, (left, top, right, _) = imgui.get_main_viewport(), layout.area
    imgui.set_next_window_pos((0.5 * (left + right), top), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_size_constraints((0.0, 0.0), (0.9 * view.size.x, view.size.y))
    errors, now = messages.errors, time.monotonic()
    if errors:
        imgui.push_style_color(imgui.Col_.window_bg, RED)
        imgui.push_style_color(imgui.Col_.text, WHITE)
    else:
        imgui.set_next_window_bg_alpha(0.9 * max(message.opacity(now) for message in messages.lines))
    imgui.begin("messages", None, PLAIN | (0 if errors else imgui.WindowFlags_.no_inputs))
    imgui.push_text_wrap_pos(0.85 * view.size.x)
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
