"""The inspected record: its numbers, the pixels that it contributes to, and the hemisphere around it."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.layout import MARGIN, PLAIN, Layout

_PICTURE_WIDTH = 170.0


def draw_record(record: InspectedRecord, layout: Layout) -> None:
    """Draw it in the lower right corner."""
    _, _, right, bottom = layout.area
    imgui.set_next_window_pos((right - MARGIN, bottom - MARGIN), imgui.Cond_.always, (1.0, 1.0))
    imgui.set_next_window_bg_alpha(0.8)
    imgui.begin("record", None, PLAIN | imgui.WindowFlags_.no_inputs)
    if imgui.begin_table("numbers of the record", 2, imgui.TableFlags_.sizing_fixed_fit):
        for label, text in (*record.lines, ("contributes to", f"{record.served} pixels")):
            imgui.table_next_column()
            imgui.text_disabled(label)
            imgui.table_next_column()
            imgui.text(text)
        imgui.end_table()
    width, picture = _PICTURE_WIDTH * layout.scale, record.picture
    imgui.image(imgui.ImTextureRef(picture.glo), (width, width * picture.height / picture.width), (0, 1), (1, 0))
    imgui.text_disabled("hemisphere")
    imgui.end()
