"""The sheet of all keys: in two columns where they fit beside each other, else in one, scrolled where it is too long."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.keys import FLYING, GROUPS
from irrsplat.app.viewer.ui.layout import DIALOG, accent

_FONT = 13.5  # so that the sheet fits 800x600
_COLUMNS: tuple[tuple[str, ...], ...] = (
    ("flying", "camera", "cache", "picture", "overlays"),
    ("buffers", "lights and objects", "window"),
)
_BETWEEN = 12.0  # window coordinates at scale 1, between a key and what it does, and twice that between columns
_AROUND = 8.0  # window coordinates that stay free around the sheet


def draw_key_sheet(actions: Actions, scale: float) -> None:
    """Draw all keys on one sheet, where it is open."""
    if not actions.panels.help:
        return
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size_constraints((0.0, 0.0), (view.size.x - _AROUND, view.size.y - _AROUND))
    imgui.set_next_window_bg_alpha(0.97)
    flags = imgui.WindowFlags_.always_auto_resize | DIALOG | imgui.WindowFlags_.no_saved_settings
    shown, opened = imgui.begin("keys", True, flags)
    actions.panels.help = bool(opened)
    if shown:
        imgui.push_font(None, _FONT)
        imgui.push_style_var(imgui.StyleVar_.cell_padding, (0.0, 1.0))
        _columns(view.size.x - _AROUND, _BETWEEN * scale)
        imgui.pop_style_var()
        imgui.pop_font()
    imgui.end()


def _rows(group: str) -> tuple[tuple[str, str], ...]:
    """The keys of a group and what they do."""
    return FLYING if group == "flying" else tuple((k.shown, k.help) for k in GROUPS[group])


def _columns(room: float, gap: float) -> None:
    """Draw the groups side by side where `room` is wide enough, else below each other."""
    style = imgui.get_style()
    inner = room - 2.0 * style.window_padding.x - style.scrollbar_size
    widths = []
    for names in _COLUMNS:
        rows = [row for name in names for row in _rows(name)]
        widths.append([max(imgui.calc_text_size(row[part]).x for row in rows) for part in (0, 1)])
    beside = sum(left + gap + right for left, right in widths) + 2.0 * gap <= inner
    for i, (names, (left, right)) in enumerate(zip(_COLUMNS, widths, strict=True)):
        if i and beside:
            imgui.same_line(0.0, 2.0 * gap)
        if not beside:
            left = max(one[0] for one in widths)
            right = max(min(max(one[1] for one in widths), inner - left - gap), 60.0)
        imgui.begin_group()
        for name in names:
            _group(name, left + gap, right)
        imgui.end_group()


def _group(title: str, left: float, right: float) -> None:
    """Draw a group in columns of these widths; what does not fit into the second is wrapped there."""
    imgui.text_colored(accent(), title)
    if imgui.begin_table(title, 2, imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.no_host_extend_x):
        imgui.table_setup_column("key", imgui.TableColumnFlags_.width_fixed, left)
        imgui.table_setup_column("help", imgui.TableColumnFlags_.width_fixed, right + 1.0)
        for key, help in _rows(title):
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text_unformatted(key)
            imgui.table_next_column()
            imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
            imgui.text_wrapped(help)
            imgui.pop_style_color()
        imgui.end_table()
