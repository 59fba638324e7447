"""The interface over the picture: all its windows, in their order."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.frame_times import FrameTimes
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.app.viewer.ui.layout import Layout
from irrsplat.app.viewer.ui.legends import Legends
from irrsplat.app.viewer.ui.lights_panel import LightsPanel
from irrsplat.app.viewer.ui.menus import Menus
from irrsplat.app.viewer.ui.messages_view import draw_messages
from irrsplat.app.viewer.ui.record_view import RecordView
from irrsplat.app.viewer.ui.settings_panel import SettingsPanel
from irrsplat.app.viewer.ui.sheets import OpenDialog, draw_key_sheet
from irrsplat.app.viewer.ui.statistics_view import StatisticsView


class Interface:
    """Draws the windows that are open; call `draw` between the backend's `begin` and `draw`."""

    def __init__(self, actions: Actions, display: Display, backend: ImguiBackend, times: FrameTimes) -> None:
        self.actions, self.layout = actions, Layout()
        self.menus, self.dialog = Menus(actions), OpenDialog(actions)
        self.settings_panel, self.lights_panel = SettingsPanel(actions, self.layout), LightsPanel(actions, self.layout)
        self.statistics = StatisticsView(actions, times, self.layout)
        self.legends = Legends(actions, display, self.layout)
        self.record = RecordView(actions, backend, self.layout)

    def draw(self, scale: float, inspected: InspectedRecord | None, cursor: tuple[int, int] | None, own_cursor: bool) -> None:
        """Draw all windows. scale: of text and widgets. cursor: the pixel under the mouse. own_cursor: show an arrow there."""
        actions, panels = self.actions, self.actions.panels
        self.layout.scale = scale
        if not panels.hidden:
            self.lights_panel.draw_positions()
            self.menus.draw()
            self.settings_panel.draw()
            self.lights_panel.draw()
            self.statistics.draw()
            self.legends.draw(cursor)
            self.record.draw(inspected)
            draw_key_sheet(actions)
            self.dialog.draw()
        actions.messages.expire()
        if not panels.hidden or actions.messages.errors:
            draw_messages(actions.messages, scale)
        if own_cursor:
            imgui.set_mouse_cursor(imgui.MouseCursor_.arrow)
