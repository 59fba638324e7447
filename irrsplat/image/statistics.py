"""The statistics of a frame: how it was made, from what, and how long that took; `Frame.stats`, and the JSON made of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TypedDict

from irrsplat.scene.model import Scene
from irrsplat.settings import Settings

_TIMES = ("seconds", "stages_ms", "clock")


class Statistics(TypedDict, total=False):
    """What is known of a frame; a frame that did not come from a render may lack any of these."""

    # the rounds
    rounds: int
    converged: bool  # nothing was left to gather
    full: bool  # the view needs more records than `max_records`
    interrupted: bool  # by Ctrl-C
    coverage: float  # share of the seen pixels that have their records, 0..1
    uncovered: int  # pixels that see a surface and that no record reaches; only where nothing was gathered
    records: int  # in the cache
    seconds: float  # wall time to full coverage, before direct light and composite
    samples: int  # a pixel
    error: float | None  # estimated relative RMSE of the indirect irradiance; None: not estimated
    # the light
    gathered_by: str
    bounces: int
    bounces_converged: bool | None  # whether further bounces would add hardly anything; None: not all of them are wanted
    # the time
    stages_ms: dict[str, float]
    clock: str  # what measured stages_ms: "gpu" or "wall"
    # the circumstances
    renderer: str  # OpenGL's
    version: str  # OpenGL's
    preset: str
    settings: dict[str, object]
    exposure: float  # stops
    size: list[int]  # width, height
    triangles: int
    scene: str
    frame: int  # its number, of a path's frames


def describe(
    about: Mapping[str, object], scene: Scene, size: tuple[int, int], preset: str, settings: Settings, exposure: float
) -> Statistics:
    """The circumstances: OpenGL (`about`, as gpu.context.describe has it), scene and settings; exposure in stops."""
    return {
        "renderer": str(about["renderer"]),
        "version": str(about["version"]),
        "preset": preset,
        "settings": asdict(settings),
        "exposure": exposure,
        "size": list(size),
        "triangles": scene.triangles,
        "scene": scene.name,
    }


def bounces_notice(stats: Mapping[str, object]) -> str | None:
    """Return the notice on light that is missing after the last bounce; None if the light is complete or bounces are limited."""
    if stats.get("bounces_converged") is not False or stats.get("bounces", 0) == 0:
        return None
    return f"more than 1 % of the light is missing after {stats['bounces']} bounces; use reflectances below 0.99"


def repeatable(stats: Statistics) -> Mapping[str, object]:
    """Statistics without how long anything took: equal runs have equal ones."""
    return {name: value for name, value in stats.items() if name not in _TIMES}
