"""The panel at the side: the first settings, and a section for each part that is open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.ui.layout import Layout, accent
from irrsplat.app.viewer.ui.settings_panel import SettingsPanel
from irrsplat.app.viewer.ui.statistics_view import draw_tracing
from irrsplat.settings import SETTINGS

FIRST = ("a", "tolerance", "blend", "exposure")  # settings
_LINKS = (("All settings…", "settings"), ("Lights…", "lights"), ("Objects…", "outliner"), ("Statistics…", "hud"))
_FLAGS = (
    imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_move
    | imgui.WindowFlags_.no_focus_on_appearing  # it would close a menu that opens in the same frame
)


@dataclass(frozen=True)
class Section:
    """A part of the panel. is_open: True while it is open. close: what its cross does; None for no cross."""

    title: str
    is_open: Callable[[], bool]
    draw: Callable[[], None]
    close: Callable[[], None] | None = None


class SidePanel:
    """Draws the panel along the left edge.

    Without the first settings, open sections lie over the picture. left: their distance from the edge, window coordinates.
    """

    left = 0.0

    def __init__(self, actions: Actions, settings: SettingsPanel, layout: Layout, sections: Sequence[Section]) -> None:
        self.actions, self.settings, self.layout, self.sections = actions, settings, layout, sections
        self._open: set[str] | None = None  # titles of the last frame's sections; None at first, when nothing scrolls

    def draw(self) -> None:
        """Draw the panel if the first settings or a section are open."""
        layout, controls = self.layout, self.actions.panels.controls
        shown = [section for section in self.sections if section.is_open()]
        if controls:
            view = imgui.get_main_viewport()
            imgui.internal.begin_viewport_side_bar("side panel", view, imgui.Dir.left, layout.panel, _FLAGS)
        elif shown:
            left, top, _, bottom = layout.area
            imgui.set_next_window_pos((left + self.left, top))
            imgui.set_next_window_size_constraints(
                (layout.panel, 0.0), (layout.panel, max(bottom - top - layout.legend_height, 1.0))
            )
            imgui.begin("sections", None, _FLAGS | imgui.WindowFlags_.always_auto_resize)
            layout.over = left + self.left + layout.panel
        if controls or shown:
            imgui.push_item_width(layout.widget)
            if controls:
                self._controls()
            for section in shown:
                self._section(section)
            imgui.pop_item_width()
            imgui.end()
        self._open = {section.title for section in shown}

    def _section(self, section: Section) -> None:
        """Draw a section; scroll to one that has just opened and is not all in sight."""
        top = imgui.get_cursor_pos().y
        unfolded, kept, style = int(imgui.TreeNodeFlags_.default_open), True, imgui.get_style()
        tight = 2.0 * self.layout.scale  # on both sides of arrow and title, so that the longest title fits
        imgui.push_style_var(imgui.StyleVar_.frame_padding, (min(style.frame_padding.x, tight), style.frame_padding.y))
        if section.close is None:
            opened = imgui.collapsing_header(section.title, unfolded)
        else:
            opened, kept = imgui.collapsing_header(section.title, True, unfolded)
        imgui.pop_style_var()
        if opened:
            imgui.push_id(section.title)
            section.draw()
            imgui.pop_id()
        below = imgui.get_cursor_pos().y - imgui.get_scroll_y() > imgui.get_window_height()
        if below and self._open is not None and section.title not in self._open:
            imgui.set_scroll_y(top)
        if section.close is not None and not kept:
            section.close()

    def _controls(self) -> None:
        """Draw the buffer, the preset, the first settings and the state."""
        actions = self.actions
        if actions.session.options.split != "off":
            self.settings.draw_sides()
        self._buffer()
        self.settings.draw_presets()
        for name in FIRST:
            self.settings.draw_setting(SETTINGS[name])
        imgui.separator()
        for title, panel in _LINKS:
            if imgui.selectable(title, actions.is_on(panel))[0]:
                actions.toggle(panel)
        imgui.separator()
        self._state()

    def _buffer(self) -> None:
        actions, options = self.actions, self.actions.session.options
        side = actions.side if options.split != "off" else 0
        label = self.layout.label("buffer")
        if imgui.begin_combo(label, BUFFERS[options.buffers[side]].title, imgui.ComboFlags_.height_largest):
            for one, buffer in BUFFERS.items():
                if imgui.selectable(buffer.title, one == options.buffers[side])[0]:
                    actions.show(one)
                imgui.set_item_tooltip(buffer.help)
            imgui.end_combo()

    def _state(self) -> None:
        """Write the progress of the picture, and offer more once it is done."""
        actions, session = self.actions, self.actions.session
        for renderer, progress in zip(session.active, session.progress, strict=False):
            who = f"{renderer.preset}: " if len(session.progress) > 1 else ""
            error = "" if progress.error is None else f", estimated error {100.0 * progress.error:.2g} %"
            imgui.text_wrapped(f"{who}{progress.records} records{error}")
        recorder, done = session.path_recorder, session.at_rest and session.progress
        for true, words in (
            (session.options.frozen, "cache frozen"),
            (recorder.recording is not None, "recording (R ends it)"),
            (recorder.playing is not None, "playing (P stops it)"),
        ):
            if true:
                imgui.text_colored(accent(), words)
        draw_tracing(actions)
        imgui.text_wrapped("done" if done else "computing…")
        if done and imgui.button("Refine further"):
            actions.attempt(actions.refine_further)
