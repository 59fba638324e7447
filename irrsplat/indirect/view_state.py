"""One view's progress: an immutable value that restarts with another camera, size, scene or criterion."""

from __future__ import annotations

from dataclasses import dataclass

from irrsplat.core.buffers import Sites
from irrsplat.gather.spot_check import SpotCheck
from irrsplat.indirect import paper_scan
from irrsplat.scene.model import Camera

GIVE_UP = 8  # rounds in a row without gain in coverage, after which a view requests no more records


@dataclass(frozen=True)
class ViewState:
    """One view's progress; `camera` and `subject` identify the view by all inputs of its requests."""

    camera: Camera | None = None
    subject: tuple[object, ...] = ()
    pixel_stride: int = 1  # 2 while only every other pixel is to be splatted, in both directions

    # over all rounds
    rounds: int = 0  # complete ones
    coverage: float = 0.0  # covered share of the seen pixels when the present round began, 0..1
    stalled_rounds: int = 0  # in a row, without gain in coverage and without fewer holes
    limited: bool = False  # True once the old records have been compared with each other for this view
    check: SpotCheck | None = None  # how far the spot check has come
    checked: bool = False  # True once it is done and has requested records where the others were wrong
    crowded: bool = False  # whether many tiles asked when the last complete round began
    closing: bool = False  # whether what waits until hardly any tile asks is due: the spot check, the reach of old records
    settled: tuple[object, tuple[object, ...]] | None = None  # the splats and criteria at which no record was requested
    examined_at: tuple[object, tuple[object, ...]] | None = None  # the sums and criteria of `coverage`, while nothing is gathered

    # the present round
    queue: Sites | None = None  # the sites that are still to be gathered; None between rounds
    near: bool = False  # whether they lie as close together as sites may: their records serve only what is near
    missing: float = 0.0  # under-covered share of the seen pixels when it began
    requesting: int = 0  # tiles that requested a record when it began
    holes: int = 0  # tiles with a pixel that no record covered when it began
    holes_before: int = 0  # when the round before it began
    step: int = 0  # of the site selection, coarse to fine
    full: bool = False  # whether the view needs more records than there may be
    scan: paper_scan.View | None = None  # the view as the paper's algorithm goes through it

    @property
    def ended(self) -> bool:
        """True if no pixel requests a record any more, or if the remaining requests cannot be met."""
        return self.settled is not None or self.stalled

    @property
    def stalled(self) -> bool:
        """True if rounds no longer gain coverage: the remaining requests cannot be met."""
        return self.stalled_rounds >= GIVE_UP
