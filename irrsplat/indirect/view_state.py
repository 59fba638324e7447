"""How far one view has come: one value, replaced whole, that begins anew with another camera, size, scene or criterion."""

from __future__ import annotations

from dataclasses import dataclass

from irrsplat.core.buffers import Sites, SplatBuffer
from irrsplat.indirect import paper_scan
from irrsplat.scene.model import Camera

GIVE_UP = 8  # rounds in a row without gain in coverage, after which a view asks for no more


@dataclass(frozen=True)
class ViewState:
    """One view's progress.

    camera, subject: what the view is of, to be compared. pixel_stride: 2 while only every other pixel is to be splatted, else 1.
    rounds: complete ones. coverage: the share of the seen pixels that ask for nothing, 0..1, when the present round began.
    stalled_rounds: in a row without gain in coverage. settled: the splats and the criteria at which nothing was asked for;
    looked_at: those at which `coverage` was found while nothing was gathered. limited: whether the old records have been held
    against each other for this view.
    queue: the sites of the present round that are still to be gathered; None between rounds. missing: the share of the seen
    pixels that asked when the round began. step: of the site selection, coarse to fine. full: whether the view needs more records
    than there may be. scan: the view as the paper's algorithm goes through it.
    """

    camera: Camera | None = None
    subject: tuple[object, ...] = ()
    pixel_stride: int = 1
    rounds: int = 0
    coverage: float = 0.0
    stalled_rounds: int = 0
    settled: tuple[SplatBuffer, tuple[object, ...]] | None = None
    looked_at: tuple[SplatBuffer, tuple[object, ...]] | None = None
    limited: bool = False
    queue: Sites | None = None
    missing: float = 0.0
    step: int = 0
    full: bool = False
    scan: paper_scan.View | None = None

    @property
    def stalled(self) -> bool:
        """Whether rounds go on without gain in coverage: what still asks cannot be served."""
        return self.stalled_rounds >= GIVE_UP
