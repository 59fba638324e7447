"""The prompt: a line to type into, and the entries that fit its text."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.prompts import Act, Prompt
from irrsplat.app.viewer.ui.layout import Layout

_WIDTH, _ROWS = 460.0, 12  # window coordinates at scale 1, and entries in sight; both at most
_FLAGS = imgui.WindowFlags_.no_collapse | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move


class PromptView:
    """Draws the prompt of the actions while there is one."""

    def __init__(self) -> None:
        self.text = ""
        self._drawn: Prompt | None = None  # in the last frame

    def draw(self, actions: Actions, layout: Layout) -> None:
        """Draw the prompt, and run the chosen entry."""
        prompt, opened = actions.prompt, actions.prompt is not self._drawn
        self._drawn = prompt
        if prompt is None:
            return
        self.text = (prompt.text or "") if opened else self.text
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos((0.5 * view.size.x, 0.12 * view.size.y), imgui.Cond_.always, (0.5, 0.0))
        imgui.set_next_window_size((min(_WIDTH * layout.scale, 0.96 * view.size.x), 0.0))
        imgui.begin("prompt", None, _FLAGS | imgui.WindowFlags_.no_title_bar)
        imgui.text_wrapped(prompt.title)
        chosen = self._choose(prompt, opened, 0.6 * view.size.y)
        left = not opened and not imgui.is_window_focused(imgui.FocusedFlags_.child_windows)
        imgui.end()
        if chosen is not None or left:
            actions.prompt = None
        if chosen is not None:
            actions.attempt(chosen)

    def _choose(self, prompt: Prompt, opened: bool, most: float) -> Act | None:
        """Draw the line and the entries, at most so high; return the chosen one. Enter chooses the first."""
        entered = False
        if opened:
            imgui.set_keyboard_focus_here() if prompt.text is not None else imgui.set_window_focus()
        if prompt.text is not None:
            imgui.set_next_item_width(-1.0)
            entered, self.text = imgui.input_text("##text", self.text, imgui.InputTextFlags_.enter_returns_true)
        found = prompt.entries(self.text)
        chosen = next(iter(found.values()), None) if entered else None
        row = imgui.get_text_line_height_with_spacing()
        if imgui.begin_child("entries", (0.0, min(row * (min(len(found), _ROWS) + 1), most))):
            for number, (name, act) in enumerate(found.items()):
                if imgui.selectable(name, number == 0)[0]:
                    chosen = act
        imgui.end_child()
        return chosen
