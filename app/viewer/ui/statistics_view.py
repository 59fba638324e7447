"""Times and numbers in the upper right corner: frames a second, milliseconds by stage, records and coverage."""

from __future__ import annotations

import math

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.commands import COMMANDS
from irrsplat.app.viewer.ui.frame_times import FrameTimes
from irrsplat.app.viewer.ui.layout import MARGIN, NO_SCROLLBAR, PLAIN, STATISTICS_WIDTH, Layout, accent
from irrsplat.image.view import Progress

_INNER = 190.0  # width of plot and table
_PLOT_HEIGHT = 40.0
_PLOT_MS = 100.0  # milliseconds that the plot shows at least
_MEAN = 20  # frames that the rate is the mean of
_KEPT = 30  # frames that a stage's row stays after it ran


class StatisticsView:
    """Draws the window of times and numbers."""

    def __init__(self, actions: Actions, times: FrameTimes, layout: Layout) -> None:
        self.actions, self.times, self.layout = actions, times, layout
        self._room = math.inf  # height that the window may take, window coordinates
        self._others = self._stages_height = 0.0  # heights that the last frame took: of the rest, and of the stages' rows
        self._frames_since: dict[str, int] = {}  # that a stage of the table ran

    def draw(self) -> None:
        """Draw it where it is open."""
        actions, session, scale = self.actions, self.actions.session, self.layout.scale
        if not actions.panels.hud or not session.progress:
            return
        view, (_, top, right, _) = imgui.get_main_viewport(), self.layout.area
        imgui.set_next_window_pos((right - MARGIN, top), imgui.Cond_.always, (1.0, 0.0))
        imgui.set_next_window_bg_alpha(0.72)
        self._room = self._height(scale)
        imgui.set_next_window_size_constraints((STATISTICS_WIDTH * scale, 0.0), (view.size.x, max(self._room, 1.0)))
        scrolls = self._others + imgui.get_text_line_height_with_spacing() > self._room  # though all stages but one are left out
        imgui.begin("numbers", None, PLAIN & ~NO_SCROLLBAR if scrolls else PLAIN)
        self._rate()
        self._buttons()
        self._stages()
        for side, progress in enumerate(session.progress):
            imgui.separator()
            self._side(side, progress)
        took = imgui.get_window_size()
        self._others = imgui.get_cursor_pos().y + imgui.get_style().window_padding.y - self._stages_height
        self.layout.statistics_size = (took.x, took.y)
        imgui.end()

    def _height(self, scale: float) -> float:
        """The height that the window may take: in a narrow one down to the legend."""
        _, top, right, bottom = self.layout.area
        end = bottom - MARGIN
        if right - MARGIN - STATISTICS_WIDTH * scale < self.layout.legend_right:
            end = min(end, imgui.get_main_viewport().size.y - self.layout.legend_height)
        return end - top

    def _rate(self) -> None:
        frames, work, scale = self.times.frames, self.times.work, self.layout.scale
        recent = list(frames)[-_MEAN:]
        mean, last = sum(recent) / max(len(recent), 1), work[-1] if work else 0.0
        known = len(recent) == _MEAN  # a mean of fewer frames is no rate
        rate = "at rest" if self.actions.session.at_rest else f"{1e3 / max(mean, 1e-3):.0f} fps" if known else "starting"
        imgui.text(f"{rate}, last frame {last:.0f} ms")
        most = max(max(frames, default=0.0), _PLOT_MS)
        plot = np.array(work, "f4") if work else np.zeros(1, "f4")
        imgui.plot_lines("##ticks", plot, 0, f"0..{most:.0f} ms", 0.0, most, (_INNER * scale, _PLOT_HEIGHT * scale))

    def _buttons(self) -> None:
        actions, options = self.actions, self.actions.session.options
        if imgui.small_button("thaw" if options.frozen else "freeze"):
            actions.toggle("frozen")
        for action in ("step", "clear"):
            imgui.same_line()
            if imgui.small_button(action):
                actions.press(next(k for k in COMMANDS if k.action == action))
        if options.frozen:
            imgui.same_line()
            imgui.text_colored(accent(), "frozen")
        recorder = actions.session.path_recorder
        if recorder.recording is not None:
            imgui.text_colored(accent(), "recording (R ends it)")
        if recorder.playing is not None:
            imgui.text_colored(accent(), "playing (P stops it)")
        draw_tracing(actions)

    def _stages(self) -> None:
        """Draw a row for each stage; rows stay a while after the stage ran, so that the window keeps its size."""
        session = self.actions.session
        present = {**session.ms, **self.times.stages}
        frames = {stage: since + 1 for stage, since in self._frames_since.items() if since < _KEPT}
        self._frames_since = frames | dict.fromkeys(present, 0)
        top = imgui.get_cursor_pos().y
        height = imgui.get_text_line_height() + 2.0 * imgui.get_style().cell_padding.y
        rows = max(int(min((self._room - self._others) / height, 99.0)), 1)
        if imgui.begin_table("stages", 2, imgui.TableFlags_.sizing_stretch_prop, (_INNER * self.layout.scale, 0.0)):
            for stage in list(self._frames_since)[:rows]:
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_disabled(stage)
                imgui.table_next_column()
                imgui.text(f"{present.get(stage, 0.0):6.1f} ms")
            imgui.end_table()
        self._stages_height = imgui.get_cursor_pos().y - top
        imgui.text_disabled(f"clock: {session.renderers[0].timers.clock}")

    def _side(self, side: int, progress: Progress) -> None:
        session = self.actions.session
        renderer = session.renderers[side]
        in_view = renderer.scheduler.count_in_view(session.camera, renderer.size)
        who = f"{('left', 'right')[side]}: " if len(session.progress) > 1 else ""
        imgui.text(f"{who}{progress.records} records, {progress.new} new")
        imgui.text(f"{in_view} in view, {coverage_in_words(progress, renderer.settings.fill_holes)}")
        if progress.error is not None:
            imgui.text(f"error about {100.0 * progress.error:.2g} %" + ("" if progress.refined else ", refining"))
        if progress.surface < 1.0:
            imgui.text_colored(accent(), f"surface cache {100.0 * progress.surface:.0f} %")
        if progress.stale:
            imgui.text_colored(accent(), f"{progress.stale} to be refreshed")
        if progress.full:
            imgui.text_colored(accent(), "max_records is reached: raise it")


def coverage_in_words(progress: Progress, filled: bool) -> str:
    """How much of the view is served; filled: a guess stands where it is not."""
    if progress.coverage == 0.0:  # of the first round it is known only when that ends
        return "first estimate" if filled else "first round"
    return f"coverage {math.floor(1000.0 * progress.coverage) / 10.0:.1f} %"  # 100 only where it is


def draw_tracing(actions: Actions) -> None:
    """Draw a line that says how much of a truth is traced, while one is."""
    truths = actions.session.truths
    if truths.progress:
        share = "" if truths.traced is None else f"{100.0 * truths.traced:.0f} % done, "
        imgui.text_colored(accent(), f"{truths.progress} ({share}Y stops it)")
