"""The interface over the picture: all its parts in their order, messages, the side panel, the menu bar and the context menu."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

from imgui_bundle import imgui, imgui_ctx

from irrsplat import __version__
from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.input.commands import COMMANDS, MENUS, Command
from irrsplat.app.viewer.input.prompts import draw_prompt
from irrsplat.app.viewer.messages import Message, Messages
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.ui import sections
from irrsplat.app.viewer.ui.handles import draw_handles
from irrsplat.app.viewer.ui.layout import AMBER, MARGIN, PLAIN, RED, WHITE, Layout
from irrsplat.app.viewer.ui.legends import draw_legends, draw_line, draw_plot, draw_record
from irrsplat.scene import bundled
from irrsplat.settings import SETTINGS


def draw_messages(messages: Messages, layout: Layout) -> float:
    """Draw the messages next to the side panel. Return the lower edge of errors, which windows over the picture leave free.

    Open menus and dialogs stay in front of the messages.
    """
    left, top, right, _ = layout.area
    place, width = 0.5 * (left + right), right - left - 2.0 * MARGIN
    if messages.errors:
        red, white = imgui.ImVec4(*RED), imgui.ImVec4(*WHITE)
        with imgui_ctx.push_style_color(imgui.Col_.window_bg, red), imgui_ctx.push_style_color(imgui.Col_.text, white):
            top += _lines("errors", messages.errors, (place, top), width, PLAIN, messages.close_errors)
    if notices := [line for line in messages.lines if not line.error]:
        _lines("messages", notices, (place, top), width, PLAIN | imgui.WindowFlags_.no_inputs)
    return top


def _lines(
    name: str, lines: list[Message], place: tuple[float, float], width: float, flags: int, close: Callable[[], None] | None = None
) -> float:
    """Draw lines in a window of their own, centred at `place`; return its height. close: the effect of its button."""
    imgui.set_next_window_pos(place, imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_size_constraints((0.0, 0.0), (max(width, 1.0), imgui.get_main_viewport().size.y))
    imgui.begin(name, None, flags | imgui.WindowFlags_.no_bring_to_front_on_focus)
    with imgui_ctx.push_text_wrap_pos(width - 2.0 * imgui.get_style().window_padding.x):
        for line in lines:
            imgui.text_wrapped(line.text)
    if close is not None and imgui.small_button("close"):
        close()
    height = imgui.get_window_height()
    imgui.end()
    return height


_LINKS = (("All settings…", "settings"), ("Lights…", "lights"), ("Objects…", "outliner"))
_FLAGS = (
    imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_move
    | imgui.WindowFlags_.no_focus_on_appearing  # focus would close a menu that opens in the same frame
)


class Interface:
    """All windows of the interface. Call `draw` between the backend's `begin` and `draw`."""

    def __init__(self, actions: Actions, display: Display) -> None:
        self.actions, self.display, self.layout = actions, display, Layout()
        self._open: set[str] | None = None  # titles of the last frame's sections; None in the first frame, without scrolling
        self._sections: dict[str, tuple[str, Callable[[], None]]] = {  # by title: the option that opens it, its draw call
            "why dark?": ("why", lambda: sections.draw_why(actions, display)),  # answers come first: they grow after a click
            "plane": ("plane", lambda: sections.draw_plane(actions, self.layout)),
            "object": ("mesh", lambda: sections.draw_object(actions, self.layout)),
            "lights": ("lights", lambda: sections.draw_lights(actions, self.layout)),
            "objects": ("outliner", lambda: sections.draw_outliner(actions, self.layout)),
            "settings": ("settings", lambda: sections.draw_settings(actions, self.layout)),
        }

    def draw(self, cursor: tuple[int, int] | None) -> None:
        """Draw all windows. cursor: the pixel under the mouse. The layout is that of this frame."""
        actions, options, layout, display = self.actions, self.actions.session.options, self.layout, self.display
        actions.editor.handles_used = actions.editor.dragging = False
        if options.close_menus:
            imgui.internal.close_popups_except_modals()
            options.close_menus = False
        actions.messages.expire()
        errors = draw_messages(actions.messages, layout) if not options.hidden or actions.messages.errors else 0.0
        if not options.hidden:
            if display.shows_scene:
                sections.draw_rings(actions, layout)
                sections.draw_values(actions, layout)
                draw_handles(actions, layout)
                draw_line(actions, layout)
            draw_menus(actions)
            draw_context_menu(actions)
            self._side_panel()
            legends = draw_legends(actions, display, layout, cursor)
            if display.inspected is not None:
                draw_record(display.inspected, layout, legends)
            draw_plot(actions, display, layout, errors)
        draw_prompt(actions, layout)
        if not imgui.is_any_item_active() and not imgui.is_mouse_down(imgui.MouseButton_.left):
            actions.editor.settle()

    # ---- the side panel --------------------------------------------------------------------------------------------

    @property
    def open_titles(self) -> list[str]:
        actions = self.actions
        picked = actions.editor.mesh is not None
        return [title for title, (opener, _) in self._sections.items() if (picked if opener == "mesh" else actions.is_on(opener))]

    def _side_panel(self) -> None:
        """Draw the panel along the left edge, if it is open."""
        if not self.actions.session.options.controls:
            return
        layout, view = self.layout, imgui.get_main_viewport()
        imgui.internal.begin_viewport_side_bar("side panel", view, imgui.Dir.left, layout.panel, _FLAGS)
        with imgui_ctx.push_item_width(layout.widget):
            self._controls()
            titles = self.open_titles
            for title in titles:
                self._section(title, *self._sections[title])
        imgui.end()
        self._open = set(titles)

    def _section(self, title: str, opener: str, draw: Callable[[], None]) -> None:
        """Draw a section. Scroll to a section that has just opened."""
        actions, style = self.actions, imgui.get_style()
        if self._open is not None and title not in self._open:
            imgui.set_scroll_here_y(0.0)
        tight = 2.0 * self.layout.scale  # window coordinates on both sides of arrow and title; the longest title fits
        with imgui_ctx.push_style_var(imgui.StyleVar_.frame_padding, (min(style.frame_padding.x, tight), style.frame_padding.y)):
            opened, kept = imgui.collapsing_header(title, True, imgui.TreeNodeFlags_.default_open)
        if opened:
            with imgui_ctx.push_id(title):
                actions.attempt(draw)  # a typed number may be beyond the limits of a light or a material
        if opener == "mesh" and not kept:
            actions.editor.mesh = None
        elif not kept:
            actions.toggle(opener)

    def _controls(self) -> None:
        """Draw the buffer, the preset, the first settings and the state."""
        actions = self.actions
        self._buffer()
        sections.draw_presets(actions, self.layout)
        for name in sections.SLIDERS:
            sections.draw_setting(actions, self.layout, SETTINGS[name])
        imgui.separator()
        for title, panel in _LINKS:
            if imgui.selectable(title, actions.is_on(panel))[0]:
                actions.toggle(panel)
        imgui.separator()
        self._state()

    def _buffer(self) -> None:
        actions, shown = self.actions, self.actions.session.options.buffer
        if imgui.begin_combo(self.layout.label("buffer"), BUFFERS[shown].title, imgui.ComboFlags_.height_largest):
            for name, buffer in BUFFERS.items():
                if imgui.selectable(buffer.title, name == shown)[0]:
                    actions.show(name)
                imgui.set_item_tooltip(buffer.help)
            imgui.end_combo()

    def _state(self) -> None:
        """Draw the progress of the picture, and the button for further refinement, which works once the picture is done."""
        actions, session = self.actions, self.actions.session
        for renderer, progress in zip(session.active, session.progress, strict=False):
            who = f"{renderer.preset}: " if len(session.progress) > 1 else ""
            error = "" if progress.error is None else f", estimated error {100.0 * progress.error:.2g} %"
            imgui.text_wrapped(f"{who}{progress.records} records{error}")
            if progress.full:
                imgui.text_colored(AMBER, "max_records is reached")
        done = session.at_rest and session.progress
        if actions.changed:
            imgui.text_colored(AMBER, "changed on disk (F5)")
        if session.options.frozen:
            imgui.text_colored(AMBER, "cache frozen")
        if session.path_recorder.recording is not None:
            imgui.text_colored(AMBER, "recording (R ends it)")
        if session.tracing.traced is not None:
            with imgui_ctx.push_style_color(imgui.Col_.text, imgui.ImVec4(*AMBER)):
                imgui.text_wrapped(f"{session.tracing.progress} ({100.0 * session.tracing.traced:.0f} % done, Y stops it)")
        imgui.text_wrapped("done" if done else "computing…")
        imgui.begin_disabled(not done)
        if imgui.button("Refine further"):
            actions.attempt(actions.refine_further)
        imgui.end_disabled()


