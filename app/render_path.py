"""`irrsplat render --path`: which frames of a path are rendered, to which files, one after the other with one renderer."""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as File
from typing import TYPE_CHECKING, Protocol

from irrsplat.app.pictures import Pictures
from irrsplat.core.errors import InputError
from irrsplat.image import frame as output
from irrsplat.image.statistics import Statistics
from irrsplat.scene.camera_path import Path, load_path

if TYPE_CHECKING:
    from irrsplat.app.common.outputs import Outputs
    from irrsplat.image.view import Progress
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Scene


class OnRound(Protocol):
    """Called after each round of a render. frame: of a path, in words; before: the share of the path that is done with all frames
    before it, 0..1; share: what it is of the path itself."""

    def __call__(self, state: Progress, frame: str = "", before: float = 0.0, share: float = 1.0) -> None: ...


@dataclass(frozen=True)
class Flight:
    """The frames `numbers` of `path`, each to be written to every one of `outputs`, names with a {frame} in them."""

    path: Path
    numbers: range
    outputs: tuple[str, ...]


def first_name(args: argparse.Namespace, pattern: str) -> str:
    """The name of the first frame's output, to be checked before the scene is loaded; raises InputError for a bad {frame}."""
    return output.numbered(pattern, _span(args)[0])


def plan(args: argparse.Namespace, scene: Scene) -> Flight:
    """The frames that --path and --frames ask for; raises InputError where the path is wrong, or has or names too few."""
    path = load_path(_find(args.path, scene), scene.camera().fov if args.fov is None else args.fov)
    start, stop = _span(args)
    if max(start + 1, stop or 0) > path.frames:
        wanted = f"{start}:{'' if stop is None else stop}"
        raise InputError(f"--frames {wanted}: the path '{args.path}' has {path.frames} frames; give A:B within 0:{path.frames}")
    path.motions.check(scene, path.frames)
    numbers = range(start, path.frames if stop is None else stop)
    taken: dict[str, str] = {}  # names of files, and by which output
    for pattern in args.output:
        if len(numbers) > 1 and output.numbered(pattern, 0) == output.numbered(pattern, 1):
            reason = f"{len(numbers)} frames would go to one name; put {{frame}} into it, as in frame{{frame:04d}}.png"
            raise InputError(f"{reason}, or choose one with --frames", pattern)
        for number in numbers:
            name = output.numbered(pattern, number)
            if (other := taken.setdefault(os.path.realpath(name), pattern)) != pattern:
                raise InputError(f"frame {number} would go to a file of '{other}'; give it a name of its own", pattern)
    return Flight(path, numbers, tuple(args.output))


def render(
    renderer: Renderer,
    flight: Flight,
    buffers: list[str] | None,
    figures: bool,
    on_round: OnRound | None,
    outputs: Outputs,
    files: Pictures,
) -> tuple[list[Statistics], bool]:
    """Render and write every frame; returns the statistics of those written, and whether that is all of them (False: Ctrl-C, or
    none of the `outputs` can be written any more).

    Records stay from frame to frame. All frames have the first one's exposure: metered one by one, they would flicker.
    on_round: as for Renderer.render, called with the frame and how far the path is as well. files: how they are written.
    """
    done: list[Statistics] = []
    motions = flight.path.motions
    loaded = renderer.scene if motions else None
    try:
        for i, number in enumerate(flight.numbers):
            words, share = f"frame {number} of {flight.numbers[-1]}", 1.0 / len(flight.numbers)
            show = None if on_round is None else partial(on_round, frame=words, before=i * share, share=share)
            if loaded is not None:
                renderer.pose(motions.at(loaded, number))
            camera = flight.path.camera(number)
            frame = renderer.render(camera, progress=show, figures=figures)
            if frame.stats.get("interrupted"):
                return done, False
            stats = Statistics(frame=number)
            stats |= frame.stats
            stats["exposure"] = done[0]["exposure"] if done else frame.exposure
            frame = replace(frame, stats=stats)
            written = []
            for pattern in flight.outputs:
                name = output.numbered(pattern, number)
                written.append(outputs.write(name, partial(files.save, name, frame, buffers, renderer, camera), pattern))
            if not any(written):
                return done, False
            done.append(stats)
    except KeyboardInterrupt:  # between two renders, or while a file was written
        return done, False
    return done, True


def _span(args: argparse.Namespace) -> tuple[int, int | None]:
    return (0, None) if args.frames is None else args.frames


def _find(name: str, scene: Scene) -> File:
    """The path's file: as it is called, or else in the scene's own folder."""
    for file in (File(name), File(scene.path).parent / name):
        if name and os.path.exists(file):
            return file
    raise InputError(f"--path '{name}': there is no such file, neither here nor in the scene's folder")
