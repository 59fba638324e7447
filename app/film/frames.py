"""Frames of a flight, rendered in order by one renderer and written to files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from irrsplat.app.common.false_colours import FalseColours, save
from irrsplat.app.common.outputs import Outputs
from irrsplat.app.film.flight import Flight
from irrsplat.image import frame as output
from irrsplat.image.statistics import Statistics
from irrsplat.image.view import Progress
from irrsplat.renderer import Renderer

OnRound = Callable[[Progress], None]  # called after each round of a render
OnFrame = Callable[[str, int, int], OnRound | None]  # takes a frame's name, its index and the number of frames


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
    on_frame: OnFrame,
    outputs: Outputs,
    coloured: FalseColours | None,
    frozen: bool = False,
    kept: str = "",
) -> tuple[list[Statistics], bool]:
    """Render and write every frame; return the statistics of the written frames, and True if all are written.

    False follows from Ctrl-C, or from a failure of all `outputs`. Records stay from frame to frame. All frames have the first
    one's exposure: individual metering would flicker.

    on_frame: returns the callback of Renderer.render for a frame. coloured: of pictures. frozen: keep the cache
    unchanged. Each frame then depends only on cache, path and settings: figures are left out, and frame 0 of the path
    determines the exposure. kept: output with temporary files, written without a message.
    """
    done: list[Statistics] = []
    try:
        exposure = metered(renderer, flight, coloured) if frozen else None
        for i, number in enumerate(flight.numbers):
            show = on_frame(f"frame {number} of {flight.numbers[-1]}", i, len(flight.numbers))
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
