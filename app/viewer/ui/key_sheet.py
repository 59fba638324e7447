"""The sheet of all keys, made from the table of actions."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.commands import FLYING, GROUPS
from irrsplat.app.viewer.ui.layout import AMBER

_WIDTH = 500.0  # at most, window coordinates at scale 1
_KEYS = 8.0  # width of the column of keys, heights of the font


def draw_key_sheet(actions: Actions, scale: float) -> None:
    if not actions.panels.help:
        return
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((min(_WIDTH * scale, view.size.x), view.size.y))
    imgui.set_next_window_bg_alpha(0.97)
    shown, opened = imgui.begin("keys", True, imgui.WindowFlags_.no_collapse | imgui.WindowFlags_.no_saved_settings)
    actions.panels.help = bool(opened)
    if shown:
        groups = {menu: tuple((one.shown, one.words) for one in group) for menu, group in GROUPS.items()}
        for title, rows in {"Mouse and flight": FLYING, **groups}.items():
            imgui.separator_text(title.split("/")[-1])
            left = imgui.get_cursor_pos().x + _KEYS * imgui.get_font_size()
            for key, words in rows:
                imgui.text_colored(AMBER, key)
                imgui.same_line(left)
                imgui.text_wrapped(words)
    imgui.end()
