"""Times and numbers in the upper right corner: frames a second, milliseconds by stage, records and coverage."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.keys import KEYS
from irrsplat.app.viewer.ui.frame_times import FrameTimes
from irrsplat.app.viewer.ui.layout import AMBER, MARGIN, MENU_BAR, PLAIN, Layout
from irrsplat.image.view import Progress

_WIDTH = 212.0  # at least, so that buttons stay where they are while the lines change
_INNER = 190.0  # width of plot and table
_PLOT_HEIGHT = 40.0
_PLOT_MS = 100.0  # milliseconds that the plot shows at least
_MEAN = 20  # frames that the rate is the mean of
_KEPT = 30  # frames that a stage's row stays after it ran


class StatisticsView:
    """Draws the window of times and numbers."""

    def __init__(self, actions: Actions, times: FrameTimes, layout: Layout) -> None:
        self.actions, self.times, self.layout = actions, times, layout
        self._frames_since: dict[str, int] = {}  # that a stage of the table ran

    def draw(self) -> None:
        """Draw it where it is open."""
        actions, session, scale = self.actions, self.actions.session, self.layout.scale
        if not actions.panels.hud or not session.progress:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos((view.size.x - MARGIN, MENU_BAR * scale), imgui.Cond_.always, (1.0, 0.0))
        imgui.set_next_window_bg_alpha(0.72)
        imgui.set_next_window_size_constraints((_WIDTH * scale, 0.0), (view.size.x, view.size.y))
        imgui.begin("numbers", None, PLAIN)
        self._rate()
        self._buttons()
        self._stages()
        for side, progress in enumerate(session.progress):
            imgui.separator()
            self._side(side, progress)
        took = imgui.get_window_size()
        self.layout.statistics_size = (took.x, took.y)
        imgui.end()

    def _rate(self) -> None:
        frames, work, scale = self.times.frames, self.times.work, self.layout.scale
        recent = list(frames)[-_MEAN:]
        mean, last = sum(recent) / max(len(recent), 1), work[-1] if work else 0.0
        at_rest = ", at rest" if self.actions.session.at_rest else ""
        imgui.text(f"{1e3 / max(mean, 1e-3):.0f} fps, {last:.0f} ms a tick{at_rest}")
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
                actions.press(next(k for k in KEYS if k.action == action))
        if options.frozen:
            imgui.same_line()
            imgui.text_colored(AMBER, "frozen")
        recorder = actions.session.path_recorder
        if recorder.recording is not None:
            imgui.text_colored(AMBER, "recording (R ends it)")
        if recorder.playing is not None:
            imgui.text_colored(AMBER, "playing (P stops it)")
        draw_tracing(actions)

    def _stages(self) -> None:
        """Draw a row for each stage; rows stay a while after the stage ran, so that the window keeps its size."""
        session = self.actions.session
        present = {**session.ms, **self.times.stages}
        frames = {stage: since + 1 for stage, since in self._frames_since.items() if since < _KEPT}
        self._frames_since = frames | dict.fromkeys(present, 0)
        if imgui.begin_table("stages", 2, imgui.TableFlags_.sizing_stretch_prop, (_INNER * self.layout.scale, 0.0)):
            for stage in self._frames_since:
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_disabled(stage)
                imgui.table_next_column()
                imgui.text(f"{present.get(stage, 0.0):6.1f} ms")
            imgui.end_table()
        imgui.text_disabled(f"clock: {session.renderers[0].timers.clock}")

    def _side(self, side: int, progress: Progress) -> None:
        session = self.actions.session
        renderer = session.renderers[side]
        in_view = renderer.scheduler.count_in_view(session.camera, renderer.size)
        who = f"{('left', 'right')[side]}: " if len(session.progress) > 1 else ""
        imgui.text(f"{who}{progress.records} records, {progress.new} new")
        imgui.text(f"{in_view} in view, coverage {100.0 * progress.coverage:.1f} %")
        if progress.error is not None:
            imgui.text(f"error about {100.0 * progress.error:.2g} %" + ("" if progress.refined else ", refining"))
        if progress.surface < 1.0:
            imgui.text_colored(AMBER, f"surface cache {100.0 * progress.surface:.0f} %")
        if progress.stale:
            imgui.text_colored(AMBER, f"{progress.stale} to be gathered again")
        if progress.full:
            imgui.text_colored(AMBER, "this view needs more: raise max_records")


def draw_tracing(actions: Actions) -> None:
    """Draw a line that says how much of a truth is traced, while one is."""
    done = actions.session.truths.traced
    if done is not None:
        imgui.text_colored(AMBER, f"tracing, {100.0 * done:.0f} % (Y stops it)")
