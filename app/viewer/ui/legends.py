"""Numbers over the picture: the legends of sides and of the inspected record, and the plot along the measuring line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import imgui, imgui_ctx, implot

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.shown_buffer import Legend
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.display import Display, Profile
from irrsplat.app.viewer.show.markers import radius_legend
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.layout import AMBER, MARGIN, PLAIN, WHITE, Layout, dot, in_unit, line

_TEXT_WIDTH = 340.0  # window coordinates at scale 1: the greatest width of the text
_ACROSS, _DOWN = 0.6, 0.2  # shares of the picture: the greatest width of a legend, and the greatest height of its text
_WORD = 5.5  # font heights: the width of the longest word of a title
_BAR_WIDTH = 160.0  # window coordinates at scale 1: the width of a colour scale
_PICTURE_WIDTH = 170.0  # window coordinates at scale 1: the width of a record's hemisphere


def draw_legends(actions: Actions, display: Display, layout: Layout, cursor: tuple[int, int] | None) -> float:
    """Draw the legend of each side. Return their upper edge, window coordinates."""
    session, top = actions.session, layout.area[3]
    if not session.views:
        return top
    density = session.size[0] / max(layout.picture_size[0], 1.0)  # pixels per window coordinate
    first, _, last, bottom = layout.area
    for side, region in session.sides():
        x, width = (region[0] / density, region[2] / density) if region else (0.0, layout.picture_size[0])
        left, right = (min(max(end + layout.picture[0], first), last) for end in (x, x + width))
        imgui.set_next_window_pos((left + MARGIN, bottom - MARGIN), imgui.Cond_.always, (0.0, 1.0))
        imgui.set_next_window_bg_alpha(0.72)
        imgui.begin(f"legend {side}", None, PLAIN | imgui.WindowFlags_.no_inputs)
        room = min(max(_ACROSS * (right - left), _WORD * imgui.get_font_size()), _TEXT_WIDTH * layout.scale)
        with imgui_ctx.push_text_wrap_pos(room):
            _draw_legend(actions, side, layout, room)
            if cursor is not None and session.side_at(cursor[0]) == side and (value := display.value(cursor)) is not None:
                legend = BUFFERS[session.options.buffer].legend(session.source(side))
                imgui.text(in_unit(" ".join(f"{v:{legend.form}}" for v in value), legend.unit))
        top = min(top, imgui.get_window_pos().y)
        imgui.end()
    return top


def _draw_legend(actions: Actions, side: int, layout: Layout, room: float) -> None:
    """Draw titles and scales. A text that would cover too much of the picture is left out."""
    options, source = actions.session.options, actions.session.source(side)
    buffer = BUFFERS[options.buffer]
    who = f"{('left', 'right')[side]}: " if options.divider in (0.0, 1.0) else ""
    preset = f"  preset {source.renderer.preset}" if options.split else ""
    imgui.text(who + buffer.title + preset)
    legends = [buffer.legend(source)]
    if options.discs:
        legends.append(radius_legend(source.renderer.settings, actions.session.extent))
    for legend in legends:
        fits = imgui.calc_text_size(legend.text, wrap_width=room).y <= _DOWN * layout.picture_size[1]
        draw_scale(legend if fits else replace(legend, text=""), layout.scale, room)


def draw_scale(legend: Legend, scale: float, room: float) -> None:
    """Draw a colour scale with its ends, at most `room` window coordinates wide, and the text of the legend."""
    imgui.push_text_wrap_pos(-1.0)  # a scale stays in one line
    if legend.colours is not None:
        imgui.text(legend.low)
        imgui.same_line()
        place, draw = imgui.get_cursor_screen_pos(), imgui.get_window_draw_list()
        ends = imgui.calc_text_size(legend.low).x + imgui.calc_text_size(in_unit(legend.high, legend.unit)).x
        width = min(_BAR_WIDTH * scale, room - ends - 2.0 * imgui.get_style().item_spacing.x - imgui.get_style().window_padding.x)
        width, height = max(width, imgui.get_font_size()), imgui.get_text_line_height()
        step = width / len(legend.colours)
        for i, (r, g, b) in enumerate(legend.colours):
            colour = imgui.get_color_u32((float(r), float(g), float(b), 1.0))
            draw.add_rect_filled((place.x + i * step, place.y), (place.x + (i + 1) * step + 0.5, place.y + height), colour)
        if legend.mark is not None and 0.0 <= legend.mark <= 1.0:
            x = place.x + legend.mark * width
            draw.add_line((x, place.y - 2.0), (x, place.y + height + 2.0), imgui.get_color_u32(WHITE), 2.0)
        imgui.dummy((width, height))
        imgui.same_line()
        imgui.text(in_unit(legend.high, legend.unit))
    elif legend.low or legend.high:
        imgui.text(in_unit(f"{legend.low} … {legend.high}", legend.unit))
    imgui.pop_text_wrap_pos()
    if legend.text:
        with imgui_ctx.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled)):
            imgui.text_wrapped(legend.text)


def draw_record(record: InspectedRecord, layout: Layout, legends: float) -> None:
    """Draw the inspected record in the lower right corner: its numbers, and the hemisphere around it.

    legends: the upper edge of the legends, window coordinates. In a narrow picture the record is above this edge.
    """
    left, _, right, bottom = layout.area
    bottom = legends if right - left < 2.0 * _TEXT_WIDTH * layout.scale else bottom
    imgui.set_next_window_pos((right - MARGIN, bottom - MARGIN), imgui.Cond_.always, (1.0, 1.0))
    imgui.set_next_window_bg_alpha(0.8)
    imgui.begin("record", None, PLAIN | imgui.WindowFlags_.no_inputs)
    if imgui.begin_table("numbers of the record", 2, imgui.TableFlags_.sizing_fixed_fit):
        for label, text in record.lines:
            imgui.table_next_column()
            imgui.text_disabled(label)
            imgui.table_next_column()
            imgui.text(text)
        imgui.end_table()
    width, picture = _PICTURE_WIDTH * layout.scale, record.picture
    imgui.image(imgui.ImTextureRef(picture.glo), (width, width * picture.height / picture.width), (0, 1), (1, 0))
    imgui.text_disabled("hemisphere")
    imgui.end()


_SIZE = (420.0, 170.0)  # window coordinates at scale 1: width and height of the plot
_FLAGS = implot.Flags_.no_menus | implot.Flags_.no_box_select
_COLOURS = {
    "": AMBER,
    **dict.fromkeys("rx", (0.93, 0.36, 0.30, 1.0)),
    **dict.fromkeys("gy", (0.38, 0.76, 0.38, 1.0)),
    **dict.fromkeys("bz", (0.42, 0.60, 0.98, 1.0)),
}


def draw_line(actions: Actions, layout: Layout) -> None:
    """Draw the measuring line and the point of *why is it dark here* over the picture, while they are on."""
    options, camera = actions.session.options, actions.session.camera
    ends = [layout.seen(camera, point) for point in options.line or () if options.profile]
    marks = [(end, AMBER) for end in ends]
    if options.why and options.surface is not None:
        marks.append((layout.seen(camera, options.surface[0]), WHITE))
    with layout.over_picture() as draw:
        if ends:
            line(draw, ends[0], ends[1], 2.0)
        for place, colour in marks:
            if place is not None:
                dot(draw, place, colour)


def draw_plot(actions: Actions, display: Display, layout: Layout, top: float) -> None:
    """Draw the plot below `top` (window coordinates) while the measurement along a line is on."""
    session = actions.session
    if not session.options.profile or not session.views:
        return
    left, _, right, _ = layout.area
    width = min(_SIZE[0] * layout.scale, right - left - 2.0 * (MARGIN + imgui.get_style().window_padding.x))
    imgui.set_next_window_pos((right - MARGIN, top + MARGIN), imgui.Cond_.always, (1.0, 0.0))
    flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_saved_settings
    shown, opened = imgui.begin("along a line", True, flags)
    session.options.profile = bool(opened)
    if shown:
        title, found = BUFFERS[session.options.buffer].title, display.profile(session.options.side)
        if found is None:
            imgui.text_disabled("drag a line over surfaces")
        elif (summary := found.summary) is None:
            imgui.text_disabled(f"{title} has no values along this line")
        else:
            _plot(title, found, summary, width, layout.scale)
    imgui.end()


def _plot(title: str, found: Profile, summary: tuple[np.ndarray, np.ndarray, np.ndarray], width: float, scale: float) -> None:
    """Draw the values over metres, with their least, mean and greatest value below."""
    legend = implot.Flags_.no_legend if len(found.channels) == 1 else 0
    if implot.begin_plot("##along", (width, _SIZE[1] * scale), _FLAGS | legend):
        implot.setup_legend(implot.Location_.east, implot.LegendFlags_.outside)  # over the curves, it hides values
        implot.setup_axes("metres", "" if found.unit == "1" else found.unit)
        low, high = float(min(summary[0].min(), 0.0)), float(summary[2].max())
        implot.setup_axes_limits(0.0, float(found.metres[-1]), low, high + 0.05 * ((high - low) or 1.0), implot.Cond_.always)
        for channel, values in zip(found.channels, found.values.T, strict=True):
            spec = implot.Spec()
            spec.line_color, spec.line_weight = imgui.ImVec4(*_COLOURS[channel]), 1.5 * scale
            implot.plot_line(channel or title, found.metres, np.ascontiguousarray(values), spec)
        if implot.is_plot_hovered():
            number = int(np.abs(found.metres - implot.get_plot_mouse_pos().x).argmin())
            imgui.set_tooltip(f"{found.metres[number]:.3g} m: {_words(found.values[number], found.unit)}")
        implot.end_plot()
    with imgui_ctx.push_text_wrap_pos(imgui.get_style().window_padding.x + width):
        named = [f"{name} {_words(v, found.unit)}" for name, v in zip(("min", "mean", "max"), summary, strict=True)]
        imgui.text("  ".join(named) + f" over {found.metres[-1]:.4g} m")


def _words(values: np.ndarray, unit: str) -> str:
    return in_unit(", ".join(f"{value:.4g}" for value in values), unit)
