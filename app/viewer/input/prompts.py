"""Questions to the user: the choice of a command or a file, and the decision on unsaved changes."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from imgui_bundle import imgui
from imgui_bundle import portable_file_dialogs as desktop

from irrsplat.app.viewer.input.commands import COMMANDS, FLYING
from irrsplat.app.viewer.ui.layout import Layout
from irrsplat.scene import FORMATS, bundled
from irrsplat.scene.io.text.scene_writer import scene_file
from irrsplat.settings import SETTINGS

if TYPE_CHECKING:
    from irrsplat.app.viewer.actions import Actions

OF_RENDERS = frozenset(("samples", "quality"))  # settings without effect in the viewer
_PROGRAMS = ("zenity", "kdialog", "matedialog", "qarma")  # portable_file_dialogs needs one of them on Linux
Act = Callable[[], object]


@dataclass
class Prompt:
    """A question. entries: a call that returns the choices for a typed text, by their names.

    text: the text of the input line; None for a question without an input line. row: the number of the marked entry.
    """

    title: str
    entries: Callable[[str], dict[str, Act]]
    text: str | None = ""
    row: int = 0
    opened: bool = False  # True once it has been drawn


def _having(words: str, entries: dict[str, Act]) -> dict[str, Act]:
    """Return the entries whose names contain all words, in order of whole words first, then of length.

    Without words, return all entries in their order.
    """
    wanted = words.lower().split()
    found = [name for name in entries if all(word in name.lower() for word in wanted)]
    if wanted:
        found.sort(key=lambda name: (not set(wanted) <= set(name.lower().split()), len(name)))
    return {name: entries[name] for name in found}


def command(actions: Actions, all_keys: bool) -> Prompt:
    """Return the prompt with all actions that can run, the settings, the known scenes, and a file if its path is typed.

    all_keys: True to list all actions, after the effects of the mouse and of the flying keys.
    """
    entries: dict[str, Act] = {f"{key}: {words}": lambda: None for key, words in FLYING if all_keys}
    for one in COMMANDS:
        if (all_keys or actions.can(one)) and one.action not in ("escape", "find_command"):
            key = f"  ({one.shown})" if one.shown else ""
            entries.setdefault(f"{one.menu.replace('/', ' ')}: {one.title}{key}", partial(actions.press, one))
    for name in sorted(SETTINGS.keys() - OF_RENDERS):
        entries[f"Setting: {name.replace('_', ' ')}"] = partial(actions.show_setting, name)
    sources = dict.fromkeys((*bundled(), *actions.preferences.recent))
    entries |= {f"Open: {os.path.basename(source)}": partial(actions.open, source) for source in reversed(sources)}

    def found(text: str) -> dict[str, Act]:
        path = os.path.expanduser(text.strip())
        return {f"Open: {path}": partial(actions.open, path)} if os.path.isfile(path) else _having(text, entries)

    return Prompt("a command, or the name or the path of a scene", found)


def unsaved(actions: Actions, act: Act) -> Prompt:
    """Return the prompt with the choices for unsaved changes before `act`."""
    answers: dict[str, Act] = {"save": partial(actions.save_again, act), "discard": act, "cancel": lambda: None}
    return Prompt(f"save the changes to {actions.title}?", lambda text: answers, None)


def file_name(name: str, take: Callable[[str], object]) -> Prompt:
    """Return the prompt for the name of a scene to save, first `name`. `take` receives the answer."""

    def entries(text: str) -> dict[str, Act]:
        path = scene_file(text)  # as it will be saved
        return {f"{'replace' if os.path.exists(path) else 'save'} {path}": partial(take, text)} if text.strip() else {}

    return Prompt("the name of the file", entries, name)


def folder(actions: Actions) -> str:
    """Return the folder of the scene on show; for a bundled scene, the folder where the program runs."""
    source = actions.source
    return os.path.dirname(os.path.abspath(source)) if os.path.isfile(source) else os.getcwd()


class DesktopDialog:
    """The desktop's dialog for a file, one at a time. native: True if the desktop has such a dialog."""

    def __init__(self, native: bool) -> None:
        self.native = native and (sys.platform in ("win32", "darwin") or any(map(shutil.which, _PROGRAMS)))
        self._open: tuple[desktop.open_file | desktop.save_file, Callable[[str], object]] | None = None  # the dialog, its taker

    def request(self, name: str, take: Callable[[str], object], save: bool = False) -> None:
        """Request a scene, or with `save` the name of a file, which may exist. `take` receives the answer."""
        if self._open is None and save:
            self._open = desktop.save_file("save the scene", name, ["scenes", "*.scene"]), take
        elif self._open is None:
            patterns = " ".join(f"*{ending}" for ending in FORMATS)
            self._open = desktop.open_file("open a scene", name, ["scenes", patterns]), take

    def update(self) -> None:
        """Call the taker of the answer, if there is an answer."""
        if self._open is None or not _child_ended() or not self._open[0].ready(0):
            return
        (dialog, take), self._open = self._open, None
        answer = dialog.result()
        if chosen := answer if isinstance(answer, str) else next(iter(answer), ""):
            take(chosen)


