"""Inputs of records, and the passes that gather by them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from irrsplat.core.buffers import HitLight, Sites
from irrsplat.gather import kinds
from irrsplat.gather.hemisphere import Gather, gather_records
from irrsplat.gather.record_frame import FEW_RAYS
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Scene
from irrsplat.settings import SETTINGS, Settings


@dataclass(frozen=True)
class Basis:
    """Scene and settings of the cache's records, and changes that the records do not follow yet.

    kind: of the gather, "trace", "embree" or "plane". moved: True if something has changed, and the affected records are not
    selected yet. relit: True if lights or materials have changed since the surface cache was of the present light. from_file: the
    statistics `bounces` of records from a file, until their surface cache is made.
    """

    scene: Scene
    settings: Settings
    kind: str
    moved: bool = False
    relit: bool = False
    from_file: Mapping[str, object] | None = None

    @cached_property
    def lights(self) -> dict[str, int]:
        """The kinds of lights that gathers are compiled for."""
        return light_defines(self.scene)

    @property
    def way(self) -> tuple[object, ...]:
        """The settings that determine a record's directions and their noise."""
        settings = self.settings
        return self.kind, settings.gather_size, settings.light_samples

    @property
    def uses_surface_cache(self) -> bool:
        """True if records use a surface cache: for more than one bounce."""
        return self.settings.most_bounces > 1


class Gathers(Owner):
    """The gather passes of a scene, made at their first use, and again if their inputs change."""

    def __init__(self, world: World) -> None:
        self.ctx, self.world = world.ctx, world
        self._made = self.own(Workshop())

    def gather(self, basis: Basis, side: int = 0) -> Gather:
        """Return the pass that gathers records along side² rays; 0: the settings' side.

        The paper's algorithm gathers one record at a time, without next-event samples. For other sides, the number of samples
        grows in proportion to the rays, and is never less than the settings'.
        """
        settings, present = basis.settings, basis.settings.gather_size
        if side in (0, present):
            samples, capacity = (0, 1) if settings.placement == "scan" else (settings.light_samples, None)
            return self._made_for("gather", basis, present, samples, capacity)
        samples = settings.light_samples * max(side, present) ** 2 // present**2
        few = FEW_RAYS // side**2 if side < present else None
        return self._made_for(f"gather of {side}", basis, side, min(samples, int(SETTINGS["light_samples"].high or 0)), few)

    def probe(self, basis: Basis, side: int) -> Gather:
        """Return the pass that gathers records roughly, along side² rays and at most `side` next-event samples."""
        samples = min(basis.settings.light_samples, side)
        rays = FEW_RAYS if side > 4 else 4 * FEW_RAYS  # the least records take less time each in large batches
        return self._made_for(f"probe of {side}", basis, side, samples, rays // side**2)

    def _made_for(self, name: str, basis: Basis, side: int, samples: int, capacity: int | None) -> Gather:
        """Return a gather of this side, with so many next-event samples, for batches of at most `capacity` records."""
        settings = replace(basis.settings, gather=basis.kind, gather_size=side, light_samples=samples)
        emitters = samples > 0 and emitter_table(self.world) is not None
        inputs = *replace(basis, settings=settings).way, basis.uses_surface_cache, basis.lights, emitters, capacity
        return self._made.get(name, inputs, lambda: kinds.gather_pass(self.world, settings, capacity))

    def reduction(self, gradients: bool) -> ReducePass:
        """Return the pass that reduces hemisphere samples to records' values. gradients: M and ∇E as well."""
        return self._made.get(f"reduction {gradients}", (), lambda: ReducePass(self.ctx, gradients))

    def measure(self, gather: Gather, light: HitLight, sites: Sites, settings: Settings, gradients: bool) -> RecordCache:
        """Return records at `sites` outside the cache. The next call removes them."""
        records = self._made.get("records", (), lambda: RecordCache(self.ctx))
        records.truncate(0)
        numbers = records.append(sites) + np.arange(len(sites))
        gather_records(gather, self.reduction(gradients), light, records, numbers, settings.seed)
        return records
