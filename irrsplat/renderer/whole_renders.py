"""Whole renders: rounds until every pixel is covered, refinement, samples, and the Frame that is read back.

Cameras are relative to the scene's origin here, and so are the frames that come back.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import asdict, replace
from functools import partial
from typing import cast

from irrsplat.core.errors import InputError
from irrsplat.gpu import context
from irrsplat.gpu.time_budget import Budget
from irrsplat.image import view as views
from irrsplat.image.figures.paper_figures import PaperFigures
from irrsplat.image.frame import Frame, check_names
from irrsplat.image.statistics import Statistics
from irrsplat.image.view import Progress, View, sample_progress, uncovered
from irrsplat.renderer.frames import Frames
from irrsplat.renderer.state import Round
from irrsplat.renderer.tiles import check_tiled, draw_tiles, fitting
from irrsplat.scene.model import Camera
from irrsplat.scene.model.checks import check_callback
from irrsplat.settings import MOST_ROUNDS

OnRound = Callable[[Progress], None]


def filled(frames: Frames, camera: Camera, progress: OnRound | None, gather: bool = True) -> tuple[Round, Statistics]:
    """Return the last round of a view, and its statistics, see Renderer.converge. gather: False leaves the cache as it is."""
    start = time.perf_counter()
    stats: Statistics = {"rounds": 0, "converged": False, "full": False, "interrupted": False, "coverage": 0.0, "error": None}
    frames.timers.clear()
    if gather:
        done = _until_complete(frames, camera, progress, stats)
    else:
        done = frames.frozen(camera)
        stats["converged"], stats["coverage"] = done.progress.coverage == 1.0, done.progress.coverage
        if progress is not None:
            progress(done.progress)
    frames.ctx.finish()
    return done, stats | {"records": frames.cache.count, "seconds": time.perf_counter() - start}


def _until_complete(frames: Frames, camera: Camera, progress: OnRound | None, stats: Statistics) -> Round:
    """Return the round without requests, or the last round that the settings allow. Fill its `stats`.

    Ctrl-C ends the rounds with the records of the last complete one.
    """
    cache, done, ended = frames.cache, None, False
    # every pixel from the start: strided sums need fewer operations, and further rounds
    view = replace(frames.view_state(frames.state, camera), pixel_stride=1, stalled_rounds=0)
    frames.state, complete = replace(frames.state, view=view), cache.count + cache.evicted
    try:
        while not ended and stats["rounds"] < MOST_ROUNDS and not frames.state.view.stalled:
            frames.state, done = frames.round(frames.state, camera, Budget(None))
            now = done.progress
            complete, ended = cache.count + cache.evicted, now.new == 0 and now.complete
            stats["rounds"] += 1
            stats["coverage"], stats["full"], stats["converged"] = (
                now.coverage,
                now.full,
                ended and not (now.full or frames.state.view.stalled),
            )
            if progress is not None:
                progress(now)
    except KeyboardInterrupt:
        stats["interrupted"] = True
        cache.truncate(complete - cache.evicted)
    if done is None or not stats["converged"]:  # the records of the last round are still to be splatted
        frames.scheduler.limit_radii(frames.state.view, old_too=True)
        frames.state, done = frames.round(frames.state, camera, Budget(None), gather=False)
        stats["coverage"] = done.progress.coverage
    return done


def render(
    frames: Frames, camera: Camera, progress: OnRound | None, figures: bool, buffers: Collection[str] | None, gather: bool
) -> Frame:
    """Return the frame of a view, see Renderer.render."""
    settings, stages = frames.state.settings, frames.stages
    check_names(buffers)
    check_callback("progress", progress)
    if not gather and (figures or settings.quality):
        raise InputError("figures and a quality need records of their own; leave them out, or let records be gathered")
    wanted = None if figures else buffers
    tiled = frames.state if stages.gbuffer is not None else fitting(frames.state, frames.ctx, wanted)
    frames.refiner.leave()
    album = PaperFigures(partial(stages.splatted, frames.state, camera), progress)
    rounds = partial(filled, frames, camera, album if figures else progress, gather)
    if tiled.tile:
        check_tiled(tiled, figures)
        kept = frames.state.tile
        stages.free_buffers()
        frames.state = replace(frames.state, tile=tiled.tile)
        try:
            return _in_tiles(frames, *rounds(), progress, buffers)
        finally:
            stages.free_buffers()
            frames.state = replace(frames.state, tile=kept)
    frame = _whole(frames, *rounds(), progress, buffers)
    return replace(frame, figures=album.figures(frame, camera, settings)) if figures else frame


def _whole(frames: Frames, done: Round, stats: Statistics, progress: OnRound | None, buffers: Collection[str] | None) -> Frame:
    """Return the frame of a round that is drawn whole."""
    settings, view = frames.state.settings, frames.stages.draw_picture(frames.state, done)
    if done.frozen:
        stats["uncovered"] = uncovered(view) if settings.most_bounces > 0 else 0
    if settings.quality and stats["converged"]:
        view, stats = _improved(frames, view, stats, progress)
    samples = 1 if stats["interrupted"] else settings.samples
    view = frames.stages.accumulate(frames.state, view, samples, on_progress=sample_progress(progress, stats))
    if view.samples < settings.samples:  # Ctrl-C
        stats |= {"interrupted": True, "converged": False}
    stats |= _described(frames, view.samples, frames.stops(view))
    return views.read(view, frames.cache.read(), stats, buffers)


def _improved(frames: Frames, view: View, stats: Statistics, progress: OnRound | None) -> tuple[View, Statistics]:
    """Return a converged view refined to the settings' `quality`, and its statistics. Ctrl-C ends the refinement early."""
    start = time.perf_counter()
    try:
        view, found = frames.refine(view.camera, 0.01 * frames.state.settings.quality, None, progress)
    except KeyboardInterrupt:
        stats |= {"interrupted": True, "converged": False}
        if frames.refines:
            view, found = frames.refined_view(view.camera)
    if not frames.refines:  # none that can be refined
        return view, stats
    stats["seconds"] += time.perf_counter() - start
    return view, stats | {"records": frames.cache.count, "error": found.error}


