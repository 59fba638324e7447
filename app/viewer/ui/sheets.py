"""The sheet of all keys, and the dialog that opens a scene."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.keys import FLYING, GROUPS
from irrsplat.app.viewer.ui.layout import AMBER

_FONT = 13.5  # so that the sheet fits 800x600
_COLUMNS = (("flying", "camera", "cache", "picture", "overlays"), ("buffers", "window"))
_FORMATS = ".scene .glb .gltf .obj .ply .stl, a .path to play, or a bundled scene's name; files can be dropped here too"


def draw_key_sheet(actions: Actions) -> None:
    """Draw all keys on one sheet, where it is open."""
    if not actions.panels.help:
        return
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size_constraints((0.0, 0.0), (view.size.x - 8.0, view.size.y - 8.0))
    imgui.set_next_window_bg_alpha(0.97)
    flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_collapse
    shown, opened = imgui.begin("keys", True, flags)
    actions.panels.help = bool(opened)
    if shown:
        imgui.push_font(None, _FONT)
        imgui.push_style_var(imgui.StyleVar_.cell_padding, (4.0, 1.0))
        if imgui.begin_table("sheet", 2, imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.pad_outer_x):
            for names in _COLUMNS:
                imgui.table_next_column()
                for name in names:
                    _group(name, FLYING if name == "flying" else tuple((k.shown, k.help) for k in GROUPS[name]))
            imgui.end_table()
        imgui.pop_style_var()
        imgui.pop_font()
    imgui.end()


def _group(title: str, rows: tuple[tuple[str, str], ...]) -> None:
    imgui.text_colored(AMBER, title)
    if imgui.begin_table(title, 2, imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.no_host_extend_x):
        for left, right in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text(left)
            imgui.table_next_column()
            imgui.text_disabled(right)
        imgui.end_table()


class OpenDialog:
    """Asks for a scene's file. typed: what stands in its line."""

    def __init__(self, actions: Actions) -> None:
        self.actions = actions
        self.typed = ""

    def draw(self) -> None:
        """Draw it where it is open."""
        actions = self.actions
        if not actions.panels.open:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos(view.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
        flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_collapse
        shown, opened = imgui.begin("open a scene", True, flags)
        actions.panels.open = bool(opened)
        if shown:
            if imgui.is_window_appearing():
                imgui.set_keyboard_focus_here()
            imgui.set_next_item_width(0.6 * view.size.x)
            entered, self.typed = imgui.input_text("##path", self.typed, imgui.InputTextFlags_.enter_returns_true)
            imgui.same_line()
            if (imgui.button("open") or entered) and self.typed.strip():
                actions.attempt(lambda: actions.open(self.typed.strip()))
            imgui.text_disabled(_FORMATS)
        imgui.end()
