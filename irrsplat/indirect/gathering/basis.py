"""The inputs of a cache's records: scene, settings, and pending changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypedDict

from irrsplat.lighting.light_table import light_defines
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings


class BounceStatistics(TypedDict):
    """Statistics of the gather of records and of the number of bounces.

    bounces_converged: True if further bounces would add hardly any light; None unless all bounces are required.
    """

    gathered_by: str
    bounces: int
    bounces_converged: bool | None


@dataclass(frozen=True)
class Basis:
    """Scene and settings of the cache's records, and changes that the records do not follow yet.

    kind: of the gather, "trace", "embree" or "plane". moved: True if something has changed, and the affected records are not
    selected yet. relit: True if lights or materials have changed since the surface cache was made. from_file: the statistics of
    records from a file, until their surface cache is made.
    """

    scene: Scene
    settings: Settings
    kind: str
    moved: bool = False
    relit: bool = False
    from_file: BounceStatistics | None = None

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
