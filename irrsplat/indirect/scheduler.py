"""Where records are made, and when: rounds of examination and gathering, as far as a tick's time goes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, GBuffer, HitLight, ShadowMaps, Sites, SplatBuffer
from irrsplat.gather import autotune
from irrsplat.gather.look import Gather, gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.world import World
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.gpu.timers import Timers
from irrsplat.indirect import paper_scan
from irrsplat.indirect.change_probe import MOST, SIDE, Probes, concerned
from irrsplat.indirect.examine import ExaminePass
from irrsplat.indirect.site_selection import choose, spacing
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.adaptive_radius import Adaptation
from irrsplat.records.culling import within
from irrsplat.records.eviction import kept
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.refresh_order import Renewal
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings
from irrsplat.surface_cache.cache import SurfaceCache

_REACH = 8.0  # percent of the image height by which the first sites lie apart where radii have no upper limit
_ASKING = ("gather", "splat", "examine")  # the stages whose settings decide where records are asked for


@dataclass(frozen=True)
class RoundResult:
    """What came of a look at the splat buffer: the records made, the share of the seen pixels that asked for one, and whether
    all sites of the round are gathered."""

    new: int
    missing: float
    complete: bool


class RecordScheduler(Owner):
    """Examines what a view of `size` (width, height) lacks, and fills the `cache` by it."""

    def __init__(
        self,
        ctx: moderngl.Context,
        scene: Scene,
        size: tuple[int, int],
        settings: Settings,
        geometry: Geometry,
        cache: RecordCache,
        timers: Timers,
    ) -> None:
        self.ctx, self.cache, self.timers = ctx, cache, timers
        self.settings, self.scene, self.size = settings, scene, size
        self.world = World(ctx, scene, geometry)
        self.surface: SurfaceCache | None = None  # made when a second bounce is first wanted
        self.gather_pass = self._gather_pass()
        self.reduce_pass = ReducePass(ctx, settings.gradients)
        self.examine_pass = ExaminePass(ctx, size)
        self.adaptation = Adaptation(ctx, settings, cache, timers)
        self.resumed: dict[str, Any] | None = None  # `bounces` of records from a file, while their surface cache is not made yet
        self.probes: Probes | None = None  # made when something first moves
        self.moved = False  # and which records that concerns is still to be found out
        self.renewal = Renewal(ctx, settings.gradients)
        self.atlas: Atlas | None = None  # the last one gathered
        self._pace = Pace(ctx)
        self.new_view()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        passes = self.gather_pass, self.reduce_pass, self.examine_pass
        return (self.world, self.surface, *passes, self.adaptation, self.probes, self.renewal)

    def _gather_pass(self) -> Gather:
        one = 1 if self.settings.placement == "scan" else None  # the paper: one at a time
        if self.settings.most_bounces > 1 and self.surface is None:
            self.surface = SurfaceCache(self.world, self.settings, self.timers)
        return autotune.gather_pass(self.world, self.settings, capacity=one)

    def light(self, shadows: ShadowMaps) -> HitLight:
        """What lights the surfaces that gathers see."""
        if self.surface is None or self.settings.most_bounces < 2:
            return HitLight(shadows)
        return HitLight(shadows, self.surface.uniforms())

    # ---- what changes ----------------------------------------------------------------------------------------------

    def new_view(self) -> None:
        """Forget what was asked for and how far the sites have come from coarse to fine: the camera sees something else."""
        self._queue: Sites | None = None  # of the present round, still to be gathered
        self._missing = 0.0  # share of the pixels, at the round's begin
        self._pattern = 0
        self._view: paper_scan.View | None = None  # as the paper's algorithm goes through it
        self.full = False  # whether the view needs more records than there may be
        self.adaptation.new_view()

    def change(self, settings: Settings, scene: Scene, shadows: ShadowMaps | None = None) -> None:
        """Go on with other settings and lights, and meshes elsewhere; records that depend on what changed become stale, or are
        forgotten: those close to where what has moved was or is. shadows: those of the scene before.

        Without bounces nothing is gathered, and whatever there is is kept for when there are as many again.
        """
        old = self.settings
        settings = settings if settings.most_bounces else replace(settings, bounces=old.bounces)
        self.settings = settings
        moved = self.scene.meshes is not scene.meshes
        if moved and shadows is not None and not self.moved:
            new = np.flatnonzero(self.cache.probes[:, 3] == 0.0)
            self.cache.probes[new] = self._probe(shadows, new)
        before, self.scene, self.moved = self.scene, scene, self.moved or moved
        if _where(old) != _where(settings):
            self.cache.truncate(0)
        if moved:
            self._keep(self.cache.follow(before, scene))
            self.resumed = None
        self.world.set_scene(scene)
        if self.surface is not None:
            self.surface.change(settings)
        gathered = self._how(old) != self._how(settings)
        if gathered or light_defines(before) != light_defines(scene) or old.placement != settings.placement:
            self.gather_pass.release()
            if self.probes is not None:
                self.probes.release()
                self.probes = None
            self.gather_pass, self.atlas, self._pace = self._gather_pass(), None, Pace(self.ctx)
        if old.gradients != settings.gradients:
            self.reduce_pass.release()
            self.reduce_pass = ReducePass(self.ctx, settings.gradients)
            self.renewal.release()
            self.renewal = Renewal(self.ctx, settings.gradients)
        self.adaptation.change(settings)
        more = settings.gradients and not old.gradients  # records gathered without them have none
        if gathered or more or before.lights != scene.lights or old.shadow_size != settings.shadow_size:
            self.cache.expire()
            self.resumed = None
        if old.of(*_ASKING) != settings.of(*_ASKING):
            self.new_view()

    def resize(self, size: tuple[int, int]) -> None:
        """Views are of another size from now on."""
        self.size = size
        self.examine_pass.release()
        self.examine_pass = ExaminePass(self.ctx, size)
        self.new_view()

    def resume(self, bounces: dict[str, Any]) -> None:
        """The cache has records from a file now, of so many `bounces`, by a surface cache such as will be made when wanted."""
        whole = self.surface is None or self.surface.whole or self.settings.most_bounces < 2
        self.resumed, self.moved = None if whole else bounces, False
        self.new_view()

    # ---- rounds ----------------------------------------------------------------------------------------------------

    def ready(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on with what gathering needs, as `bounce` does; but a render with records from a file may need none of it."""
        waits = self.resumed is not None and not budget.limited and not len(self.cache.stale)
        return waits or self.bounce(shadows, budget)

    def bounce(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on with the surface cache where more than one bounce is wanted; whether records may be gathered by it meanwhile.

        Once its values are others, all records are stale. Those that it had before lights changed are better than none, and then
        it takes half of the time.
        """
        self._settle(shadows)
        if self.surface is None or self.settings.most_bounces < 2:
            return True
        ready = self.surface.result is not None
        if self.surface.advance(shadows, budget.part(0.5, 0.0) if ready else budget):
            if self.resumed is None:
                self.moved = True
                self._settle(shadows)
            self.resumed = None  # by such values they were gathered, too
        return self.surface.result is not None

    def _settle(self, shadows: ShadowMaps) -> None:
        """Make the records stale that the last move concerns, or other light of the further bounces after it: all of them where
        something else has changed since they were looked at."""
        if not self.moved:
            return
        self.moved, cache = False, self.cache
        looked = cache.probes[:, 3].any()
        cache.expire(concerned(cache, self._probe(shadows, np.arange(cache.count))) if looked else None)

    def _probe(self, shadows: ShadowMaps, numbers: np.ndarray) -> np.ndarray:
        """(N, 4), as Probes has it, of the records of these numbers."""
        if self.probes is None:
            self.probes = Probes(autotune.gather_pass(self.world, replace(self.settings, gather_size=SIDE), MOST))
        with self.timers("gather"):
            return self.probes(self.light(shadows), self.cache.sites(numbers), self.settings.seed)

    @property
    def bounced(self) -> float:
        """How much of the surface cache is made, 0..1; 1 where none is wanted."""
        return 1.0 if self.surface is None or self.settings.most_bounces < 2 else self.surface.share

    def surface_seen(self, gbuffer: GBuffer) -> moderngl.Texture | None:
        """What the surface cache says of every pixel, as SurfacePass has it; None where there is none (yet)."""
        if self.surface is None or self.surface.result is None or self.settings.most_bounces < 2:
            return None
        return self.surface.view(gbuffer)

    def bounces(self, settings: Settings) -> dict[str, Any]:
        """For the statistics: how records are gathered; how many bounces there are, and, where all are wanted, whether hardly
        anything is still to come."""
        how = {"gathered_by": self.gather_pass.kind}
        everything, most = settings.bounces == "all", settings.most_bounces
        made = self.surface.result if self.surface is not None and most > 1 else None
        if made is None and self.resumed is not None:
            return how | self.resumed
        if made is None:
            return how | {"bounces": min(most, 1), "bounces_converged": False if everything else None}
        return how | {"bounces": made.bounces, "bounces_converged": made.settled if everything else None}

    def expire(self) -> None:
        """Gather everything again."""
        self.resumed = None
        self.cache.expire()
        if self.surface is not None:
            self.surface.expire()

    def renew(self, shadows: ShadowMaps, gbuffer: GBuffer, camera: Camera, budget: Budget) -> int:
        """Gather stale records again in place, those that this view shows most of first; how many."""
        numbers, done = self.renewal.order(self.cache, gbuffer, camera, self.settings), 0
        for count in self._pace.batches(len(numbers), self.gather_pass.capacity, budget):
            chosen = numbers[done : done + count]
            self._gather(shadows, chosen)
            self.cache.renewed(chosen)
            done += count
        return done

    def count_in_view(self, camera: Camera) -> int:
        """How many records lie in the view's pyramid, hidden ones too."""
        return int(np.count_nonzero(within(self.cache.positions, camera, self.size)))

    def adapt(self, last: bool = False) -> bool:
        """Hold the records against each other, as Adaptation does; whether any that were there reach otherwise now."""
        return self.adaptation(self.settings, last)

    def ask(
        self, gbuffer: GBuffer, splats: SplatBuffer, shadows: ShadowMaps, camera: Camera, budget: Budget, every: int = 1
    ) -> RoundResult:
        """Gather where the examination of this view asks for records; every: of how many pixels the splats are."""
        if self.settings.placement == "scan":
            return self._scan(gbuffer, splats, shadows, camera, budget)
        if self._queue is None:
            sites, self._missing = self._examine(gbuffer, splats, every)
            self._queue = sites[: self._room(len(sites), camera)]
        if len(self._queue) and self.resumed is not None:
            self.bounce(shadows, budget)
        done = 0
        for count in self._pace.batches(len(self._queue), self.gather_pass.capacity, budget):
            numbers = self.cache.append(self._queue[done : done + count]) + np.arange(count)
            self._gather(shadows, numbers)
            done += count
        self._queue = self._queue[done:] if done < len(self._queue) else None
        return RoundResult(done, self._missing, self._queue is None)

    def _room(self, wanted: int, camera: Camera) -> int:
        """How many more records there may be, once those have gone that are in the way of `wanted` new ones, if they may."""
        numbers = kept(self.cache, wanted, camera, self.size, self.settings)
        if numbers is not None:
            self._keep(numbers)
        room = max(self.settings.max_records - self.cache.count, 0)
        self.full = room < wanted
        return room

    def _keep(self, numbers: np.ndarray) -> None:
        self.cache.keep(numbers)
        self.adaptation.keep(numbers)

    def missing(self, gbuffer: GBuffer, splats: SplatBuffer, every: int = 1) -> float:
        """The share of the seen pixels that ask for a record now; nothing is gathered."""
        with self.timers("examine"):
            return self.examine_pass(gbuffer, splats, self.settings, every).missing

    def _examine(self, gbuffer: GBuffer, splats: SplatBuffer, every: int) -> tuple[Sites, float]:
        # while some are stale, records contradict each other for that alone
        settings = replace(self.settings, spread=0.0) if len(self.cache.stale) else self.settings
        with self.timers("examine"):
            found = self.examine_pass(gbuffer, splats, settings, every)
            reach = (settings.radius_max or _REACH) / 100.0 * self.size[1] / self.examine_pass.side  # tiles
            asking = int(np.count_nonzero(found.asking)) * every**2  # as many tiles as about would, were all pixels looked at
            tiles = choose(found.asking, *spacing(self._pattern, reach, asking), settings.seed)
            while asking and not len(tiles[0]):  # these fields of the chess board ask for nothing: the next ones
                self._pattern += 1
                tiles = choose(found.asking, *spacing(self._pattern, reach, asking), settings.seed)
            self._pattern += 1
            return found.at(tiles), found.missing

    def _scan(self, gbuffer: GBuffer, splats: SplatBuffer, shadows: ShadowMaps, camera: Camera, budget: Budget) -> RoundResult:
        """The same by the paper's own algorithm: random warm-up records, then a traversal in scan order on the CPU."""
        if self._view is None:
            with self.timers("gbuffer"):
                self._view = paper_scan.View(gbuffer, self.settings.warmup if self.cache.count else 0)
        if self.resumed is not None:
            self.bounce(shadows, budget)
        if not (room := self._room(1, camera)):
            return RoundResult(0, self.missing(gbuffer, splats), True)
        more, light = iter(range(1, room)), self.light(shadows)

        def goes_on() -> bool:
            return budget.left > 0.0 and next(more, None) is not None

        record = paper_scan.Recorder(self.gather_pass, light, goes_on)
        with self.timers("gather" if self._view.warmed < self.settings.warmup else "examine"):
            sites, values, missing = self._view.ask(pixels(splats.weight)[..., 0], record, camera, self.settings)
        if len(sites):
            self.cache.append(sites, values)
        return RoundResult(len(sites), missing, not record.stopped)

    def _how(self, settings: Settings) -> tuple[object, ...]:
        """What a record at its place says, and how well, goes by these."""
        return autotune.kind(self.ctx, self.scene, settings), settings.gather_size, settings.most_bounces > 1

    def _gather(self, shadows: ShadowMaps, numbers: np.ndarray) -> None:
        """Gather the records of these numbers, where the cache has them."""
        gather, reduce, light = self.gather_pass, self.reduce_pass, self.light(shadows)
        self.atlas = gather_records(gather, reduce, light, self.cache, numbers, self.settings.seed, self.timers)


def _where(settings: Settings) -> tuple[object, ...]:
    """The settings by which records have the places that they have."""
    return settings.seed, settings.placement, settings.warmup
