"""The interface over the picture: all its windows, in their order."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.controls_panel import ControlsPanel
from irrsplat.app.viewer.ui.editing.handles import Handles
from irrsplat.app.viewer.ui.editing.object_panel import ObjectPanel
from irrsplat.app.viewer.ui.frame_times import FrameTimes
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.app.viewer.ui.layout import Box, Layout
from irrsplat.app.viewer.ui.legends import Legends
from irrsplat.app.viewer.ui.lights_panel import LightsPanel
from irrsplat.app.viewer.ui.menus import Menus
from irrsplat.app.viewer.ui.messages_view import draw_messages
from irrsplat.app.viewer.ui.record_view import RecordView
from irrsplat.app.viewer.ui.settings_panel import SettingsPanel
from irrsplat.app.viewer.ui.statistics_view import StatisticsView
from irrsplat.app.viewer.ui.windows.about import draw_about
from irrsplat.app.viewer.ui.windows.file_dialogs import FileDialogs
from irrsplat.app.viewer.ui.windows.key_sheet import draw_key_sheet
from irrsplat.app.viewer.ui.windows.light_scale_panel import LightScalePanel
from irrsplat.app.viewer.ui.windows.line_plot import LinePlot
from irrsplat.app.viewer.ui.windows.message_log import draw_log
from irrsplat.app.viewer.ui.windows.palette import Palette
from irrsplat.app.viewer.ui.windows.unsaved import draw_unsaved


class Interface:
    """The windows that are open; call `draw` between the backend's `begin` and `draw`. native: the desktop's dialogs may open."""

    def __init__(self, actions: Actions, display: Display, backend: ImguiBackend, times: FrameTimes, native: bool) -> None:
        self.actions, self.display, self.layout = actions, display, Layout()
        self.menus, self.files = Menus(actions, self.layout), FileDialogs(actions, native)
        self.settings_panel, self.lights_panel = SettingsPanel(actions, self.layout), LightsPanel(actions, self.layout)
        self.controls = ControlsPanel(actions, self.settings_panel, self.layout)
        self.palette = Palette(actions, self.settings_panel.show)
        self.light_scale_panel = LightScalePanel(actions, self.layout)
        self.handles, self.object_panel = Handles(actions, self.layout), ObjectPanel(actions, self.layout)
        self.statistics = StatisticsView(actions, times, self.layout)
        self.legends = Legends(actions, display, self.layout)
        self.line_plot = LinePlot(actions, display, self.layout)
        self.record = RecordView(actions, backend, self.layout)

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
        if actions.restoring_layout:
            actions.restoring_layout = False
            self.layout.restore()
        self.layout.start(scale, panels.hidden, panels.controls)
        if paint is not None:
            paint(self.layout.picture)
        if not panels.hidden:
            self.lights_panel.draw_positions()
            self.handles.draw()
            self.menus.draw()
            self.controls.draw()
            self.settings_panel.draw()
            self.lights_panel.draw()
            self.light_scale_panel.draw()
            self.object_panel.draw()
            self.statistics.draw()
            self.legends.draw(cursor)
            self.record.draw(inspected)
            self.line_plot.draw()
            draw_key_sheet(actions, scale)
            draw_about(actions)
            draw_log(actions)
            self.files.draw()
            self.palette.draw(scale)
        else:
            actions.editor.handles_used = actions.editor.dragging = False
        draw_unsaved(actions)
        if not imgui.is_any_item_active() and not imgui.is_mouse_down(imgui.MouseButton_.left):
            actions.editor.settle()
        self.display.margins = self.layout.margins(panels.settings, panels.hud, panels.hidden)
        actions.messages.expire()
        if not panels.hidden or actions.messages.errors:
            numbers = panels.hud and not panels.hidden
            draw_messages(actions.messages, self.layout, numbers, typing=actions.typing)
        if own_cursor:
            imgui.set_mouse_cursor(imgui.MouseCursor_.arrow)
