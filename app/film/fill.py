"""`irrsplat fill`: gather the records of a whole flight into a cache, for frames with a frozen cache."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from irrsplat.app.common.terminal import say
from irrsplat.app.film.flight import Flight
from irrsplat.app.film.frames import OnFrame
from irrsplat.renderer import Renderer

_SAVED_EACH = 60.0  # seconds: the most work that a killed process loses
PASSES = 8  # limit: a frame's records can reduce the radii of others, which opens gaps there


@dataclass(frozen=True)
class Filled:
    """Result of filling a cache.

    frames: coverage 0..1 of each frame by its number, the share of visible pixels without a request. passes: repetitions of
    the flight. evicted: records removed for lack of space. interrupted: True after Ctrl-C.
    """

    frames: dict[int, float]
    passes: int
    evicted: int
    interrupted: bool


def fill(renderer: Renderer, flight: Flight, on_frame: OnFrame, save: Callable[[], object]) -> Filled:
    """Gather the records of the frames of `flight`; repeat until no frame has lost coverage to another frame's records.

    save: called between two frames once a minute, so that a kill loses little work.
    """
    found: dict[int, float] = {}
    evicted, flown, saved, interrupted = renderer.cache.evicted, 0, time.monotonic(), False
    try:
        for flown in range(1, PASSES + 1):
            lost = 0
            for i, number in enumerate(flight.numbers):
                words = f"frame {number} of {flight.numbers[-1]}" + (f", again ({flown})" if flown > 1 else "")
                camera = flight.path.camera(number)
                if flown == 1 or renderer.coverage(camera) < found[number]:
                    lost += 1
                    _, stats = renderer.converge(camera, on_frame(words, i, len(flight.numbers)))
                    if stats["interrupted"]:
                        raise KeyboardInterrupt
                    found[number] = stats["coverage"]
                    if time.monotonic() - saved > _SAVED_EACH:
                        save()
                        saved = time.monotonic()
            if not lost:
                break
        found |= {number: renderer.coverage(flight.path.camera(number)) for number in flight.numbers if flown == PASSES}
    except KeyboardInterrupt:
        interrupted = True
    return Filled(found, flown, renderer.cache.evicted - evicted, interrupted)


def statistics(done: Filled, records: int) -> dict[str, object]:
    """Return the data for --stats: records, passes, and the coverage of each frame."""
    frames = [{"frame": number, "coverage": coverage} for number, coverage in done.frames.items()]
    return {"records": records, "passes": done.passes, "evicted": done.evicted, "frames": frames}


def warn(done: Filled) -> None:
    """Print missing coverage, if any."""
    if done.evicted:
        say(f"notice: the flight needs more records than there may be, {done.evicted} had to go; raise --max-records")
    if short := [coverage for coverage in done.frames.values() if coverage < 1.0]:  # frames with under-covered pixels
        most = 1.0 - min(short)
        say(f"notice: {len(short)} of {len(done.frames)} frames still ask for records, at worst at {most:.2%} of their pixels")