def _in_tiles(frames: Frames, done: Round, stats: Statistics, progress: OnRound | None, buffers: Collection[str] | None) -> Frame:
    """Return the frame of a round that is drawn in tiles."""
    state = frames.state
    arrays, view, stops = draw_tiles(frames.stages, state, done, buffers, stats, sample_progress(progress, stats))
    samples, exposure = 1 if stats["interrupted"] else state.settings.samples, state.settings.exposure
    stats |= _described(frames, samples, stops if exposure == "auto" else float(exposure))
    kept = {name: values for name, values in arrays.items() if buffers is None or name in buffers}
    return views.frame_of(kept, frames.cache.read(), stats, view)


def read(frames: Frames, view: View) -> Frame:
    """Return the frame of a view that `Frames.frame` returned last, see View.read."""
    frames.check_present(view)
    now = frames.progress(frames.state.view)
    stats: Statistics = {"rounds": now.round, "converged": now.done, "full": now.full, "coverage": now.coverage}
    stats |= {"records": now.records, "error": now.error, **_described(frames, view.samples, frames.stops(view))}
    return views.read(view, frames.cache.read(), stats)


def _described(frames: Frames, samples: int, stops: float) -> Statistics:
    """Return the statistics that describe scene, settings and OpenGL renderer for a picture. stops: exposure."""
    state, about = frames.state, context.describe(frames.ctx)
    made: Statistics = {"samples": samples, "stages_ms": frames.timers.milliseconds(), "clock": frames.timers.clock}
    made |= cast(Statistics, frames.scheduler.gatherer.bounces(state.settings))
    made |= {"renderer": about["renderer"], "version": about["version"], "preset": state.preset}
    made |= {"settings": asdict(state.settings), "exposure": stops, "size": list(state.size)}
    return made | {"triangles": state.scene.triangles, "scene": state.scene.name}
