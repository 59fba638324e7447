"""The prompt: a line to type into, and the entries that fit its text."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.prompts import Act, Prompt
from irrsplat.app.viewer.ui.layout import Layout

_WIDTH, _ROWS = 560.0, 12  # window coordinates at scale 1, and entries in sight; both at most
_STEPS = {imgui.Key.up_arrow: -1, imgui.Key.down_arrow: 1, imgui.Key.page_up: -_ROWS, imgui.Key.page_down: _ROWS}  # rows
_FLAGS = imgui.WindowFlags_.no_collapse | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move


class PromptView:
    """Draws the prompt of the actions while there is one."""

    def __init__(self) -> None:
        self.text, self.row = "", 0  # what is typed, and the number of the marked entry
        self._drawn: Prompt | None = None  # in the last frame

    def draw(self, actions: Actions, layout: Layout) -> None:
        """Draw the prompt, and run the chosen entry."""
        prompt, opened = actions.prompt, actions.prompt is not self._drawn
        self._drawn = prompt
        if prompt is None:
            return
        if opened:
            self.text, self.row = prompt.text or "", 0
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos((0.5 * view.size.x, 0.12 * view.size.y), imgui.Cond_.always, (0.5, 0.0))
        imgui.set_next_window_size((min(_WIDTH * layout.scale, 0.96 * view.size.x), 0.0))
        imgui.begin("prompt", None, _FLAGS | imgui.WindowFlags_.no_title_bar)
        imgui.text_wrapped(prompt.title)
        chosen = self._choose(prompt, opened, 0.5 * view.size.y)
        left = not opened and not imgui.is_window_focused(imgui.FocusedFlags_.child_windows)
        imgui.end()
        if chosen is not None or left:
            actions.prompt = None
        if chosen is not None:
            actions.attempt(chosen)

    def _choose(self, prompt: Prompt, opened: bool, most: float) -> Act | None:
        """Draw the line and the entries, at most so high; return the chosen one. Arrows mark an entry, and Enter chooses it."""
        entered = False
        if opened:
            imgui.set_keyboard_focus_here() if prompt.text is not None else imgui.set_window_focus()
        if prompt.text is not None:
            imgui.set_next_item_width(-1.0)
            before = self.text
            entered, self.text = imgui.input_text("##text", self.text, imgui.InputTextFlags_.enter_returns_true)
            self.row = self.row if self.text == before else 0
        found = prompt.entries(self.text)
        step = sum(rows * imgui.is_key_pressed(key) for key, rows in _STEPS.items())
        self.row = min(max(self.row + step, 0), max(len(found) - 1, 0))
        chosen = list(found.values())[self.row] if entered and found else None
        row = imgui.get_text_line_height_with_spacing()
        height = min(row * (min(len(found), _ROWS) + 1), most)
        if imgui.begin_child("entries", (0.0, height), window_flags=imgui.WindowFlags_.horizontal_scrollbar):
            for number, (name, act) in enumerate(found.items()):
                if imgui.selectable(name, number == self.row)[0]:
                    chosen = act
                if step and number == self.row:
                    imgui.set_scroll_here_y()
        imgui.end_child()
        return chosen
