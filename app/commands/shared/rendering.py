"""Common steps of rendering commands: camera, cache file, progress and statistics."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path as File
from typing import TYPE_CHECKING, Any

from irrsplat.app.common.kept_cache import KeptCache
from irrsplat.app.common.outputs import check_distinct
from irrsplat.app.common.terminal import progress, say

if TYPE_CHECKING:
    from irrsplat.app.film.frames import OnFrame, OnRound
    from irrsplat.image.view import Progress
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera, Scene


def load(args: argparse.Namespace) -> Scene:
    """Return the scene of `args`, without the notice about an added camera if flags place the camera."""
    import irrsplat

    if args.path is None and args.eye is None:
        return irrsplat.load(args.scene, **vars(args.loading))
    return load_without_camera(args)


def load_without_camera(args: argparse.Namespace) -> Scene:
    """Return the scene of `args`, whose cameras have no effect: without the notice about an added camera."""
    import irrsplat
    from irrsplat.scene.io.defaults import NO_CAMERA

    scene = irrsplat.load(args.scene, **vars(args.loading))
    return replace(scene, notices=tuple(notice for notice in scene.notices if NO_CAMERA not in notice))


def camera(args: argparse.Namespace, scene: Scene) -> Camera:
    """Return the scene's camera named by `args`, with the values of flags."""
    camera = scene.camera(args.camera)
    given: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name in ("eye", "target", "up", "fov")
        if (value := getattr(args, name)) is not None
    }
    return replace(camera, **given) if given else camera


def check_kept_files(args: argparse.Namespace, names: Sequence[str] = ()) -> None:
    """Raise InputError for unusable files of --stats and --cache, and for duplicates among them and the outputs `names`."""
    from irrsplat.core import files, paths

    for path in (args.stats, args.cache):
        if path is args.cache is not None and args.cache_mode == "frozen":
            paths.check_readable(File(path), paths.MOST_GEOMETRY)
        elif path is not None:
            files.check_file(path)
    check_distinct(names, (("--stats", args.stats), ("--cache", args.cache)))


def load_cache(renderer: Renderer, args: argparse.Namespace) -> KeptCache:
    """Load the records of --cache, if the file exists, by --cache-mode; print the number of renewed records."""
    from irrsplat.records import cache_file

    kept = KeptCache(args.cache)
    if args.cache_mode != "frozen" and not os.path.exists(args.cache):
        return kept
    if reason := renderer.load_cache(args.cache, update=args.cache_mode == "update"):
        say(f"notice: {cache_file.renewal(args.cache, reason)}")
    return kept


@contextmanager
def round_progress(args: argparse.Namespace) -> Iterator[OnFrame]:
    """Provide the callbacks that show a progress line after each round of a frame; they are None if stderr is no terminal.

    A frame without a name is a single picture.
    """
    with progress("round 1: what is seen, and the light of further bounces") as line:

        def on_frame(frame: str, done: int, count: int) -> OnRound | None:
            def show(state: Progress) -> None:
                stage, words, share = _stage(state, float(args.values.get("quality", 0.0)))
                if line is not None:
                    line((done + share) / count, f"{frame}, {words}" if frame else words, "path" if frame else stage)

            return None if line is None else show

        yield on_frame


def _stage(state: Progress, quality: float) -> tuple[str, str, float]:
    """Return a render's stage, its progress line, and the completed share 0..1. quality: the setting, in %."""
    line = f"round {state.round}: {state.records} records" if state.round else f"{state.records} records"
    if state.sampled:
        return "samples", f"{line}, samples", state.sampled
    if state.error is not None and quality:
        percent = 100.0 * state.error  # falls with the square root of the work
        return "quality", f"{line}, error {percent:.2g} % to {quality:g} %", min(1.0, (quality / max(percent, 1e-6)) ** 2)
    return "rounds", f"{line}, coverage", state.coverage
