"""The record inspected: its numbers, the pixels it serves, and the hemisphere that it saw."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.app.viewer.ui.layout import MARGIN, PLAIN, Layout

_PICTURE_WIDTH = 170.0


class RecordView:
    """Draws the window of the record inspected."""

    def __init__(self, actions: Actions, backend: ImguiBackend, layout: Layout) -> None:
        self.actions, self.backend, self.layout = actions, backend, layout
        self._height = 0.0  # that it took last, without its last line

    def draw(self, record: InspectedRecord | None) -> None:
        """Draw it in the lower right corner: below the statistics where there is room, else beside them."""
        if record is None:
            return
        scale, (_, top, right, bottom) = self.layout.scale, self.layout.area
        width, height = self.layout.statistics_size if self.actions.panels.hud else (0.0, 0.0)
        overlaps = top + height + self._height + 2.0 * MARGIN > bottom
        right = right - MARGIN - (width + MARGIN if overlaps else 0.0)
        imgui.set_next_window_pos((right, bottom - MARGIN), imgui.Cond_.always, (1.0, 1.0))
        imgui.set_next_window_bg_alpha(0.8)
        imgui.begin("record", None, PLAIN | imgui.WindowFlags_.no_inputs)
        if imgui.begin_table("numbers of the record", 2, imgui.TableFlags_.sizing_fixed_fit):
            for label, text in (*record.lines, ("serves", f"{record.served} pixels")):
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_disabled(label)
                imgui.table_next_column()
                imgui.text(text)
            imgui.end_table()
        width = _PICTURE_WIDTH * scale
        self.backend.image(record.picture, (width, width * record.picture.height / record.picture.width))
        self._height = imgui.get_window_height()
        imgui.text_disabled("what it sees" + ("; held" if self.actions.session.held is not None else "; a click holds it"))
        imgui.end()
