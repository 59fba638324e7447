"""The frames of a flight, rendered one after the other with one renderer and written to files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

from irrsplat.app.common.pictures import Pictures
from irrsplat.app.film.kept import unwritten
from irrsplat.image import frame as output
from irrsplat.image.statistics import Statistics

if TYPE_CHECKING:
    from irrsplat.app.common.outputs import Outputs
    from irrsplat.app.film.flight import Flight
    from irrsplat.image.view import Progress
    from irrsplat.renderer import Renderer


class OnRound(Protocol):
    """Called after each round of a render. frame: of a path, in words; before: the share of the path that is done with all frames
    before it, 0..1; share: what it is of the path itself."""

    def __call__(self, state: Progress, frame: str = "", before: float = 0.0, share: float = 1.0) -> None: ...


def told(on_round: OnRound | None, words: str, done: int, count: int) -> Callable[[Progress], None] | None:
    """What tells `on_round` of the rounds of one frame, `words`, after `done` of `count` frames; None for None."""
    return None if on_round is None else partial(on_round, frame=words, before=done / count, share=1.0 / count)


def metered(renderer: Renderer, flight: Flight, files: Pictures, number: int = 0, gather: bool = False) -> float:
    """The exposure in stops that all frames have: that of frame `number`, whichever are rendered. That frame also decides where
    the scale of false colours ends. gather: whether it may gather records."""
    exposure, coloured = renderer.settings.exposure, files.coloured
    if exposure != "auto" and (coloured is None or coloured.scale.highest is not None):
        return float(exposure)
    camera = flight.path.camera(number)
    frame = renderer.render(camera, gather=gather)
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
    files: Pictures,
    frozen: bool = False,
    resume: bool = False,
    kept: str = "",
) -> tuple[list[Statistics], bool]:
    """Render and write every frame; returns the statistics of those written, and whether that is all of them (False: Ctrl-C, or
    none of the `outputs` can be written any more).

    Records stay from frame to frame. All frames have the first one's exposure: metered one by one, they would flicker.
    on_round: as for Renderer.render, called with the frame and how far the path is as well. files: how they are written.
    frozen: the cache is left as it is, and each frame depends on nothing but that, path and settings: figures
    are left out then, and exposure is that of the path's frame 0, whichever frame is rendered first. resume: files that are there
    stay, and frames that have all of theirs are not rendered. kept: that of the outputs whose files are nothing to tell of.
    """
    done: list[Statistics] = []
    exposure: float | None = None
    motions = flight.path.motions
    loaded = renderer.scene if motions else None
    try:
        wanted = {number: unwritten(flight.outputs, number) if resume else flight.outputs for number in flight.numbers}
        wanted = {number: patterns for number, patterns in wanted.items() if patterns}
        if frozen and wanted:
            exposure = metered(renderer, flight, files)
        elif wanted and flight.numbers[0] not in wanted:
            exposure = metered(renderer, flight, files, flight.numbers[0], gather=True)
        for i, (number, patterns) in enumerate(wanted.items()):
            show = told(on_round, f"frame {number} of {flight.numbers[-1]}", i, len(wanted))
            if loaded is not None:
                renderer.pose(motions.at(loaded, number))
            camera = flight.path.camera(number)
            if frozen:
                read = None if files.of_all_buffers else output.needed(patterns, buffers)
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
            for pattern in patterns:
                name = output.numbered(pattern, number)
                write = partial(files.save, name, frame, buffers, renderer, camera)
                written.append(outputs.write(name, write, pattern, tells=pattern != kept))
            if not any(written):
                return done, False
            done.append(stats)
    except KeyboardInterrupt:  # between two renders, or while a file was written
        return done, False
    return done, True
