"""The line that is measured along, over the picture, and the plot of what the buffer shows along it."""

from __future__ import annotations

from math import dist

import numpy as np
from imgui_bundle import imgui, implot

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.light.line_profile import Profile
from irrsplat.app.viewer.ui.layout import AMBER, MARGIN, WHITE, Layout, in_unit
from irrsplat.app.viewer.view_options import Point

_SIZE = (420.0, 170.0)  # of the plot, window coordinates at scale 1
_SHADE = (0.0, 0.0, 0.0, 0.55)
_COLOURS = {
    "": AMBER,
    **dict.fromkeys("rx", (0.93, 0.36, 0.30, 1.0)),
    **dict.fromkeys("gy", (0.38, 0.76, 0.38, 1.0)),
    **dict.fromkeys("bz", (0.42, 0.60, 0.98, 1.0)),
}
_HOW = "drag a line over surfaces"


class LinePlot:
    """Draws both while a line is measured along."""

    def __init__(self, actions: Actions, display: Display, layout: Layout) -> None:
        self.actions, self.display, self.layout = actions, display, layout
        self._marked: Point | None = None  # the point of the line that the cursor is at in the plot

    @property
    def width(self) -> float:
        """Width of the plot, window coordinates."""
        left, _, right, _ = self.layout.area
        return min(_SIZE[0] * self.layout.scale, right - left - 2.0 * (MARGIN + imgui.get_style().window_padding.x))

    def draw(self) -> None:
        session = self.actions.session
        if not session.options.profile or not session.views:
            return
        self._marked = None
        side = self.actions.side
        _, _, right, bottom = self.layout.area
        if right - self.width - 4.0 * MARGIN < self.layout.legend_right:  # it stands above the legend
            bottom -= self.layout.legend_height - MARGIN
        imgui.set_next_window_pos((right - MARGIN, bottom - MARGIN), imgui.Cond_.always, (1.0, 1.0))
        flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_saved_settings
        shown, opened = imgui.begin("along a line", True, flags)
        session.options.profile = bool(opened)
        if shown:
            found = self.display.profile(side)
            if found is None:
                imgui.text_disabled(_HOW)
            else:
                self._plot(BUFFERS[session.buffer(side)].title, found)
        imgui.end()

    def draw_line(self) -> None:
        """Draw the line over the picture, its ends, and the point under the cursor in the plot."""
        session = self.actions.session
        if not session.options.profile or session.options.line is None:
            return
        marks = [*session.options.line, *([] if self._marked is None else [self._marked])]
        places = [self.layout.seen(session.camera, point) for point in marks]
        with self.layout.over_picture() as draw:
            if places[0] is not None and places[1] is not None:
                draw.add_line(places[0], places[1], imgui.get_color_u32(_SHADE), 4.0)
                draw.add_line(places[0], places[1], imgui.get_color_u32(AMBER), 2.0)
            for place, colour in zip(places, (AMBER, AMBER, WHITE), strict=False):
                if place is not None:
                    draw.add_circle_filled(place, 6.0, imgui.get_color_u32(_SHADE))
                    draw.add_circle_filled(place, 4.0, imgui.get_color_u32(colour))

    def _plot(self, title: str, found: Profile) -> None:
        """Draw the values over metres, and sum them up."""
        summary = found.summary
        if summary is None:
            return imgui.text_disabled(f"{title} has no values along this line")
        scale, style, width = self.layout.scale, imgui.get_style(), self.width
        flags = (
            implot.Flags_.no_menus | implot.Flags_.no_box_select | (implot.Flags_.no_legend if len(found.channels) == 1 else 0)
        )
        if implot.begin_plot("##along", (width, _SIZE[1] * scale), flags):
            implot.setup_axes("metres", "" if found.unit == "1" else found.unit)
            low, high = float(min(summary[0].min(), 0.0)), float(summary[2].max())
            implot.setup_axes_limits(0.0, float(found.metres[-1]), low, high + 0.05 * ((high - low) or 1.0), implot.Cond_.always)
            for channel, values in zip(found.channels, found.values.T, strict=True):
                spec = implot.Spec()
                spec.line_color, spec.line_weight = imgui.ImVec4(*_COLOURS[channel]), 1.5 * scale
                implot.plot_line(channel or title, found.metres, np.ascontiguousarray(values), spec)
            if implot.is_plot_hovered():
                self._mark(found, implot.get_plot_mouse_pos().x)
            implot.end_plot()
        imgui.push_text_wrap_pos(style.window_padding.x + width)
        self._words(found, summary)
        imgui.pop_text_wrap_pos()

    def _mark(self, found: Profile, metres: float) -> None:
        """Show the value at the cursor, and where that is in the picture."""
        number = int(np.abs(found.metres - metres).argmin())
        values = found.values[number]
        ends = self.actions.session.options.line
        if ends is None or not np.isfinite(values).all():
            return
        words = ", ".join(f"{value:.4g}" for value in values)
        imgui.set_tooltip(f"{found.metres[number]:.3g} m: {in_unit(words, found.unit)}")
        start, end = (np.array(point) for point in ends)
        x, y, z = (start + found.metres[number] / dist(*ends) * (end - start)).tolist()
        self._marked = x, y, z

    def _words(self, found: Profile, summary: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        named = zip(("min", "mean", "max"), summary, strict=True)
        words = "  ".join(f"{name} {', '.join(f'{value:.4g}' for value in values)}" for name, values in named)
        imgui.text(f"{in_unit(words, found.unit)} over {found.metres[-1]:.4g} m")
