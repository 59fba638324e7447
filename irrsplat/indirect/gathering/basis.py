"""The inputs by which a cache's records are gathered: scene, settings, and pending changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypedDict

from irrsplat.lighting.light_table import light_defines
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings


class BounceStatistics(TypedDict):
    """How records are gathered, and with how many bounces.

    bounces_converged: whether further ones would add hardly anything; None where not all are wanted.
    """

    gathered_by: str
    bounces: int
    bounces_converged: bool | None


@dataclass(frozen=True)
class Basis:
    """Scene and settings by which the records of the cache are gathered, and their changes that are still to be followed.

    kind: how a record sees the world, "trace", "embree" or "plane". moved: whether something has changed, and which
    records that concerns is still to be found out. relit: whether lights or materials have, and the surface cache is not made by
    these yet.
    swapped: True while records that were gathered by coarse values of the surface cache are compared with its own.
    resumed: the statistics of records from a file, as long as their surface cache is not made.
    """

    scene: Scene
    settings: Settings
    kind: str
    moved: bool = False
    relit: bool = False
    swapped: bool = False
    resumed: BounceStatistics | None = None

    @cached_property
    def lights(self) -> dict[str, int]:
        """The kinds of lights that gathers are compiled for."""
        return light_defines(self.scene)

    @property
    def way(self) -> tuple[object, ...]:
        """The inputs that decide a record's values and their noise."""
        settings = self.settings
        rays = settings.gather_size, settings.ray_noise, settings.light_samples
        return self.kind, *rays, self.wants_surface

    @property
    def wants_surface(self) -> bool:
        """True if a surface cache lights the records: for more than one bounce."""
        return self.settings.most_bounces > 1
