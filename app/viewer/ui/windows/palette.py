"""The command palette: finds every action, setting and scene by words. It is imgui-command-palette's."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

from imgui_bundle import imgui
from imgui_bundle import imgui_command_palette as library

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.commands import COMMANDS
from irrsplat.app.viewer.ui.layout import DIALOG
from irrsplat.scene import bundled
from irrsplat.settings import SETTINGS

_WIDTH, _HEIGHT = 460.0, 300.0  # at most, window coordinates at scale 1


class Palette:
    """Draws the palette while it is open; `show_setting` opens the panel at a setting."""

    def __init__(self, actions: Actions, show_setting: Callable[[str], None]) -> None:
        self.actions, self._show_setting = actions, show_setting
        self._context = library.ContextWrapper()
        self._names: list[str] = []
        self._chosen: Callable[[], object] | None = None

    def draw(self, scale: float) -> None:
        """Draw it where it is open, and run what was chosen."""
        actions = self.actions
        if not actions.panels.palette:
            self._forget()
            return
        if not self._names:
            self._list()
            library.set_next_command_palette_search("")
            library.set_next_command_palette_search_box_focused()
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos((0.5 * view.size.x, 0.12 * view.size.y), imgui.Cond_.always, (0.5, 0.0))
        imgui.set_next_window_size((min(_WIDTH * scale, 0.96 * view.size.x), min(_HEIGHT * scale, 0.8 * view.size.y)))
        flags = DIALOG | imgui.WindowFlags_.no_title_bar | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move
        imgui.begin("palette", None, flags)
        library.command_palette("palette")
        left = not imgui.is_window_appearing() and not imgui.is_window_focused(imgui.FocusedFlags_.child_windows)
        imgui.end()
        chosen, self._chosen = self._chosen, None
        if chosen is not None or left:
            actions.panels.palette = False
            self._forget()
        if chosen is not None:
            actions.attempt(chosen)

    def _list(self) -> None:
        """Make an entry of every action that can run, every setting and every known scene."""
        actions = self.actions
        for one in COMMANDS:
            if actions.can(one) and one.action != "escape" and one.argument != "palette":
                key = f"  ({one.shown})" if one.shown else ""
                self._add(f"{one.menu.replace('/', ' ')}: {one.title}{key}", partial(actions.press, one))
        for name in SETTINGS:
            self._add(f"Setting: {name.replace('_', ' ')}", partial(self._show_setting, name))
        for source in dict.fromkeys((*bundled(), *actions.preferences.recent)):
            self._add(f"Open: {os.path.basename(source)}", partial(actions.open, source))

    def _add(self, name: str, act: Callable[[], object]) -> None:
        if name in self._names:
            return
        command = library.Command()
        command.name = name
        command.initial_callback = lambda: setattr(self, "_chosen", act)  # run after the library's own code
        library.add_command(command)
        self._names.append(name)

    def _forget(self) -> None:
        for name in self._names:
            library.remove_command(name)
        self._names = []
