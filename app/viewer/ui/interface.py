"""The interface over the picture: all its parts, in their order."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.handles import Handles
from irrsplat.app.viewer.ui.key_sheet import draw_key_sheet
from irrsplat.app.viewer.ui.layout import Box, Layout
from irrsplat.app.viewer.ui.legends import draw_legends, draw_record
from irrsplat.app.viewer.ui.line_plot import draw_line, draw_plot
from irrsplat.app.viewer.ui.menus import draw_context_menu, draw_menus
from irrsplat.app.viewer.ui.messages_view import draw_messages
from irrsplat.app.viewer.ui.panels.lights_panel import draw_rings
from irrsplat.app.viewer.ui.panels.plane_panel import draw_values
from irrsplat.app.viewer.ui.panels.why_panel import draw_sight_lines
from irrsplat.app.viewer.ui.prompt_view import PromptView
from irrsplat.app.viewer.ui.side_panel import SidePanel
from irrsplat.app.viewer.ui.statistics_view import FrameTimes


class Interface:
    """The windows that are open; call `draw` between the backend's `begin` and `draw`."""

    def __init__(self, actions: Actions, display: Display, times: FrameTimes) -> None:
        self.actions, self.display, self.layout = actions, display, Layout()
        self.prompt = PromptView()
        self.side_panel = SidePanel(actions, display, self.layout, times)
        self.handles = Handles(actions, self.layout)

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
        actions, panels, layout, display = self.actions, self.actions.panels, self.layout, self.display
        layout.start(scale, panels.controls and not panels.hidden)
        if paint is not None:
            paint(layout.picture)
        actions.editor.handles_used = actions.editor.dragging = False
        if not panels.hidden:
            if display.shows_scene:
                draw_rings(actions, layout)
                draw_values(actions, layout)
                draw_sight_lines(actions, display, layout)
                self.handles.draw()
                draw_line(actions, layout)
            draw_menus(actions)
            draw_context_menu(actions)
            self.side_panel.draw()
            draw_legends(actions, display, layout, cursor)
            if inspected is not None:
                draw_record(inspected, layout)
            draw_plot(actions, display, layout)
            draw_key_sheet(actions, scale)
        self.prompt.draw(actions, layout)
        if not imgui.is_any_item_active() and not imgui.is_mouse_down(imgui.MouseButton_.left):
            actions.editor.settle()
        actions.messages.expire()
        if not panels.hidden or actions.messages.errors:
            draw_messages(actions.messages, layout)
        if own_cursor:
            imgui.set_mouse_cursor(imgui.MouseCursor_.arrow)
