"""Statistics: frames per second, milliseconds by stage, records and coverage."""

from __future__ import annotations

import math
from collections import deque

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import AMBER
from irrsplat.image.view import Progress

_MEAN = 20  # frames of the mean rate


class FrameTimes:
    """Milliseconds of the last frames.

    frames: from picture to picture. work: of the last one, without waiting. stages: of the last one, in the order of their first
    runs.
    """

    def __init__(self) -> None:
        self.frames: deque[float] = deque(maxlen=_MEAN)
        self.work = 0.0
        self.stages: dict[str, float] = {}

    def add(self, frame: float, work: float, stages: dict[str, float]) -> None:
        """Add a frame, its two times in seconds, its stages in milliseconds."""
        self.frames.append(1e3 * frame)
        self.work = 1e3 * work
        self.stages = dict.fromkeys(self.stages, 0.0) | stages


def draw_statistics(actions: Actions, times: FrameTimes) -> None:
    """Draw the statistics, with a line for each stage that has run."""
    session = actions.session
    mean = max(sum(times.frames) / max(len(times.frames), 1), 1e-3)  # of fewer frames it is no rate
    rate = "at rest" if session.at_rest else f"{1e3 / mean:.0f} fps" if len(times.frames) == _MEAN else "starting"
    imgui.text_wrapped(f"{rate}, last frame {times.work:.0f} ms")
    for stage, ms in times.stages.items():
        imgui.text_wrapped(f"{stage}: {ms:.1f} ms")
    imgui.text_disabled(f"clock: {session.renderers[0].timers.clock}")
    for renderer, progress in zip(session.active, session.progress, strict=False):
        imgui.separator()
        in_view = renderer.scheduler.count_in_view(session.camera, renderer.size)
        imgui.text_wrapped(f"{renderer.preset}: {progress.records} records, {progress.new} new, {in_view} in view")
        imgui.text_wrapped(coverage_in_words(progress, renderer.settings.fill_holes))
        if progress.surface < 1.0:
            imgui.text_colored(AMBER, f"surface cache {100.0 * progress.surface:.0f} %")
        if progress.stale:
            imgui.text_colored(AMBER, f"{progress.stale} stale records")
        if progress.full:
            imgui.text_colored(AMBER, "max_records is reached: raise it")


def coverage_in_words(progress: Progress, filled: bool) -> str:
    """Return the share of the view that records cover. filled: a coarse estimate replaces the rest."""
    if progress.coverage == 0.0:  # of the first round it is known only when that ends
        return "first estimate" if filled else "first round"
    return f"coverage {math.floor(1000.0 * progress.coverage) / 10.0:.1f} %"  # 100 only where it is


def draw_tracing(actions: Actions) -> None:
    """Draw the progress of the reference while it is traced."""
    tracing = actions.session.tracing
    if tracing.traced is not None:
        imgui.push_style_color(imgui.Col_.text, AMBER)
        imgui.text_wrapped(f"{tracing.progress} ({100.0 * tracing.traced:.0f} % done, Y stops it)")
        imgui.pop_style_color()
