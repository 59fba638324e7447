"""Published times of the seed paper, and the corresponding work in one of our pictures."""

from __future__ import annotations

from collections.abc import Iterator

from irrsplat.app.bench.cases import Timing
from irrsplat.app.common.terminal import columns

PUBLISHED = "published (Jones 2010: GeForce 8800 GT, 800x800)"
# Rows of the paper: name, milliseconds, records (section 4)
ROWS: tuple[tuple[str, float, int | None], ...] = (
    ("first samples", 1110.0, 1000),
    ("direct illumination", 1.95, None),
    ("splat of the first samples", 19.5, 1000),
    ("traversal and new records", 1040.0, 511),
    ("splat of the new records", 1.07, 511),
    ("final pass", 2.03, None),
)


def rows(timing: Timing) -> list[tuple[float, int | None]]:
    """Return milliseconds and records for the paper's ROWS; the first round corresponds to the first samples."""
    first, early = timing.rounds[0] if timing.rounds else (0, {})
    second = timing.rounds[1][1] if len(timing.rounds) > 1 else timing.stages
    new, end = timing.records - first, timing.stages

    def ms(stages: dict[str, float], *names: str) -> float:
        return sum(stages.get(name, 0.0) for name in names)

    return [
        (ms(early, "gather", "reduce"), first),
        (ms(end, "direct"), None),
        (ms(second, "splat") - ms(early, "splat"), first),
        (ms(end, "examine", "gather", "reduce", "adapt") - ms(early, "gather", "reduce"), new),
        (ms(end, "splat") - ms(second, "splat"), new),
        (ms(end, "composite"), None),
    ]


def table(scene: str, ours: dict[str, Timing], clock: str) -> Iterator[str]:
    """Yield the paper's rows with its times next to ours from an empty cache, by preset."""
    yield f"{scene} from empty, stage by stage in ms ({clock} clock), with the records of each; first: {PUBLISHED}"
    made: list[tuple[str, ...]] = [("stage", "published", *ours)]
    found = [rows(timing) for timing in ours.values()]
    for i, (name, ms, records) in enumerate(ROWS):
        made.append((name, _cell(ms, records), *(_cell(*rows[i]) for rows in found)))
    yield from columns(made, left=1)


def _cell(ms: float, records: int | None) -> str:
    return f"{ms:.2f}" + (f" ({records:4d})" if records is not None else " " * 7)
