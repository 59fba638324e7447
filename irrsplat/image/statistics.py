"""The statistics of a frame, `Frame.stats`, and their JSON: progress, circumstances and times."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypedDict

TIMES = ("seconds", "stages_ms", "clock")  # statistics that differ between equal runs


class Statistics(TypedDict, total=False):
    """The statistics of a frame; frames that were not rendered may lack some."""

    # progress
    rounds: int
    converged: bool  # nothing was left to gather
    full: bool  # the view needs more records than `max_records`
    interrupted: bool  # by Ctrl-C
    coverage: float  # share of the visible pixels covered by records, 0..1
    uncovered: int  # visible pixels that no record reaches; only in renders without gathering
    records: int  # in the cache
    seconds: float  # wall time to full coverage, before direct light and composite
    samples: int  # per pixel
    error: float | None  # estimated relative RMSE of the indirect irradiance; None: not estimated
    # light
    gathered_by: str
    bounces: int
    bounces_converged: bool | None  # True if further bounces would add little; None if bounces are limited
    # time
    stages_ms: dict[str, float]
    clock: str  # the clock of stages_ms: "gpu" or "wall"
    # circumstances
    renderer: str  # OpenGL's
    version: str  # OpenGL's
    preset: str
    settings: dict[str, object]
    exposure: float  # stops
    size: list[int]  # width, height
    triangles: int
    scene: str
    frame: int  # number within a path's frames


def bounces_notice(stats: Mapping[str, object]) -> str | None:
    """Return the notice on light that is missing after the last bounce; None if the light is complete or bounces are limited."""
    if stats.get("bounces_converged") is not False or stats.get("bounces", 0) == 0:
        return None
    return f"more than 1 % of the light may be missing after {stats['bounces']} bounces; use reflectances below 0.97"
