"""The menu bar."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.input.keys import GROUPS, KEYS
from irrsplat.app.viewer.view_options import SPLITS
from irrsplat.scene import bundled
from irrsplat.settings import PRESETS


class Menus:
    """Draws the menu bar of the actions."""

    def __init__(self, actions: Actions) -> None:
        self.actions = actions

    def draw(self) -> None:
        """Draw the bar along the top, and the menu that is open."""
        if not imgui.begin_main_menu_bar():
            return
        for title, draw in (
            ("Scene", self._scenes),
            ("Camera", self._cameras),
            ("Show", self._show),
            ("Over it", self._overlays),
            ("Cache", self._cache),
            ("Preset", self._presets),
            ("Window", self._window),
        ):
            if imgui.begin_menu(title):
                draw()
                imgui.end_menu()
        imgui.text_disabled(f"  {self.actions.session.scene.name}")
        imgui.end_main_menu_bar()

    def _key(self, action: str, argument: str | None = None) -> None:
        """Draw a menu's line for what a key does, with the key beside it."""
        key = next(k for k in KEYS if (k.action, k.argument) == (action, argument))
        on = argument is not None and self.actions.is_on(argument)
        if imgui.menu_item(key.help.split(";")[0], key.shown, on)[0]:
            self.actions.press(key)

    def _scenes(self) -> None:
        actions = self.actions
        for name in bundled():
            if imgui.menu_item(name, "", actions.source == name)[0]:
                actions.attempt(lambda name=name: actions.open(name))  # type: ignore[misc]
        recent = [source for source in actions.preferences.recent if source not in bundled()]
        if recent:
            imgui.separator_text("recent")
            for source in recent:
                if imgui.menu_item(source, "", actions.source == source)[0]:
                    actions.attempt(lambda source=source: actions.open(source))  # type: ignore[misc]
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
        for action in ("home", "headlamp", "bookmark", "copy_line", "copy_flags", "record", "play"):
            self._key(action)

    def _show(self) -> None:
        options = self.actions.session.options
        for side in (0, 1) if options.split != "off" else (0,):
            if options.split != "off":
                imgui.separator_text(("left", "right")[side])
            for name, buffer in BUFFERS.items():
                shown = next((k.shown for k in GROUPS["buffers"] if k.argument == name), "")
                if imgui.menu_item(f"{buffer.title}##{side}", shown, options.buffers[side] == name)[0]:
                    options.buffers[side] = name
                imgui.set_item_tooltip(buffer.help)
        self._key("trace")
        imgui.separator_text("split")
        for way, title in SPLITS.items():
            if imgui.menu_item(title, "", options.split == way)[0]:
                self.actions.attempt(lambda way=way: self.actions.session.split(way))  # type: ignore[misc]
        self._key("split")
        imgui.separator_text("exposure")
        for action in ("darker", "brighter", "auto_exposure"):
            self._key(action)

    def _overlays(self) -> None:
        for overlay in ("points", "discs", "normals", "by_age"):
            self._key("toggle", overlay)
        imgui.separator()
        for overlay in ("sites", "wire", "inspect"):
            self._key("toggle", overlay)

    def _cache(self) -> None:
        self._key("toggle", "frozen")
        self._key("step")
        self._key("clear")

    def _presets(self) -> None:
        actions = self.actions
        current = actions.session.settings(actions.side)[0]
        for name in PRESETS:
            if imgui.menu_item(name, "", name == current)[0]:
                actions.attempt(lambda name=name: actions.session.use_preset(actions.side, name))  # type: ignore[misc]
        imgui.separator()
        self._key("swap_preset")

    def _window(self) -> None:
        for panel in ("settings", "lights", "hud", "hidden", "help"):
            self._key("toggle", panel)
        imgui.separator()
        for action in ("fullscreen", "screenshot", "screenshot_bare", "reload", "quit"):
            self._key(action)
