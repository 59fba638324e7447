"""The frames of a path, one after the other, with one renderer: which they are, what their files are called, what they took."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as File
from typing import TYPE_CHECKING

from irrsplat.core.errors import InputError
from irrsplat.image import frame as output
from irrsplat.image.statistics import Statistics
from irrsplat.scene.camera_path import Path, load_path

if TYPE_CHECKING:
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Scene


@dataclass(frozen=True)
class Sequence:
    """What is to be rendered: the frames `numbers` of `path`, each to every one of `outputs`, names with a {frame} in them."""

    path: Path
    numbers: range
    outputs: tuple[str, ...]


def first_names(args: argparse.Namespace) -> list[str]:
    """The names of the first frame's outputs, to be tried out before there is a scene; raises InputError for a bad {frame}."""
    return [output.numbered(pattern, _span(args)[0]) for pattern in args.output]


def plan(args: argparse.Namespace, scene: Scene) -> Sequence:
    """The frames that --path and --frames ask for; raises InputError where the path is wrong, or has or names too few."""
    path = load_path(_find(args.path, scene), scene.camera().fov if args.fov is None else args.fov)
    start, stop = _span(args)
    if max(start + 1, stop or 0) > path.frames:
        wanted = f"{start}:{'' if stop is None else stop}"
        raise InputError(f"--frames {wanted}: the path '{args.path}' has {path.frames} frames; give A:B within 0:{path.frames}")
    numbers = range(start, path.frames if stop is None else stop)
    for pattern in args.output:
        if len(numbers) > 1 and output.numbered(pattern, 0) == output.numbered(pattern, 1):
            reason = f"{len(numbers)} frames would go to one name; put {{frame}} into it, as in frame{{frame:04d}}.png"
            raise InputError(f"{reason}, or choose one with --frames", pattern)
    return Sequence(path, numbers, tuple(args.output))


def take(
    renderer: Renderer,
    sequence: Sequence,
    buffers: list[str] | None,
    figures: bool,
    progress: Callable[..., None] | None,
) -> tuple[list[Statistics], bool]:
    """Render and write every frame: the stats of those written, with "frame", and whether all are (False: interrupted).

    Records stay from frame to frame. All frames have the first one's exposure: a meter of their own would make them flicker.
    progress: as for Renderer.render, called with a `prefix` too that names the frame.
    """
    done: list[Statistics] = []
    try:
        for number in sequence.numbers:
            prefix = f"frame {number} of {sequence.numbers[-1]}, "
            show = None if progress is None else partial(progress, prefix=prefix)
            frame = renderer.render(sequence.path.camera(number), progress=show, figures=figures)
            if frame.stats.get("interrupted"):
                return done, False
            exposure = done[0]["exposure"] if done else frame.exposure
            stats = Statistics(frame=number)
            stats |= frame.stats
            stats["exposure"] = exposure
            frame = replace(frame, stats=stats)
            for pattern in sequence.outputs:
                frame.save(output.numbered(pattern, number), buffers)
            done.append(frame.stats)
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
