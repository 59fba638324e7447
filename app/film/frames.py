"""Frames of a flight, rendered in order by one renderer and written to files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

from irrsplat.app.common.false_colours import FalseColours, save
from irrsplat.image import frame as output
from irrsplat.image.statistics import Statistics

if TYPE_CHECKING:
    from irrsplat.app.common.outputs import Outputs
    from irrsplat.app.film.flight import Flight
    from irrsplat.image.view import Progress
    from irrsplat.renderer import Renderer


class OnRound(Protocol):
    """Callback after each round of a render.

    frame: name of the frame. before: share 0..1 of the path before this frame. share: the frame's share of the path.
    """

    def __call__(self, state: Progress, frame: str = "", before: float = 0.0, share: float = 1.0) -> None: ...


def frame_callback(on_round: OnRound | None, words: str, done: int, count: int) -> Callable[[Progress], None] | None:
    """Return a callback for the rounds of one frame, `words`, after `done` of `count` frames; None for None."""
    return None if on_round is None else partial(on_round, frame=words, before=done / count, share=1.0 / count)


def metered(renderer: Renderer, flight: Flight, coloured: FalseColours | None) -> float:
    """Return the common exposure of all frames in stops: that of frame 0, without a new record.

    That frame also determines the end of the false-colour scale.
    """
    exposure = renderer.settings.exposure
    if exposure != "auto" and (coloured is None or coloured.scale.highest is not None):
        return float(exposure)
    camera = flight.path.camera(0)
    frame = renderer.render(camera, gather=False)
    if coloured is not None:
        coloured.settle(frame, renderer, camera)
    return frame.exposure


def render(
    renderer: Renderer,
    flight: Flight,
    buffers: list[str] | None,
    figures: bool,
    on_round: OnRound | None,
    outputs: Outputs,
    coloured: FalseColours | None,
    frozen: bool = False,
    kept: str = "",
) -> tuple[list[Statistics], bool]:
    """Render and write every frame; return the statistics of the written frames, and True if all are written.

    False follows from Ctrl-C, or from a failure of all `outputs`. Records stay from frame to frame. All frames have the first
    one's exposure: individual metering would flicker.

    on_round: as for Renderer.render, with the frame and the path's progress. coloured: of pictures. frozen: keep the cache
    unchanged. Each frame then depends only on cache, path and settings: figures are left out, and frame 0 of the path
    determines the exposure. kept: output with temporary files, written without a message.
    """
    done: list[Statistics] = []
    try:
        exposure = metered(renderer, flight, coloured) if frozen else None
        for i, number in enumerate(flight.numbers):
            show = frame_callback(on_round, f"frame {number} of {flight.numbers[-1]}", i, len(flight.numbers))
            camera = flight.path.camera(number)
            if frozen:
                read = None if coloured is not None else output.needed(flight.outputs, buffers)
                frame = renderer.render(camera, progress=show, buffers=read, gather=False)
            else:
                frame = renderer.render(camera, progress=show, figures=figures)
            if frame.stats.get("interrupted"):
                return done, False
            exposure = frame.exposure if exposure is None else exposure
            stats = Statistics(frame=number)
            stats |= frame.stats
            stats["exposure"] = exposure
            frame = replace(frame, stats=stats)
            written = []
            for pattern in flight.outputs:
                name = output.numbered(pattern, number)
                write = partial(save, coloured, name, frame, buffers, renderer, camera)
                written.append(outputs.write(name, write, pattern, tells=pattern != kept))
            if not any(written):
                return done, False
            done.append(stats)
    except KeyboardInterrupt:  # between two renders, or during a write
        return done, False
    return done, True