_CONTEXT = ("delete", "editor.undo")  # actions on the selected object or light
_TIGHT = 3.0  # window coordinates: the least space on both sides of a title in the bar


def draw_menus(actions: Actions) -> None:
    """Draw the menu bar along the top, and the open menu."""
    if not imgui.begin_main_menu_bar():
        return
    style = imgui.get_style()
    room = imgui.get_main_viewport().size.x - style.window_padding.x
    widths = sum(imgui.calc_text_size(title).x for title in MENUS)
    between = max((room - widths) / (2.0 * len(MENUS)) - 2.0, _TIGHT)  # imgui leaves this space on both sides of a title
    for title in MENUS:
        with imgui_ctx.push_style_var(imgui.StyleVar_.item_spacing, (min(between, style.item_spacing.x), style.item_spacing.y)):
            opened = imgui.begin_menu(title)
        if opened:
            for submenu in dict.fromkeys(one.menu for one in COMMANDS if one.menu.startswith(f"{title}/")):
                if imgui.begin_menu(submenu.split("/")[1]):
                    _menu_entries(actions, submenu)
                    imgui.end_menu()
            _menu_entries(actions, title)
            imgui.end_menu()
    imgui.end_main_menu_bar()


def draw_context_menu(actions: Actions) -> None:
    """Draw the menu that a right click on an object or a light opens."""
    if actions.session.options.context_menu:
        imgui.open_popup("context")
        actions.session.options.context_menu = False
    if imgui.begin_popup("context"):
        for command in COMMANDS:
            if command.action in _CONTEXT:
                _menu_entry(actions, command)
        imgui.end_popup()


