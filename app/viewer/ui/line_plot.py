"""The measuring line over the picture, and the plot of the buffer's values along this line."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, implot

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.display import Display, Profile
from irrsplat.app.viewer.ui.layout import AMBER, MARGIN, Layout, dot, in_unit, line

_SIZE = (420.0, 170.0)  # window coordinates at scale 1: width and height of the plot
_FLAGS = implot.Flags_.no_menus | implot.Flags_.no_box_select
_COLOURS = {
    "": AMBER,
    **dict.fromkeys("rx", (0.93, 0.36, 0.30, 1.0)),
    **dict.fromkeys("gy", (0.38, 0.76, 0.38, 1.0)),
    **dict.fromkeys("bz", (0.42, 0.60, 0.98, 1.0)),
}


def draw_line(actions: Actions, layout: Layout) -> None:
    """Draw the measuring line with its ends over the picture, while this measurement is on."""
    options = actions.session.options
    if not options.profile or options.line is None:
        return
    ends = [layout.seen(actions.session.camera, point) for point in options.line]
    with layout.over_picture() as draw:
        line(draw, ends[0], ends[1], AMBER, 2.0)
        for end in ends:
            if end is not None:
                dot(draw, end, AMBER)


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
    imgui.push_text_wrap_pos(imgui.get_style().window_padding.x + width)
    named = zip(("min", "mean", "max"), summary, strict=True)
    imgui.text("  ".join(f"{name} {_words(values, found.unit)}" for name, values in named) + f" over {found.metres[-1]:.4g} m")
    imgui.pop_text_wrap_pos()


def _words(values: np.ndarray, unit: str) -> str:
    return in_unit(", ".join(f"{value:.4g}" for value in values), unit)
