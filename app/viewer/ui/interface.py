"""The interface over the picture: all its parts, in their order."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.editing.handles import Handles
from irrsplat.app.viewer.ui.editing.object_panel import ObjectPanel, draw_outliner
from irrsplat.app.viewer.ui.layout import Box, Layout
from irrsplat.app.viewer.ui.legends import Legends
from irrsplat.app.viewer.ui.lights_panel import LightsPanel
from irrsplat.app.viewer.ui.menus import Menus
from irrsplat.app.viewer.ui.messages_view import draw_messages
from irrsplat.app.viewer.ui.record_view import draw_record
from irrsplat.app.viewer.ui.settings_panel import SettingsPanel
from irrsplat.app.viewer.ui.side_panel import Section, SidePanel
from irrsplat.app.viewer.ui.statistics_view import FrameTimes, StatisticsView
from irrsplat.app.viewer.ui.windows.file_dialogs import FileDialogs, draw_unsaved
from irrsplat.app.viewer.ui.windows.key_sheet import draw_key_sheet
from irrsplat.app.viewer.ui.windows.light_scale_panel import LightScalePanel
from irrsplat.app.viewer.ui.windows.line_plot import LinePlot
from irrsplat.app.viewer.ui.windows.palette import Palette
from irrsplat.app.viewer.ui.windows.plane_panel import PlanePanel
from irrsplat.app.viewer.ui.windows.why_panel import WhyPanel


class Interface:
    """The windows that are open; call `draw` between the backend's `begin` and `draw`. native: the desktop's dialogs may open."""

    def __init__(self, actions: Actions, display: Display, times: FrameTimes, native: bool) -> None:
        self.actions, self.display, self.layout = actions, display, Layout()
        self.menus, self.files = Menus(actions), FileDialogs(actions, native)
        self.lights_panel, settings = LightsPanel(actions, self.layout), SettingsPanel(actions, self.layout)
        scale_panel, statistics = LightScalePanel(actions, self.layout), StatisticsView(actions, times)
        self.plane_panel, self.why_panel = PlanePanel(actions, self.layout), WhyPanel(actions, display, self.layout)
        sections = (
            Section(
                "object",
                lambda: actions.editor.mesh is not None,
                ObjectPanel(actions, self.layout).draw,
                lambda: actions.editor.pick_mesh(None),
            ),
            self._switched("lights", "lights", self.lights_panel.draw),
            self._switched("objects", "outliner", lambda: draw_outliner(actions)),
            self._switched("why dark?", "why", self.why_panel.draw),
            self._switched("plane", "plane", self.plane_panel.draw),
            Section("scale", lambda: scale_panel.is_open, scale_panel.draw),
            self._switched("settings", "settings", settings.draw),
            self._switched("statistics", "hud", statistics.draw),
        )
        self.side_panel = SidePanel(actions, settings, self.layout, sections)
        self.palette = Palette(actions, settings.show)
        self.handles = Handles(actions, self.layout)
        self.legends = Legends(actions, display, self.layout)
        self.line_plot = LinePlot(actions, display, self.layout)

    def _switched(self, title: str, panel: str, draw: Callable[[], None]) -> Section:
        """Return the section that an action opens and closes."""
        actions = self.actions
        return Section(title, lambda: actions.is_on(panel), draw, lambda: actions.toggle(panel))

    def draw(
        self,
        scale: float,
        inspected: InspectedRecord | None,
        cursor: tuple[int, int] | None,
        own_cursor: bool,
        paint: Callable[[Box], None] | None = None,
    ) -> None:
        """Draw all windows. scale: of text and widgets. cursor: the pixel under the mouse. own_cursor: show an arrow there.
        paint: puts the picture below all else."""
        actions, panels = self.actions, self.actions.panels
        self.layout.start(scale, panels.controls and not panels.hidden)
        if paint is not None:
            paint(self.layout.picture)
        actions.editor.handles_used = actions.editor.dragging = False
        if not panels.hidden:
            if self.display.shows_scene:
                self.lights_panel.draw_positions()
                self.plane_panel.draw_values()
                self.why_panel.draw_lines()
                self.handles.draw()
                self.line_plot.draw_line()
            self.menus.draw()
            self.menus.draw_context()
            self.side_panel.draw()
            self.legends.draw(cursor)
            if inspected is not None:
                draw_record(inspected, self.layout)
            self.line_plot.draw()
            draw_key_sheet(actions, scale)
            self.files.draw()
            self.palette.draw(scale)
        draw_unsaved(actions)
        if not imgui.is_any_item_active() and not imgui.is_mouse_down(imgui.MouseButton_.left):
            actions.editor.settle()
        actions.messages.expire()
        if not panels.hidden or actions.messages.errors:
            draw_messages(actions.messages, self.layout)
        if own_cursor:
            imgui.set_mouse_cursor(imgui.MouseCursor_.arrow)
