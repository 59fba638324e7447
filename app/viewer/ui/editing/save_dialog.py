"""The dialog that saves the scene under a new name."""

from __future__ import annotations

from pathlib import Path

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import DIALOG


class SaveDialog:
    """Asks for a file's name. typed: what stands in its line."""

    def __init__(self, actions: Actions) -> None:
        self.actions = actions
        self.typed = ""

    def draw(self) -> None:
        """Draw it where it is open."""
        actions = self.actions
        if not actions.panels.save:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos(view.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
        flags = imgui.WindowFlags_.always_auto_resize | DIALOG
        shown, opened = imgui.begin("save the scene", True, flags)
        actions.panels.save = bool(opened)
        if shown:
            if imgui.is_window_appearing():
                self.typed = self.typed or actions.free_name()
                imgui.set_keyboard_focus_here()
            imgui.set_next_item_width(0.6 * view.size.x)
            entered, self.typed = imgui.input_text("##name", self.typed, imgui.InputTextFlags_.enter_returns_true)
            name = self.typed.strip()
            there = bool(name) and Path(actions.scene_path(name)).exists()
            if there:
                if imgui.button("overwrite"):
                    actions.attempt(lambda: actions.save(name, overwrite=True))
            elif (imgui.button("save") or entered) and name:
                actions.attempt(lambda: actions.save(name))
            imgui.same_line()
            imgui.text_disabled(
                "this is there already" if there else "a .scene; its lights and objects go into a folder beside it"
            )
        imgui.end()