def _menu_entries(actions: Actions, menu: str) -> None:
    """Draw the entries of a menu. Scenes, cameras and the version are added, since the table cannot list them."""
    if menu == "Help":
        about = actions.session.renderers[0].about
        imgui.text_disabled(f"irrsplat {__version__}\nOpenGL {about['version']}\n{about['renderer']}")
    for command in COMMANDS:
        if command.menu == menu:
            if command.action == "save_again":
                _menu_scenes(actions)
            if command.section:
                imgui.separator()
            _menu_entry(actions, command)
    if menu == "View/Camera":
        _menu_cameras(actions)


def _menu_entry(actions: Actions, command: Command) -> None:
    if command.action == "editor.redo" and command.shift:
        return  # the second key of the entry above
    if imgui.menu_item(f"{command.title}##{command.menu}", command.shown, actions.is_active(command), actions.can(command))[0]:
        actions.press(command)
    if said := actions.missing(command) or command.help:
        imgui.set_item_tooltip(said)


def _menu_scenes(actions: Actions) -> None:
    names = bundled()
    recent = [source for source in actions.preferences.recent if source not in names]
    if imgui.begin_menu("Open recent", bool(recent)):
        for source in recent:
            if imgui.menu_item(f"{os.path.basename(source)}##{source}", "", actions.source == source)[0]:
                actions.attempt(partial(actions.open, source))
            imgui.set_item_tooltip(source)
        imgui.end_menu()
    imgui.separator_text("Bundled scenes")
    for name in names:
        if imgui.menu_item(name, "", actions.source == name)[0]:
            actions.attempt(partial(actions.open, name))


def _menu_cameras(actions: Actions) -> None:
    imgui.separator()
    for i, camera in enumerate(actions.session.scene.cameras):
        if imgui.menu_item(f"{camera.name or ('first' if i == 0 else f'camera {i + 1}')}##{i}", "", False)[0]:
            actions.session.free_camera.camera = camera
