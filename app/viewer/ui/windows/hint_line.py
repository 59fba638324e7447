"""One line at the bottom in the middle: hints for the first minute, and what to do where the camera has lost the scene."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import MARGIN, PLAIN, Layout, accent

_LOST = "you are outside the scene, Home takes you back"
_NARROW = 150.0  # window coordinates at scale 1: with less room beside the legend, the line stands above it


def draw_hints(actions: Actions, layout: Layout, lost: bool) -> None:
    """Draw the line where there is anything to say, clear of the legends. lost: the camera sees nothing of the scene."""
    hints = actions.hints.line
    layout.hints_height = 0.0
    if not hints and not lost:
        return
    view, (first, _, last, lowest) = imgui.get_main_viewport(), layout.area
    padding, bottom = imgui.get_style().window_padding.x, lowest - MARGIN
    left = layout.legend_right + MARGIN
    if actions.session.options.split != "off" or last - MARGIN - left < _NARROW * layout.scale:
        left, bottom = first + MARGIN, view.size.y - layout.legend_height
    room = max(last - MARGIN - left, 0.0)
    longest = max(imgui.calc_text_size(text).x for text in (hints, _LOST if lost else ""))
    width = min(longest + 2.0 * padding, room)
    place = min(max(0.5 * (first + last - width), left), last - MARGIN - width)
    imgui.set_next_window_pos((place, bottom), imgui.Cond_.always, (0.0, 1.0))
    imgui.set_next_window_bg_alpha(0.72)
    imgui.begin("hints", None, PLAIN | imgui.WindowFlags_.no_inputs)
    imgui.push_text_wrap_pos(width - padding + 1.0)
    if lost:
        imgui.push_style_color(imgui.Col_.text, accent())
        imgui.text_wrapped(_LOST)
        imgui.pop_style_color()
    if hints:
        imgui.text_wrapped(hints)
    imgui.pop_text_wrap_pos()
    if place + width > last - layout.statistics_size[0] - 2.0 * MARGIN:
        layout.hints_height = view.size.y - imgui.get_window_pos().y
    imgui.end()
