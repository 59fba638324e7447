"""The menu bar, the sheet of keys and the dialog that opens scenes."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.keys import FLYING, GROUPS, KEYS
from irrsplat.app.viewer.session import SPLITS
from irrsplat.app.viewer.show.legend import SHOWINGS
from irrsplat.app.viewer.ui.imgui_backend import ACCENT
from irrsplat.scene import bundled
from irrsplat.settings import PRESETS

_SHEET_FONT = 13.5  # so that the sheet fits 800x600
_SPLIT_WORDS = {"off": "one picture", "buffers": "two buffers", "presets": "two presets"}


class Menu:
    """Draws the menus of a actions; what is typed into the dialog is kept here."""

    def __init__(self, actions: Actions) -> None:
        self.actions = actions
        self._typed = ""

    def bar(self) -> None:
        """The bar along the top."""
        actions = self.actions
        if not imgui.begin_main_menu_bar():
            return
        if imgui.begin_menu("Scene"):
            self._scenes()
            imgui.end_menu()
        if imgui.begin_menu("Camera"):
            self._cameras()
            imgui.end_menu()
        if imgui.begin_menu("Show"):
            self._buffers()
            imgui.end_menu()
        if imgui.begin_menu("Over it"):
            for overlay in ("points", "discs", "normals", "by_age"):
                self._key("toggle", overlay)
            imgui.separator()
            self._key("toggle", "sites")
            self._key("toggle", "wire")
            self._key("toggle", "inspect")
            imgui.end_menu()
        if imgui.begin_menu("Cache"):
            self._key("toggle", "frozen")
            self._key("step")
            self._key("clear")
            imgui.end_menu()
        if imgui.begin_menu("Preset"):
            current = actions.session.settings(actions.side)[0]
            for name in PRESETS:
                if imgui.menu_item(name, "", name == current)[0]:
                    actions.trying(lambda name=name: actions.session.use(actions.side, name))  # type: ignore[misc]
            imgui.separator()
            self._key("swap_preset")
            imgui.end_menu()
        if imgui.begin_menu("Window"):
            for name in ("settings", "lights", "hud", "hidden", "help"):
                self._key("toggle", name)
            imgui.separator()
            for action in ("fullscreen", "screenshot", "screenshot_bare", "reload", "quit"):
                self._key(action)
            imgui.end_menu()
        imgui.text_disabled(f"  {actions.session.scene.name}")
        imgui.end_main_menu_bar()

    def _key(self, action: str, argument: str | None = None) -> None:
        """A menu's line for what a key does, with the key beside it."""
        key = next(k for k in KEYS if (k.action, k.argument) == (action, argument))
        panels, options = self.actions.panels, self.actions.session.options
        on = bool(argument) and bool(getattr(panels if hasattr(panels, str(argument)) else options, str(argument)))
        if imgui.menu_item(key.help.split(";")[0], key.shown, on)[0]:
            self.actions.press(key)

    def _scenes(self) -> None:
        actions = self.actions
        for name in bundled():
            if imgui.menu_item(name, "", actions.source == name)[0]:
                actions.trying(lambda name=name: actions.open(name))  # type: ignore[misc]
        recent = [source for source in actions.preferences.recent if source not in bundled()]
        if recent:
            imgui.separator_text("recent")
            for source in recent:
                if imgui.menu_item(source, "", actions.source == source)[0]:
                    actions.trying(lambda source=source: actions.open(source))  # type: ignore[misc]
        imgui.separator()
        self._key("open_dialog")

    def _cameras(self) -> None:
        actions = self.actions
        for i, camera in enumerate(actions.session.scene.cameras):
            if imgui.menu_item(f"{camera.name or ('first' if i == 0 else f'camera {i + 1}')}##{i}", "", False)[0]:
                actions.go(camera)
        if actions.bookmarks:
            imgui.separator_text("bookmarks")
        for bookmark in list(actions.bookmarks):
            if imgui.begin_menu(bookmark.name):
                if imgui.menu_item("go there", "", False)[0]:
                    actions.go(bookmark)
                if imgui.menu_item("forget it", "", False)[0]:
                    actions.forget(bookmark)
                imgui.end_menu()
        imgui.separator()
        for action in ("home", "bookmark", "copy_line", "copy_flags", "record", "play"):
            self._key(action)

    def _buffers(self) -> None:
        options = self.actions.session.options
        for side in (0, 1) if options.split != "off" else (0,):
            if options.split != "off":
                imgui.separator_text(("left", "right")[side])
            for name, showing in SHOWINGS.items():
                shown = next((k.shown for k in GROUPS["buffers"] if k.argument == name), "")
                if imgui.menu_item(f"{showing.title}##{side}", shown, options.buffers[side] == name)[0]:
                    options.buffers[side] = name
                imgui.set_item_tooltip(showing.help)
        self._key("trace")
        imgui.separator_text("split")
        for way in SPLITS:
            if imgui.menu_item(_SPLIT_WORDS[way], "", options.split == way)[0]:
                self.actions.trying(lambda way=way: self.actions.session.split(way))  # type: ignore[misc]
        self._key("split")
        imgui.separator_text("exposure")
        for action in ("darker", "brighter", "auto_exposure"):
            self._key(action)

    def sheet(self) -> None:
        """All keys on one sheet."""
        actions = self.actions
        if not actions.panels.help:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_size_constraints((0.0, 0.0), (view.size.x - 8.0, view.size.y - 8.0))
        flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_collapse
        imgui.set_next_window_bg_alpha(0.97)
        shown, actions.panels.help = imgui.begin("keys", True, flags)
        if shown:
            imgui.push_font(None, _SHEET_FONT)
            imgui.push_style_var(imgui.StyleVar_.cell_padding, (4.0, 1.0))
            if imgui.begin_table("sheet", 2, imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.pad_outer_x):
                for names in (("flying", "camera", "cache", "picture", "overlays"), ("buffers", "window")):
                    imgui.table_next_column()
                    for name in names:
                        _table(name, FLYING if name == "flying" else tuple((k.shown, k.help) for k in GROUPS[name]))
                imgui.end_table()
            imgui.pop_style_var()
            imgui.pop_font()
        imgui.end()

    def dialog(self) -> None:
        """The dialog that asks for a scene's file."""
        actions = self.actions
        if not actions.panels.open:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos(view.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
        flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_collapse
        shown, actions.panels.open = imgui.begin("open a scene", True, flags)
        if shown:
            if imgui.is_window_appearing():
                imgui.set_keyboard_focus_here()
            imgui.set_next_item_width(0.6 * view.size.x)
            entered, self._typed = imgui.input_text("##path", self._typed, imgui.InputTextFlags_.enter_returns_true)
            imgui.same_line()
            if (imgui.button("open") or entered) and self._typed.strip():
                actions.trying(lambda: actions.open(self._typed.strip()))
            imgui.text_disabled(
                ".scene .glb .gltf .obj .ply .stl, a .path to play, or a bundled scene's name; files can be dropped here too"
            )
        imgui.end()


def _table(title: str, rows: tuple[tuple[str, str], ...]) -> None:
    imgui.text_colored((*ACCENT, 1.0), title)
    if imgui.begin_table(title, 2, imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.no_host_extend_x):
        for left, right in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text(left)
            imgui.table_next_column()
            imgui.text_disabled(right)
        imgui.end_table()
