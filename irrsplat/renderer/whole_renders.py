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
from irrsplat.image.figures.paper_figures import PaperFigures
from irrsplat.image.frame import Frame, check_names
from irrsplat.image.statistics import Statistics
from irrsplat.image.view import Progress, View, frame_of, read, sample_progress, uncovered
from irrsplat.renderer.frames import Frames
from irrsplat.renderer.state import Round
from irrsplat.renderer.tiles import draw_tiles
from irrsplat.renderer.tiling import check_tiled, fitting
from irrsplat.scene.model import Camera
from irrsplat.scene.model.checks import check_callback
from irrsplat.settings import MOST_ROUNDS

OnRound = Callable[[Progress], None]


class WholeRenders:
    """Renders of whole views by a renderer's `frames`.

    about: of its OpenGL. checked: True if OpenGL's errors are checked, since nobody else uses the context.
    """

    def __init__(self, frames: Frames, about: context.Description, checked: bool) -> None:
        self.frames, self.about, self.checked = frames, about, checked
        self.ctx, self.stages, self.cache = frames.ctx, frames.stages, frames.scheduler.cache

    # ---- a view ----------------------------------------------------------------------------------------------------

    def filled(self, camera: Camera, progress: OnRound | None, gather: bool = True) -> tuple[Round, Statistics]:
        """Return the last round of a view, and its statistics, see Renderer.converge. gather: False leaves the cache as it is."""
        frames, start = self.frames, time.perf_counter()
        stats: Statistics = {"rounds": 0, "converged": False, "full": False, "interrupted": False, "coverage": 0.0, "error": None}
        frames.timers.clear()
        if gather:
            done = self._until_complete(camera, progress, stats)
        else:
            done = frames.frozen(camera)
            stats["converged"], stats["coverage"] = done.progress.coverage == 1.0, done.progress.coverage
            if progress is not None:
                progress(done.progress)
        self.ctx.finish()
        return done, stats | {"records": self.cache.count, "seconds": time.perf_counter() - start}

    def _until_complete(self, camera: Camera, progress: OnRound | None, stats: Statistics) -> Round:
        """Return the round without requests, or the last round that the settings allow. Fill its `stats`.

        Ctrl-C ends the rounds with the records of the last complete one.
        """
        frames, cache, done, ended = self.frames, self.cache, None, False
        # every pixel from the start: strided sums need fewer operations, and further rounds
        view = replace(frames.view_state(frames.state, camera), pixel_stride=1, stalled_rounds=0)
        frames.state, complete = replace(frames.state, view=view), cache.count + cache.evicted
        try:
            while not ended and stats["rounds"] < MOST_ROUNDS and not frames.state.view.stalled:
                frames.state, done = frames.round(frames.state, camera, Budget(None))
                now = done.progress
                complete, ended = cache.count + cache.evicted, now.new == 0 and now.complete
                stats["rounds"] += 1
                stats["coverage"], stats["full"], stats["converged"] = now.coverage, now.full, ended and not now.full
                if progress is not None:
                    progress(now)
        except KeyboardInterrupt:
            stats["interrupted"] = True
            cache.truncate(complete - cache.evicted)
        if done is None or not stats["converged"]:  # the records of the last round are still to be splatted
            view, _ = frames.scheduler.limit_radii(frames.view_state(frames.state, camera), last=True)
            frames.state = replace(frames.state, view=view)
            frames.state, done = frames.round(frames.state, camera, Budget(None), gather=False)
            stats["coverage"] = done.progress.coverage
        return done

    def _improved(self, view: View, stats: Statistics, progress: OnRound | None) -> tuple[View, Statistics]:
        """Return a converged view refined to the settings' `quality`, and its statistics. Ctrl-C ends the refinement early."""
        frames, start = self.frames, time.perf_counter()
        try:
            view, found = frames.refine(view.camera, 0.01 * frames.state.settings.quality, None, progress)
        except KeyboardInterrupt:
            stats |= {"interrupted": True, "converged": False}
            if frames.refines:
                view, found = frames.refined_view(view.camera)
        if not frames.refines:  # none that can be refined
            return view, stats
        stats["seconds"] += time.perf_counter() - start
        return view, stats | {"records": self.cache.count, "error": found.error}

    # ---- a frame that is read back -----------------------------------------------------------------------------------

    def render(
        self, camera: Camera, progress: OnRound | None, figures: bool, buffers: Collection[str] | None, gather: bool
    ) -> Frame:
        """Return the frame of a view, see Renderer.render."""
        frames, settings = self.frames, self.frames.state.settings
        check_names(buffers)
        check_callback("progress", progress)
        if not gather and (figures or settings.quality):
            raise InputError("figures and a quality need records of their own; leave them out, or let records be gathered")
        wanted = None if figures else buffers
        tiled = frames.state if self.stages.gbuffer is not None else fitting(frames.state, self.ctx, wanted)
        frames.refiner.leave()
        album = PaperFigures(partial(self.stages.splatted, frames.state, camera), progress)
        rounds = partial(self.filled, camera, album if figures else progress, gather)
        if tiled.tile:
            check_tiled(tiled, figures)
            kept = frames.state.tile
            self.stages.free_buffers()
            frames.state = replace(frames.state, tile=tiled.tile)
            try:
                return self._in_tiles(*rounds(), progress, buffers)
            finally:
                self.stages.free_buffers()
                frames.state = replace(frames.state, tile=kept)
        frame = self._whole(*rounds(), progress, buffers)
        return replace(frame, figures=album.figures(frame, camera, settings)) if figures else frame

    def _whole(self, done: Round, stats: Statistics, progress: OnRound | None, buffers: Collection[str] | None) -> Frame:
        """Return the frame of a round that is drawn whole."""
        frames, settings = self.frames, self.frames.state.settings
        view = self.stages.draw_picture(frames.state, done)
        if done.frozen:
            stats["uncovered"] = uncovered(view) if settings.most_bounces > 0 else 0
        if settings.quality and stats["converged"]:
            view, stats = self._improved(view, stats, progress)
        samples = 1 if stats["interrupted"] else settings.samples
        view = self.stages.accumulate(frames.state, view, samples, on_progress=sample_progress(progress, stats))
        if view.samples < settings.samples:  # Ctrl-C
            stats |= {"interrupted": True, "converged": False}
        stats |= self.described(view.samples, frames.stops(view))
        self._check_errors()
        return read(view, self.cache.read(), stats, buffers)

    def read(self, view: View) -> Frame:
        """Return the frame of a view that `Frames.frame` returned last, see View.read."""
        frames = self.frames
        frames.check_present(view)
        now = frames.progress(frames.state.view)
        stats: Statistics = {"rounds": now.round, "converged": now.done, "full": now.full, "coverage": now.coverage}
        stats |= {"records": now.records, "error": now.error}
        stats |= self.described(view.samples, frames.stops(view))
        return read(view, self.cache.read(), stats)

    def _in_tiles(self, done: Round, stats: Statistics, progress: OnRound | None, buffers: Collection[str] | None) -> Frame:
        """Return the frame of a round that is drawn in tiles."""
        state = self.frames.state
        arrays, view, stops = draw_tiles(self.stages, state, done, buffers, stats, sample_progress(progress, stats))
        samples, exposure = 1 if stats["interrupted"] else state.settings.samples, state.settings.exposure
        stats |= self.described(samples, stops if exposure == "auto" else float(exposure))
        self._check_errors()
        kept = {name: values for name, values in arrays.items() if buffers is None or name in buffers}
        return frame_of(kept, self.cache.read(), stats, view)

    def described(self, samples: int, stops: float) -> Statistics:
        """Return the statistics that describe scene, settings and OpenGL renderer for a picture; `converge` adds its counts.

        samples: per pixel. stops: exposure."""
        frames, state = self.frames, self.frames.state
        made: Statistics = {"samples": samples, "stages_ms": frames.timers.milliseconds(), "clock": frames.timers.clock}
        made |= cast(Statistics, frames.scheduler.gatherer.bounces(state.settings))
        made |= {"renderer": self.about["renderer"], "version": self.about["version"], "preset": state.preset}
        made |= {"settings": asdict(state.settings), "exposure": stops, "size": list(state.size)}
        return made | {"triangles": state.scene.triangles, "scene": state.scene.name}

    def _check_errors(self) -> None:
        """Raise GLError after an error of OpenGL, unless other code uses the context."""
        if self.checked:
            context.check_errors(self.ctx)
