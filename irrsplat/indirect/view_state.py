"""The progress of one view: an immutable value that restarts with another camera, size, scene or criterion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from irrsplat.core.buffers import Sites
from irrsplat.gather.spot_check import SpotCheck
from irrsplat.indirect.paper_scan import Scan

COVERED = 0.9  # of the pixels: with fewer holes, all take the light of records around them
GIVE_UP = 8  # rounds in a row without gain in coverage, after which a view requests no more records


class Phase(Enum):
    """The next work of a view.

    START: old records are compared with each other. FILL: rounds of new records, coarse to fine; without requests, the spot
    check, and the radii of old records. SETTLED: no pixel requests a record.
    """

    START = 0
    FILL = 1
    SETTLED = 2


class Need(NamedTuple):
    """The result of an examination.

    missing: under-covered share of the surface pixels, 0..1. holes: number of tiles with a pixel that no record covers.
    requests: number of tiles that request a record. of: the examined sums and the criteria.
    """

    missing: float = 1.0
    holes: int = 0
    requests: int = 0
    of: tuple[object, ...] = ()


@dataclass(frozen=True)
class ViewState:
    """The progress of one view.

    subject: all inputs of its requests, the camera first; empty for no view. pixel_stride: 2 while only every other pixel is
    splatted, in both directions. rounds: number of complete rounds. stalled_rounds: number of successive rounds without gain in
    coverage. step: of the site selection, coarse to fine. need, before: at the beginning of the present round, and of the last
    complete round. queue: the waiting sites of the present round; None between rounds. near: True if they have the greatest
    density, so that their records cover only near surfaces. check: the unfinished spot check; checked: True after the check.
    full: True if the view needs more records than the limit. holes: the cells that still lack a probe, see HoleFilling; None:
    unknown. scan: the traversal of the paper's algorithm.
    """

    subject: tuple[object, ...] = ()
    pixel_stride: int = 1
    phase: Phase = Phase.START
    rounds: int = 0
    stalled_rounds: int = 0
    step: int = 0
    need: Need = Need()
    before: Need = Need()
    queue: Sites | None = None
    near: bool = False
    check: SpotCheck | None = None
    checked: bool = False
    full: bool = False
    holes: Sites | None = None
    scan: Scan | None = None

    @property
    def coverage(self) -> float:
        """The covered share of the surface pixels at the beginning of the present round, 0..1."""
        return 1.0 - self.need.missing

    @property
    def lacks_probes(self) -> bool:
        """True if holes have no probe and are too large to take the light of records around them."""
        return self.coverage < COVERED and (self.holes is None or len(self.holes) > 0)

    @property
    def stalled(self) -> bool:
        """True if rounds no longer gain coverage: the remaining requests cannot be met."""
        return self.stalled_rounds >= GIVE_UP

    def ended(self, of: tuple[object, ...]) -> bool:
        """True if these sums and criteria leave no request, or only requests that no record can satisfy."""
        return self.stalled or (self.phase is Phase.SETTLED and self.need.of == of)
