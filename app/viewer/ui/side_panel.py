"""The panel at the side: the first settings, and a section for each part that is open."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.ui.layout import AMBER, Layout
from irrsplat.app.viewer.ui.panels.editing_panels import draw_lights, draw_object, draw_outliner
from irrsplat.app.viewer.ui.panels.light_panels import draw_light_scale, draw_plane, draw_why, light_is_shown
from irrsplat.app.viewer.ui.panels.settings_panel import SLIDERS, draw_presets, draw_setting, draw_settings, draw_sides
from irrsplat.settings import SETTINGS

_LINKS = (("All settings…", "settings"), ("Lights…", "lights"), ("Objects…", "outliner"))
_FLAGS = (
    imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_move
    | imgui.WindowFlags_.no_focus_on_appearing  # it would close a menu that opens in the same frame
)


class SidePanel:
    """Draws the panel along the left edge."""

    def __init__(self, actions: Actions, display: Display, layout: Layout) -> None:
        self.actions, self.layout = actions, layout
        self._open: set[str] | None = None  # titles of the last frame's sections; None at first, when nothing scrolls
        self._sections: dict[str, tuple[str, Callable[[], None]]] = {  # by title: what opens it, and what draws it
            "object": ("mesh", lambda: draw_object(actions, layout)),
            "lights": ("lights", lambda: draw_lights(actions, layout)),
            "objects": ("outliner", lambda: draw_outliner(actions)),
            "why dark?": ("why", lambda: draw_why(actions, display)),
            "plane": ("plane", lambda: draw_plane(actions, layout)),
            "scale": ("", lambda: draw_light_scale(actions, layout)),
            "settings": ("settings", lambda: draw_settings(actions, layout)),
        }

    @property
    def open_titles(self) -> list[str]:
        """The titles of the open sections."""
        actions = self.actions
        states = {"mesh": actions.editor.mesh is not None, "": light_is_shown(actions)}
        return [title for title, (opener, _) in self._sections.items() if states.get(opener) or actions.is_on(opener)]

    def draw(self) -> None:
        """Draw the panel if it is open."""
        if not self.actions.panels.controls:
            return
        layout, view = self.layout, imgui.get_main_viewport()
        imgui.internal.begin_viewport_side_bar("side panel", view, imgui.Dir.left, layout.panel, _FLAGS)
        imgui.push_item_width(layout.widget)
        self._controls()
        titles = self.open_titles
        for title in titles:
            self._section(title, *self._sections[title])
        imgui.pop_item_width()
        imgui.end()
        self._open = set(titles)

    def _section(self, title: str, opener: str, draw: Callable[[], None]) -> None:
        """Draw a section; scroll to one that has just opened and is not all in sight."""
        top, actions = imgui.get_cursor_pos().y, self.actions
        unfolded, kept, style = int(imgui.TreeNodeFlags_.default_open), True, imgui.get_style()
        tight = 2.0 * self.layout.scale  # on both sides of arrow and title, so that the longest title fits
        imgui.push_style_var(imgui.StyleVar_.frame_padding, (min(style.frame_padding.x, tight), style.frame_padding.y))
        if opener:
            opened, kept = imgui.collapsing_header(title, True, unfolded)
        else:
            opened = imgui.collapsing_header(title, unfolded)
        imgui.pop_style_var()
        if opened:
            imgui.push_id(title)
            draw()
            imgui.pop_id()
        below = imgui.get_cursor_pos().y - imgui.get_scroll_y() > imgui.get_window_height()
        if below and self._open is not None and title not in self._open:
            imgui.set_scroll_y(top)
        if opener == "mesh" and not kept:
            actions.editor.mesh = None
        elif opener and not kept:
            actions.toggle(opener)

    def _controls(self) -> None:
        """Draw the buffer, the preset, the first settings and the state."""
        actions = self.actions
        if actions.session.options.split != "off":
            draw_sides(actions)
        self._buffer()
        draw_presets(actions, self.layout)
        for name in SLIDERS:
            draw_setting(actions, self.layout, SETTINGS[name])
        imgui.separator()
        for title, panel in _LINKS:
            if imgui.selectable(title, actions.is_on(panel))[0]:
                actions.toggle(panel)
        imgui.separator()
        self._state()

    def _buffer(self) -> None:
        actions, shown = self.actions, self.actions.shown_buffer
        if imgui.begin_combo(self.layout.label("buffer"), BUFFERS[shown].title, imgui.ComboFlags_.height_largest):
            for name, buffer in BUFFERS.items():
                if imgui.selectable(buffer.title, name == shown)[0]:
                    actions.show(name)
                imgui.set_item_tooltip(buffer.help)
            imgui.end_combo()

    def _state(self) -> None:
        """Write the progress of the picture, and a button for more, which works once it is done."""
        actions, session = self.actions, self.actions.session
        for renderer, progress in zip(session.active, session.progress, strict=False):
            who = f"{renderer.preset}: " if len(session.progress) > 1 else ""
            error = "" if progress.error is None else f", estimated error {100.0 * progress.error:.2g} %"
            imgui.text_wrapped(f"{who}{progress.records} records{error}")
            if progress.full:
                imgui.text_colored(AMBER, "max_records is reached")
        recorder, done = session.path_recorder, session.at_rest and session.progress
        for true, words in (
            (session.options.frozen, "cache frozen"),
            (recorder.recording is not None, "recording (R ends it)"),
            (recorder.playing is not None, "playing (P stops it)"),
        ):
            if true:
                imgui.text_colored(AMBER, words)
        if session.tracing.traced is not None:
            imgui.push_style_color(imgui.Col_.text, AMBER)
            imgui.text_wrapped(f"{session.tracing.progress} ({100.0 * session.tracing.traced:.0f} % done, Y stops it)")
            imgui.pop_style_color()
        imgui.text_wrapped("done" if done else "computing…")
        imgui.begin_disabled(not done)
        if imgui.button("Refine further"):
            actions.attempt(actions.refine_further)
        imgui.end_disabled()
