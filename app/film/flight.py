"""Frames of a command's flight, and their output files."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File

from irrsplat.app.film.video import is_film
from irrsplat.core.errors import InputError
from irrsplat.image.frame import numbered
from irrsplat.scene.camera_path import Path, load_path
from irrsplat.scene.model import Scene


@dataclass(frozen=True)
class Flight:
    """Frames `numbers` of `path`, written to each of `outputs`: patterns with {frame}, or films of all frames."""

    path: Path
    numbers: range
    outputs: tuple[str, ...] = ()


def first_name(args: argparse.Namespace, pattern: str) -> str:
    """Return the output name of the first frame, for checks before loading; raise InputError for an invalid {frame}."""
    return pattern if is_film(pattern) else numbered(pattern, _span(args)[0])


def plan(args: argparse.Namespace, scene: Scene, outputs: Sequence[str] = ()) -> Flight:
    """Return the frames that --path and --frames select, with their output files.

    Raises InputError for an invalid path, an empty selection, and two frames with one file.
    """
    path = load_path(_find(args.path, scene), scene.camera().fov if args.fov is None else args.fov)
    start, stop = _span(args)
    if max(start + 1, stop or 0) > path.frames:
        span = f"{start}:{'' if stop is None else stop}"
        raise InputError(f"--frames {span}: the path '{args.path}' has {path.frames} frames; give A:B within 0:{path.frames}")
    numbers = range(start, path.frames if stop is None else stop)
    taken: dict[str, str] = {}  # file names, and the output of each
    for pattern in outputs:
        if is_film(pattern):
            continue
        if len(numbers) > 1 and numbered(pattern, 0) == numbered(pattern, 1):
            reason = f"{len(numbers)} frames would go to one name; put {{frame}} into it, as in frame{{frame:04d}}.png"
            raise InputError(f"{reason}, or choose one with --frames", pattern)
        for number in numbers:
            name = numbered(pattern, number)
            if (other := taken.setdefault(os.path.realpath(name), pattern)) != pattern:
                raise InputError(f"frame {number} would go to a file of '{other}'; give it a name of its own", pattern)
    return Flight(path, numbers, tuple(outputs))


def _span(args: argparse.Namespace) -> tuple[int, int | None]:
    return (0, None) if args.frames is None else args.frames


def _find(name: str, scene: Scene) -> File:
    """Return the path's file, from the working folder or else from the scene's folder."""
    for file in (File(name), File(scene.path).parent / name):
        if name and os.path.exists(file):
            return file
    raise InputError(f"--path '{name}': there is no such file, neither here nor in the scene's folder")
