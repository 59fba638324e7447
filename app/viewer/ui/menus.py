"""The menu bar, made from the table of actions."""

from __future__ import annotations

import os
from collections.abc import Callable

from imgui_bundle import imgui

from irrsplat.app.common.version import version
from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.commands import COMMANDS, MENUS, Command
from irrsplat.app.viewer.view_options import SCALES
from irrsplat.scene import bundled

_CONTEXT = ("delete", "hide_object", "frame_selected", "undo")  # actions on what is selected
_TIGHT = 3.0  # window coordinates at least on both sides of a title in the bar
_SLIDER = 10.0  # width of a slider, heights of the font


class Menus:
    def __init__(self, actions: Actions) -> None:
        self.actions = actions
        self._scale = 0.0  # of the interface, while its slider is dragged
        self._before: dict[str, Callable[[], None]] = {  # what the table cannot list, above the entry of an action
            "save_again": self._scenes,
            "home": self._cameras,
            "toggle fullscreen": self._size,
            "toggle help": self._version,
        }

    def draw(self) -> None:
        """Draw the bar along the top, and the menu that is open."""
        if not imgui.begin_main_menu_bar():
            return
        style = imgui.get_style()
        room = imgui.get_main_viewport().size.x - style.window_padding.x
        widths = sum(imgui.calc_text_size(title).x for title in MENUS)
        between = max((room - widths) / (2.0 * len(MENUS)) - 2.0, _TIGHT)  # imgui leaves it on both sides
        for title in MENUS:
            imgui.push_style_var(imgui.StyleVar_.item_spacing, (min(between, style.item_spacing.x), style.item_spacing.y))
            opened = imgui.begin_menu(title)
            imgui.pop_style_var()
            if opened:
                if self.actions.panels.close_menus:
                    imgui.close_current_popup()
                if title == "View":
                    self._submenu("View/Buffer")
                    self._submenu("View/Camera")
                self._entries(title)
                imgui.end_menu()
        if imgui.calc_text_size(f"  {self.actions.title}").x <= imgui.get_content_region_avail().x:
            imgui.text_disabled(f"  {self.actions.title}")
        imgui.end_main_menu_bar()

    def draw_context(self) -> None:
        """Draw the menu that a right click on an object or a light opens."""
        actions = self.actions
        if actions.panels.context_menu:
            imgui.open_popup("context")
            actions.panels.context_menu = False
        if imgui.begin_popup("context"):
            if actions.panels.close_menus:
                imgui.close_current_popup()
            for command in COMMANDS:
                if command.action in _CONTEXT:
                    self._entry(command)
            imgui.end_popup()
        actions.panels.close_menus = False

    def _submenu(self, menu: str) -> None:
        if imgui.begin_menu(menu.split("/")[1]):
            self._entries(menu)
            imgui.end_menu()

    def _entries(self, menu: str) -> None:
        for command in COMMANDS:
            if command.menu != menu:
                continue
            extra = self._before.get(f"{command.action} {command.argument or ''}".strip())
            if extra is not None:
                extra()
            if command.section:
                imgui.separator()
            self._entry(command)

    def _entry(self, command: Command) -> None:
        actions, possible = self.actions, self.actions.can(command)
        if command.action == "redo" and command.shift:
            return  # the second key of the entry above
        if imgui.menu_item(f"{command.title}##{command.menu}", command.shown, actions.is_active(command), possible)[0]:
            actions.press(command)
        if said := actions.missing(command) or command.help:
            imgui.set_item_tooltip(said)

    def _scenes(self) -> None:
        actions, names = self.actions, bundled()
        recent = [source for source in actions.preferences.recent if source not in names]
        if imgui.begin_menu("Open recent", bool(recent)):
            for source in recent:
                if imgui.menu_item(f"{os.path.basename(source)}##{source}", "", actions.source == source)[0]:
                    actions.attempt(lambda source=source: actions.open(source))  # type: ignore[misc]
                imgui.set_item_tooltip(source)
            imgui.end_menu()
        imgui.separator_text("Bundled scenes")
        for name in names:
            if imgui.menu_item(name, "", actions.source == name)[0]:
                actions.attempt(lambda name=name: actions.open(name))  # type: ignore[misc]

    def _cameras(self) -> None:
        actions = self.actions
        for i, camera in enumerate(actions.session.scene.placed(actions.session.origin).cameras):
            if imgui.menu_item(f"{camera.name or ('first' if i == 0 else f'camera {i + 1}')}##{i}", "", False)[0]:
                actions.go(camera)
        imgui.separator()

    def _size(self) -> None:
        imgui.set_next_item_width(_SLIDER * imgui.get_font_size())
        _, self._scale = imgui.slider_float("##scale", self._scale or self.actions.scale, *SCALES, "interface × %.2f")
        if not imgui.is_item_active():  # while it is dragged, it would move away from under the mouse
            self.actions.enlarge(self._scale)
            self._scale = 0.0

    def _version(self) -> None:
        about = self.actions.session.renderers[0].about
        imgui.text_disabled(f"irrsplat {version()}\nOpenGL {about['version']}\n{about['renderer']}")
