"""The legend of each side in its lower left corner: what is shown, in which colours and units, and the value under the cursor."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.legend import Legend
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.markers import By, radius_legend
from irrsplat.app.viewer.ui.layout import MARGIN, PLAIN, Layout, in_unit
from irrsplat.app.viewer.ui.statistics_view import draw_tracing

_TEXT_WIDTH = 340.0  # at most, window coordinates at scale 1
_BAR_WIDTH = 160.0  # of a colour scale


class Legends:
    """Draws the legends of the sides on show."""

    def __init__(self, actions: Actions, display: Display, layout: Layout) -> None:
        self.actions, self.display, self.layout = actions, display, layout

    def draw(self, cursor: tuple[int, int] | None) -> None:
        """Draw them all. cursor: the pixel under the mouse."""
        session = self.actions.session
        if not session.views:
            return
        view, height = imgui.get_main_viewport(), 0.0
        density = session.size[0] / max(view.size.x, 1.0)  # pixels per window coordinate
        for side, region in session.sides():
            left, width = (region[0], region[2]) if region else (0, session.size[0])
            imgui.set_next_window_pos((left / density + MARGIN, view.size.y - MARGIN), imgui.Cond_.always, (0.0, 1.0))
            imgui.set_next_window_bg_alpha(0.72)
            imgui.begin(f"legend {side}", None, PLAIN | imgui.WindowFlags_.no_inputs)
            room = max(width / density - 4.0 * MARGIN, 60.0)
            imgui.push_text_wrap_pos(min(room, _TEXT_WIDTH * self.layout.scale))
            self._legend(side, cursor if cursor and session.side_at(cursor[0]) == side else None)
            imgui.pop_text_wrap_pos()
            height = max(height, imgui.get_window_height())
            imgui.end()
        self.layout.legend_height = height + 2.0 * MARGIN

    def _legend(self, side: int, cursor: tuple[int, int] | None) -> None:
        session, scale = self.actions.session, self.layout.scale
        options, source = session.options, session.source(side)
        buffer = BUFFERS[options.buffers[side]]
        preset = f"  preset {source.renderer.preset}" if options.split == "presets" else ""
        imgui.text(buffer.title + preset)
        _draw(buffer.legend(source), scale)
        if buffer.needs_truth:
            draw_tracing(self.actions)
        if options.points or options.discs or options.normals:
            by: By = "age" if options.by_age else "radius"
            _draw(radius_legend(source.settings, source.scene, by, source.renderer.cache.count), scale)
        value = self.display.value(side, cursor) if cursor is not None else None
        if value is not None:
            imgui.text(in_unit(" ".join(f"{v:.4g}" for v in value), buffer.unit))


def _draw(legend: Legend, scale: float) -> None:
    """Draw a colour scale with its ends, and the text."""
    if legend.colours is not None:
        imgui.text(legend.low)
        imgui.same_line()
        place, draw = imgui.get_cursor_screen_pos(), imgui.get_window_draw_list()
        width, height = _BAR_WIDTH * scale, imgui.get_text_line_height()
        step = width / len(legend.colours)
        for i, (r, g, b) in enumerate(legend.colours):
            colour = imgui.get_color_u32((float(r), float(g), float(b), 1.0))
            draw.add_rect_filled((place.x + i * step, place.y), (place.x + (i + 1) * step + 0.5, place.y + height), colour)
        if legend.mark is not None and 0.0 <= legend.mark <= 1.0:
            x = place.x + legend.mark * width
            draw.add_line((x, place.y - 2.0), (x, place.y + height + 2.0), imgui.get_color_u32((1.0, 1.0, 1.0, 1.0)), 2.0)
        imgui.dummy((width, height))
        imgui.same_line()
        imgui.text(in_unit(legend.high, legend.unit))
    elif legend.low or legend.high:
        imgui.text(in_unit(f"{legend.low} … {legend.high}", legend.unit))
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
    imgui.text_wrapped(legend.text)
    imgui.pop_style_color()
