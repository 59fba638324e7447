"""The dialogs that open and save: the desktop's own, or one line to type into; and the question about unsaved changes."""

from __future__ import annotations

import os
import shutil
import sys

from imgui_bundle import imgui
from imgui_bundle import portable_file_dialogs as desktop

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import DIALOG
from irrsplat.scene import FORMATS

_PROGRAMS = ("zenity", "kdialog", "matedialog", "qarma")  # one of which portable_file_dialogs needs on Linux
_SHARE = 0.6  # of the window's width, for the dialog of one line


def has_desktop_dialogs() -> bool:
    """Return True if the desktop has dialogs of its own."""
    return sys.platform in ("win32", "darwin") or any(map(shutil.which, _PROGRAMS))


class FileDialogs:
    """Dialogs that open while the actions need a file. native: the desktop's. typed: the line of the other dialog."""

    def __init__(self, actions: Actions, native: bool) -> None:
        self.actions, self.native = actions, native and has_desktop_dialogs()
        self.typed = ""
        self._asking: desktop.open_file | desktop.save_file | None = None

    @property
    def answered(self) -> bool:
        """True if the desktop's dialog was closed since the last frame."""
        return self._asking is not None and bool(self._asking.ready(0))

    def draw(self) -> None:
        """Draw the dialog that is open, or take its result."""
        panels = self.actions.panels
        if not (panels.open or panels.save):
            self.typed = ""
        elif self.native:
            self._ask()
        elif panels.open:
            self._line("open a scene", "open")
        else:
            self._line("save the scene", "save")

    # ---- the desktop's ---------------------------------------------------------------------------------------------

    def _ask(self) -> None:
        """Open the desktop's dialog, or take its result."""
        actions, panels = self.actions, self.actions.panels
        if self._asking is None:
            folder = self._folder
            if panels.open:
                patterns = " ".join(f"*{ending}" for ending in (*FORMATS, ".path"))
                self._asking = desktop.open_file("open a scene", folder + os.sep, ["scenes and paths", patterns])
            else:
                name = actions.saved_as or os.path.join(folder, actions.free_name())
                self._asking = desktop.save_file("save the scene", name, ["scenes", "*.scene"])
            return
        if not self._asking.ready(0):
            return
        answer, self._asking = self._asking.result(), None
        chosen = answer if isinstance(answer, str) else next(iter(answer), "")
        opening, panels.open, panels.save = panels.open, False, False
        if chosen and opening:
            actions.attempt(lambda: actions.open(chosen))
        elif chosen:  # the dialog has confirmed that a present file is replaced
            actions.attempt(lambda: actions.save(chosen, overwrite=True))

    @property
    def _folder(self) -> str:
        """The folder of the scene on show; of a bundled scene, the one where the program runs."""
        source = self.actions.source
        return os.path.dirname(os.path.abspath(source)) if os.path.isfile(source) else os.getcwd()

    # ---- one line --------------------------------------------------------------------------------------------------

    def _line(self, title: str, verb: str) -> None:
        """Draw the dialog of one line, where the desktop has none."""
        actions, panels, view = self.actions, self.actions.panels, imgui.get_main_viewport()
        imgui.set_next_window_pos(view.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
        imgui.set_next_window_size((_SHARE * view.size.x, 0.0))  # imgui fits a window into what the side panel leaves
        shown, opened = imgui.begin(title, True, imgui.WindowFlags_.no_resize | DIALOG)
        if shown:
            if imgui.is_window_appearing():
                self.typed = (actions.saved_as or actions.free_name()) if verb == "save" else ""
                imgui.set_keyboard_focus_here()
            imgui.set_next_item_width(-1.0)
            imgui.push_text_wrap_pos(0.0)
            entered, self.typed = imgui.input_text("##name", self.typed, imgui.InputTextFlags_.enter_returns_true)
            name = self.typed.strip()
            there = verb == "save" and bool(name) and actions.saved_path(name).exists()
            if there:
                if imgui.button("overwrite"):
                    actions.attempt(lambda: actions.save(name, overwrite=True))
            elif (imgui.button(verb) or entered) and name:
                self._take(name, verb)
            imgui.same_line()
            saving = "the file is there already" if there else "a .scene; lights and objects go into a folder beside it"
            imgui.text_disabled(saving if verb == "save" else "a path, or the name of a bundled scene; files can be dropped, too")
            imgui.pop_text_wrap_pos()
        imgui.end()
        if not opened:
            panels.open = panels.save = False

    def _take(self, name: str, verb: str) -> None:
        """Open or save by a name; a relative path to open is seen from the folder of the scene on show, too."""
        actions = self.actions
        if verb == "save":
            actions.attempt(lambda: actions.save(name))
            return
        path = os.path.expanduser(name)
        beside = os.path.join(self._folder, path)
        if actions.attempt(lambda: actions.open(path if os.path.exists(path) or not os.path.exists(beside) else beside)):
            actions.panels.open = False


def draw_unsaved(actions: Actions) -> None:
    """Draw the question while an action waits for its answer; the save dialog takes its place."""
    if actions.pending is None or actions.panels.save:
        return
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((_SHARE * view.size.x, 0.0))
    flags = imgui.WindowFlags_.no_resize | DIALOG | imgui.WindowFlags_.no_saved_settings
    shown, opened = imgui.begin("unsaved changes", True, flags)
    if shown:
        imgui.text_wrapped(f"{actions.session.scene.name} has changes that no file has.")
        if imgui.button("save…"):
            actions.save_dialog()
        imgui.same_line()
        if imgui.button("discard"):
            actions.discard()
        imgui.same_line()
        if imgui.button("cancel"):
            actions.pending = None
    imgui.end()
    if not opened:
        actions.pending = None
