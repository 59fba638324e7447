"""The sheet of all keys, made from the table of actions."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.commands import FLYING, GROUPS
from irrsplat.app.viewer.ui.layout import DIALOG, accent

_AROUND = 8.0  # window coordinates that stay free around the sheet
_WIDTH = 660.0  # at most, window coordinates at scale 1
_KEYS = 8.0  # width of the column of keys, heights of the font


def draw_key_sheet(actions: Actions, scale: float) -> None:
    """Draw all keys where the sheet is open: in two columns where they fit, scrolled where there are too many."""
    if not actions.panels.help:
        return
    view = imgui.get_main_viewport()
    room = view.size.x - _AROUND, view.size.y - _AROUND
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((min(_WIDTH * scale, room[0]), room[1]))
    imgui.set_next_window_bg_alpha(0.97)
    shown, opened = imgui.begin("keys", True, DIALOG | imgui.WindowFlags_.no_saved_settings)
    actions.panels.help = bool(opened)
    if shown:
        rows = [(title, [(one.shown, one.words) for one in group]) for title, group in GROUPS.items()]
        rows.insert(0, ("Mouse and flight", list(FLYING)))
        columns = 2 if _WIDTH * scale <= room[0] else 1
        if imgui.begin_table("groups", columns):
            half = sum(len(group) + 1 for _, group in rows) / columns
            imgui.table_next_column()
            taken = 0
            for title, group in rows:
                if taken >= half:
                    taken = 0
                    imgui.table_next_column()
                _group(title, group)
                taken += len(group) + 1
            imgui.end_table()
    imgui.end()


def _group(title: str, rows: list[tuple[str, str]]) -> None:
    """Draw a group; long text is wrapped."""
    imgui.text_colored(accent(), title.split("/")[-1])
    left = imgui.get_cursor_pos().x + _KEYS * imgui.get_font_size()
    for key, words in rows:
        imgui.text_unformatted(key)
        imgui.same_line(left)
        imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
        imgui.text_wrapped(words)
        imgui.pop_style_color()
