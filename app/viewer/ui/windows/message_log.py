"""The window of all messages that there were, the newest last."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import DIALOG, accent

_SIZE = (420.0, 220.0)  # at first, window coordinates


def draw_log(actions: Actions) -> None:
    """Draw it where it is open; errors stand out."""
    if not actions.panels.log:
        return
    view = imgui.get_main_viewport()
    size = (min(_SIZE[0], 0.9 * view.size.x), min(_SIZE[1], 0.7 * view.size.y))
    imgui.set_next_window_size(size, imgui.Cond_.appearing)
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
    shown, opened = imgui.begin("messages so far", True, DIALOG | imgui.WindowFlags_.no_saved_settings)
    actions.panels.log = bool(opened)
    if shown:
        for time, message in actions.messages.log:
            imgui.text_disabled(time)
            imgui.same_line()
            if message.error:
                imgui.push_style_color(imgui.Col_.text, accent())
            imgui.text_wrapped(message.text)
            if message.error:
                imgui.pop_style_color()
        if not actions.messages.log:
            imgui.text_disabled("none yet")
        if imgui.is_window_appearing():
            imgui.set_scroll_here_y(1.0)
    imgui.end()
