"""The command palette: finds every action, setting and scene by words."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.commands import COMMANDS
from irrsplat.app.viewer.ui.layout import DIALOG
from irrsplat.app.viewer.ui.settings_panel import OF_RENDERS
from irrsplat.scene import bundled
from irrsplat.settings import SETTINGS

_WIDTH, _HEIGHT = 460.0, 300.0  # at most, window coordinates at scale 1


class Palette:
    """Draws the palette while it is open; `show_setting` opens the panel at a setting."""

    def __init__(self, actions: Actions, show_setting: Callable[[str], None]) -> None:
        self.actions, self._show_setting = actions, show_setting
        self._entries: dict[str, Callable[[], object]] = {}  # by the name on show; empty while the palette is closed
        self._words = ""

    def draw(self, scale: float) -> None:
        """Draw the palette if it is open, and run the chosen entry."""
        actions = self.actions
        if not actions.panels.palette:
            self._entries = {}
            return
        if opened := not self._entries:
            self._entries, self._words = self._listed(), ""
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos((0.5 * view.size.x, 0.12 * view.size.y), imgui.Cond_.always, (0.5, 0.0))
        imgui.set_next_window_size((min(_WIDTH * scale, 0.96 * view.size.x), min(_HEIGHT * scale, 0.8 * view.size.y)))
        flags = DIALOG | imgui.WindowFlags_.no_title_bar | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move
        imgui.begin("palette", None, flags)
        chosen = self._choose(opened)
        left = not imgui.is_window_appearing() and not imgui.is_window_focused(imgui.FocusedFlags_.child_windows)
        imgui.end()
        if chosen is not None or left:
            actions.panels.palette = False
        if chosen is not None:
            actions.attempt(chosen)

    def _choose(self, opened: bool) -> Callable[[], object] | None:
        """Draw the words and the entries that have all of them; return the chosen one. Enter chooses the first."""
        if opened:
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1.0)
        entered, self._words = imgui.input_text("##words", self._words, imgui.InputTextFlags_.enter_returns_true)
        words = self._words.lower().split()
        found = [name for name in self._entries if all(word in name.lower() for word in words)]
        chosen = found[0] if entered and found else None
        if imgui.begin_child("entries"):
            for number, name in enumerate(found):
                if imgui.selectable(name, number == 0)[0]:
                    chosen = name
        imgui.end_child()
        return None if chosen is None else self._entries[chosen]

    def _listed(self) -> dict[str, Callable[[], object]]:
        """Return an entry for every action that can run, every setting and every known scene."""
        actions, entries = self.actions, dict[str, Callable[[], object]]()
        for one in COMMANDS:
            if actions.can(one) and one.action != "escape" and one.argument != "palette":
                key = f"  ({one.shown})" if one.shown else ""
                entries.setdefault(f"{one.menu.replace('/', ' ')}: {one.title}{key}", partial(actions.press, one))
        for name in sorted(SETTINGS.keys() - OF_RENDERS):
            entries[f"Setting: {name.replace('_', ' ')}"] = partial(self._show_setting, name)
        for source in dict.fromkeys((*bundled(), *actions.preferences.recent)):
            entries.setdefault(f"Open: {os.path.basename(source)}", partial(actions.open, source))
        return entries
