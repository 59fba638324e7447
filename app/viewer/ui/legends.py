"""The legend of each side in its lower left corner: what is shown, in which colours and units, and the value under the cursor."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.legend import Legend
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.markers import By, radius_legend
from irrsplat.app.viewer.ui.layout import MARGIN, NO_SCROLLBAR, PLAIN, Layout, in_unit
from irrsplat.app.viewer.ui.statistics_view import draw_tracing

_TEXT_WIDTH = 340.0  # at most, window coordinates at scale 1
_BAR_WIDTH = 160.0  # of a colour scale
_MOST, _LEAST = 0.4, 3.0  # of the height: a longer one scrolls; and what it has at least, heights of the font


class Legends:
    """Draws the legends of the sides on show."""

    def __init__(self, actions: Actions, display: Display, layout: Layout) -> None:
        self.actions, self.display, self.layout = actions, display, layout
        self._heights: dict[int, float] = {}  # that they would take, by their sides

    def draw(self, cursor: tuple[int, int] | None) -> None:
        """Draw them all. cursor: the pixel under the mouse."""
        session = self.actions.session
        if not session.views:
            return
        view, taken = imgui.get_main_viewport(), 0.0
        density = session.size[0] / max(self.layout.picture_size[0], 1.0)  # pixels per window coordinate
        first, top, last, bottom = self.layout.area
        for side, region in session.sides():
            x, width = (region[0] / density, region[2] / density) if region else (0.0, self.layout.picture_size[0])
            x += self.layout.picture[0]
            left, right = min(max(x, first), last), max(min(x + width, last), first)
            imgui.set_next_window_pos((left + MARGIN, bottom - MARGIN), imgui.Cond_.always, (0.0, 1.0))
            imgui.set_next_window_bg_alpha(0.72)
            most = max(_MOST * (bottom - top), _LEAST * imgui.get_font_size())
            imgui.set_next_window_size_constraints((0.0, 0.0), (view.size.x, most))
            # one that is too long takes the mouse, so that it can be scrolled; others let it through to the picture
            scrolls = self._heights.get(side, 0.0) > most + 1.0
            imgui.begin(f"legend {side}", None, PLAIN & ~NO_SCROLLBAR if scrolls else PLAIN | imgui.WindowFlags_.no_inputs)
            room = max(right - left - 4.0 * MARGIN, 60.0)
            imgui.push_text_wrap_pos(min(room, _TEXT_WIDTH * self.layout.scale))
            self._legend(side, cursor if cursor and session.side_at(cursor[0]) == side else None)
            imgui.pop_text_wrap_pos()
            style = imgui.get_style()
            self._heights[side] = imgui.get_cursor_pos().y - style.item_spacing.y + style.window_padding.y
            taken = max(taken, imgui.get_window_height())
            if side == 0:
                self.layout.legend_right = imgui.get_window_pos().x + imgui.get_window_width()
            imgui.end()
        self.layout.legend_height = taken + 2.0 * MARGIN + view.size.y - bottom

    def _value(self, side: int, cursor: tuple[int, int]) -> str:
        """The value at a pixel, in its unit; empty where there is none."""
        session, value = self.actions.session, self.display.value(side, cursor)
        buffer = BUFFERS[session.buffer(side)]
        unit = buffer.unit_shown(session.source(side))
        if value is not None and buffer.name == "position" and any(session.origin) and not session.compared:
            return in_unit(" ".join(f"{v:.3f}" for v in value.astype(float) + session.origin), unit)
        return "" if value is None else in_unit(" ".join(f"{v:.4g}" for v in value), unit)

    def _legend(self, side: int, cursor: tuple[int, int] | None) -> None:
        session, scale = self.actions.session, self.layout.scale
        options, source = session.options, session.source(side)
        buffer = BUFFERS[session.buffer(side)]
        if session.compared:
            comparison = self.display.comparison
            imgui.text_wrapped(comparison.title)
            _draw(comparison.legend(), scale)
        else:
            who = f"{('left', 'right')[side]}: " if options.split != "off" and options.compare == "flip" else ""
            preset = f"  preset {source.renderer.preset}" if options.split == "presets" else ""
            imgui.text(who + buffer.title + preset)
            _draw(buffer.legend(source), scale)
        if buffer.needs_truth:
            draw_tracing(self.actions)
        if (options.points or options.discs or options.normals) and not session.compared:
            by: By = "age" if options.by_age else "radius"
            _draw(radius_legend(source.settings, source.scene, by, source.renderer.cache.count), scale)
        value = self._value(side, cursor) if cursor is not None else ""
        if value:
            imgui.text(value)


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