def _child_ended() -> bool:
    """Return False if no child process has ended.

    The library of the dialogs first reads the answer, then checks whether its process has ended. It loses an answer in between.
    """
    if not hasattr(os, "waitid"):
        return True
    with suppress(ChildProcessError):
        return os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return True


_WIDTH, _ROWS = 560.0, 16  # the greatest width (window coordinates at scale 1) and the most visible entries
_STEPS = {imgui.Key.up_arrow: -1, imgui.Key.down_arrow: 1, imgui.Key.page_up: -_ROWS, imgui.Key.page_down: _ROWS}  # rows by key
_ENTER = imgui.Key.enter, imgui.Key.keypad_enter
_FLAGS = imgui.WindowFlags_.no_collapse | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move


def draw_prompt(actions: Actions, layout: Layout) -> None:
    """Draw the window of the open question, if any, and run the chosen entry."""
    prompt = actions.prompt
    if prompt is None:
        return
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos((0.5 * view.size.x, 0.12 * view.size.y), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_size((min(_WIDTH * layout.scale, 0.96 * view.size.x), 0.0))
    imgui.set_next_window_bg_alpha(1.0)  # text behind it stays hidden
    imgui.begin("prompt", None, _FLAGS | imgui.WindowFlags_.no_title_bar)
    imgui.text_wrapped(prompt.title)
    chosen = _choose(prompt, 0.5 * view.size.y)
    left = prompt.opened and not imgui.is_window_focused(imgui.FocusedFlags_.child_windows)
    prompt.opened = True
    imgui.end()
    if chosen is not None or left:
        actions.prompt = None
    if chosen is not None:
        actions.attempt(chosen)


def _choose(prompt: Prompt, most: float) -> Act | None:
    """Draw the input line and the entries; return the chosen entry. Arrows mark an entry, and Enter chooses it.

    most: the greatest height of the entries, window coordinates.
    """
    if prompt.text is None:  # Enter counts from the second frame on: the first one may have opened the prompt
        entered = prompt.opened and any(map(imgui.is_key_pressed, _ENTER))
        if not prompt.opened:
            imgui.set_window_focus()
    else:
        if not prompt.opened:
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1.0)
        before = prompt.text
        entered, prompt.text = imgui.input_text("##text", before, imgui.InputTextFlags_.enter_returns_true)
        prompt.row = prompt.row if prompt.text == before else 0
    found = prompt.entries(prompt.text or "")
    if entered and not found:
        imgui.set_keyboard_focus_here(-1)  # Enter ends the input line, also without an entry
    step = sum(rows * imgui.is_key_pressed(key) for key, rows in _STEPS.items())
    prompt.row = min(max(prompt.row + step, 0), max(len(found) - 1, 0))
    chosen = list(found.values())[prompt.row] if entered and found else None
    row = imgui.get_text_line_height_with_spacing()
    height = min(row * (min(len(found), _ROWS) + 1), most)
    if imgui.begin_child("entries", (0.0, height), window_flags=imgui.WindowFlags_.horizontal_scrollbar):
        for number, (name, act) in enumerate(found.items()):
            if imgui.selectable(name, number == prompt.row)[0]:
                chosen = act
            if step and number == prompt.row:
                imgui.set_scroll_here_y()
        if not found:
            imgui.text_disabled("nothing has these words, and no file is there")
    imgui.end_child()
    return chosen
