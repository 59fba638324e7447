"""The dialog that opens a scene: a line to type into, with Tab, the folder that it is about, recent and bundled scenes."""

from __future__ import annotations

import os

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.folder_listing import ENDINGS, FolderListing
from irrsplat.app.viewer.ui.layout import DIALOG
from irrsplat.app.viewer.ui.windows.scene_pictures import ScenePictures
from irrsplat.scene import bundled

_SHARE = (0.8, 0.5)  # of the window: the dialog's width at most, and the height of its lists
_WIDTH = 640.0  # at most, window coordinates at scale 1
_HELP = "Tab completes, ↑ ↓ choose, Enter opens, Esc closes; files can be dropped on the window too"


class OpenDialog:
    """Asks for a scene's file. typed: what stands in its line. folder: what that is relative to."""

    def __init__(self, actions: Actions, pictures: ScenePictures) -> None:
        self.actions, self.pictures = actions, pictures
        self.typed, self.folder = "", os.getcwd()
        self._listing = FolderListing()
        self._chosen = -1  # number of the list's entry that the arrow keys have come to
        self._again = False  # whether the line gets the keyboard in the next frame

    def draw(self, scale: float) -> None:
        """Draw it where it is open."""
        actions = self.actions
        if not actions.panels.open:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_bg_alpha(0.97)
        flags = imgui.WindowFlags_.always_auto_resize | DIALOG | imgui.WindowFlags_.no_saved_settings
        shown, opened = imgui.begin("open a scene", True, flags)
        actions.panels.open = bool(opened)
        if shown:
            width = min(_SHARE[0] * view.size.x, _WIDTH * scale)
            if imgui.is_window_appearing() and os.path.isfile(actions.source):
                self.folder = os.path.dirname(os.path.abspath(actions.source))
            self._line(width)
            height = max(_SHARE[1] * view.size.y, 60.0)
            gap = imgui.get_style().item_spacing.x
            self._files((0.62 * width - gap, height))
            imgui.same_line()
            self._known((0.38 * width, height), scale)
            imgui.push_text_wrap_pos(imgui.get_cursor_pos().x + width)
            imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
            imgui.text_wrapped(f"{' '.join(ENDINGS)}, or a bundled scene's name")
            imgui.text_wrapped(_HELP)
            imgui.pop_style_color()
            imgui.pop_text_wrap_pos()
        imgui.end()

    def _line(self, width: float) -> None:
        """Draw the line, and the button beside it."""
        if imgui.is_window_appearing() or self._again:
            imgui.set_keyboard_focus_here()
            self._again = False
        style, flags = imgui.get_style(), imgui.InputTextFlags_
        button = imgui.calc_text_size("open").x + 2.0 * style.frame_padding.x
        imgui.set_next_item_width(width - button - style.item_spacing.x)
        wanted = flags.enter_returns_true | flags.callback_completion | flags.callback_history | flags.callback_edit
        entered, self.typed = imgui.input_text("##path", self.typed, wanted, self._on_key)
        imgui.same_line()
        if imgui.button("open") or entered:
            self._enter()

    def _on_key(self, data: imgui.InputTextCallbackData) -> int:
        """Tab completes, the arrows choose; whatever is typed lets go of what was chosen."""
        if data.event_flag == imgui.InputTextFlags_.callback_completion:
            text = self._listing.completed(str(data.buf), self.folder)
            data.delete_chars(0, data.buf_text_len)
            data.insert_chars(0, text)
        elif data.event_flag == imgui.InputTextFlags_.callback_history:
            count = len(self._entries)
            step = 1 if data.event_key == imgui.Key.down_arrow else -1
            self._chosen = min(max(self._chosen + step, -1), count - 1)
        else:
            self._chosen = -1
        return 0

    @property
    def _entries(self) -> tuple[str, ...]:
        """What the list shows."""
        return tuple(entry.shown for entry in self._listing.entries(*self._listing.place(self.typed, self.folder)))

    def _enter(self) -> None:
        """Open what is chosen or typed, or go into that folder."""
        entries = self._entries
        if 0 <= self._chosen < len(entries):
            self._take(entries[self._chosen])
        elif self.typed.strip():
            self._go(self._listing.found(self.typed.strip(), self.folder))

    def _take(self, entry: str) -> None:
        """Open an entry of the list, or go into it."""
        self._go(os.path.join(self._listing.place(self.typed, self.folder)[0], entry.rstrip("/")))

    def _go(self, source: str) -> None:
        """Open a scene or a path, or go into a folder."""
        if os.path.isdir(source):
            self.folder, self.typed, self._chosen, self._again = os.path.abspath(source), "", -1, True
            return
        self._again = not self.actions.attempt(lambda: self.actions.open(source))
        if not self._again:
            self.actions.panels.open = False
            self.typed, self._chosen = "", -1

    def _files(self, size: tuple[float, float]) -> None:
        """Draw the folder that the line is about."""
        where = self._listing.place(self.typed, self.folder)[0]
        imgui.begin_child("files", size, imgui.ChildFlags_.borders)
        imgui.push_text_wrap_pos(0.0)
        imgui.text_disabled(where)
        imgui.pop_text_wrap_pos()
        if imgui.selectable("..", False)[0]:
            self._go(os.path.dirname(where))
        for i, name in enumerate(self._entries):
            if imgui.selectable(name, i == self._chosen)[0]:
                self._take(name)
            if i == self._chosen:
                imgui.set_scroll_here_y()
        imgui.end_child()

    def _known(self, size: tuple[float, float], scale: float) -> None:
        """Draw the recent and the bundled scenes, with what they looked like last."""
        recent = [source for source in self.actions.preferences.recent if source not in bundled()]
        imgui.begin_child("known", size, imgui.ChildFlags_.borders)
        for title, sources in (("recent", recent), ("bundled", list(bundled()))):
            if sources:
                imgui.separator_text(title)
            for source in sources:
                if imgui.selectable(f"{os.path.basename(source)}##{source}", source == self.actions.source)[0]:
                    self._go(source)
                self.pictures.tooltip(source, scale)
        imgui.end_child()
