"""Times and numbers: frames per second, milliseconds by stage, records and coverage."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import Layout, accent
from irrsplat.image.view import Progress

FRAMES = 120  # that are kept
_PLOT_HEIGHT, _PLOT_MS = 40.0, 100.0  # window coordinates at scale 1; milliseconds that the plot shows at least
_MEAN = 20  # frames of the mean rate
_KEPT = 30  # frames that a stage's row stays after it ran


class FrameTimes:
    """Milliseconds of the last frames. frames: from picture to picture. work: without waiting. stages: of the last frame
    by name, without those of the core."""

    def __init__(self) -> None:
        self.frames: deque[float] = deque(maxlen=FRAMES)
        self.work: deque[float] = deque(maxlen=FRAMES)
        self.stages: dict[str, float] = {}

    def add(self, frame: float, work: float) -> None:
        """Add a frame, seconds each."""
        self.frames.append(1e3 * frame)
        self.work.append(1e3 * work)


class StatisticsView:
    """Draws times and numbers."""

    def __init__(self, actions: Actions, times: FrameTimes, layout: Layout) -> None:
        self.actions, self.times, self.layout = actions, times, layout
        self._frames_since: dict[str, int] = {}  # that a stage of the table ran

    def draw(self) -> None:
        """Draw them."""
        self._rate()
        self._stages()
        for side, progress in enumerate(self.actions.session.progress):
            imgui.separator()
            self._side(side, progress)

    def _rate(self) -> None:
        frames, work = self.times.frames, self.times.work
        recent = list(frames)[-_MEAN:]
        mean, last = sum(recent) / max(len(recent), 1), work[-1] if work else 0.0
        known = len(recent) == _MEAN  # a mean of fewer frames is no rate
        rate = "at rest" if self.actions.session.at_rest else f"{1e3 / max(mean, 1e-3):.0f} fps" if known else "starting"
        imgui.text(f"{rate}, last frame {last:.0f} ms")
        most = max(max(frames, default=0.0), _PLOT_MS)
        plot = np.array(work, "f4") if work else np.zeros(1, "f4")
        size = imgui.get_content_region_avail().x, _PLOT_HEIGHT * self.layout.scale
        imgui.plot_lines("##ticks", plot, 0, f"0..{most:.0f} ms", 0.0, most, size)

    def _stages(self) -> None:
        """Draw a row for each stage; rows stay a while after the stage ran."""
        session = self.actions.session
        present = {**session.ms, **self.times.stages}
        frames = {stage: since + 1 for stage, since in self._frames_since.items() if since < _KEPT}
        self._frames_since = frames | dict.fromkeys(present, 0)
        if imgui.begin_table("stages", 2):
            for stage in self._frames_since:
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
        imgui.text_wrapped(f"{who}{progress.records} records, {progress.new} new")
        imgui.text_wrapped(f"{in_view} in view, {coverage_in_words(progress, renderer.settings.fill_holes)}")
        if progress.error is not None:
            imgui.text_wrapped(f"error about {100.0 * progress.error:.2g} %" + ("" if progress.refined else ", refining"))
        if progress.surface < 1.0:
            imgui.text_colored(accent(), f"surface cache {100.0 * progress.surface:.0f} %")
        if progress.stale:
            imgui.text_colored(accent(), f"{progress.stale} stale records")
        if progress.full:
            imgui.text_colored(accent(), "max_records is reached: raise it")


def coverage_in_words(progress: Progress, filled: bool) -> str:
    """Return the share of the view that records cover. filled: a coarse estimate stands in the rest."""
    if progress.coverage == 0.0:  # of the first round it is known only when that ends
        return "first estimate" if filled else "first round"
    return f"coverage {math.floor(1000.0 * progress.coverage) / 10.0:.1f} %"  # 100 only where it is


def draw_tracing(actions: Actions) -> None:
    """Draw the progress of the reference while it is traced."""
    references = actions.session.references
    if references.progress:
        share = "" if references.traced is None else f"{100.0 * references.traced:.0f} % done, "
        imgui.push_style_color(imgui.Col_.text, accent())
        imgui.text_wrapped(f"{references.progress} ({share}Y stops it)")
        imgui.pop_style_color()
