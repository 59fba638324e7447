"""The gather as everybody else sees it: from places in a world to what they see, and on to values of records.

The paper's plane (plane.py) and rays (trace.py) are its kinds; `gather_records` is the one loop that makes records by either.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import nullcontext

import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, Sites
from irrsplat.gather.record_frame import offset_of
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.lighting.sky import sky_maps, sky_uniforms
from irrsplat.records.record_cache import RecordCache

_BESIDE = 0.014  # of the height of the image: how far beside a record others look at its light samples
_SCREEN = 0.25  # of the scene's diagonal: the image's height where it is not known


class Gather(Owner):
    """A gather bound to its `world`, which it follows when that moves; made for the world's lights (see light_defines).

    kind: "plane", "trace" or "embree". capacity: records that one call takes at most. cell: texels, width and height,
    of what a record sees. share: (height, width) cosθ·dω of each of them. places: from how many a record looks, in turn
    (shaders/gather/places.glsl); an atlas's `frames` then has so many columns for each record.
    """

    kind: str
    capacity: int
    cell: tuple[int, int]
    share: np.ndarray

    def __init__(self, world: World, places: int = 1) -> None:
        self.world, self.places = world, places

    @property
    def offset(self) -> float:
        """How far above its surface a record looks from, metres."""
        return offset_of(self.world.scene)

    def steps(self, sites: Sites) -> np.ndarray:
        """(N,) metres: how far beside each site other eyes look at its light samples: about as far as a record serves pixels, so
        that they tell how light changes over that."""
        screen = np.zeros(len(sites)) if sites.screen is None else sites.screen
        known = np.where(screen > 0.0, screen, _SCREEN * self.world.scene.diagonal)
        return np.maximum(_BESIDE * known, self.offset)

    @property
    def radii(self) -> tuple[float, float]:
        """The least and the greatest R_k, metres: nothing counts as nearer than the offset, a miss as a scene's diagonal away."""
        return self.offset, self.world.scene.diagonal

    @abstractmethod
    def __call__(self, light: HitLight, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        """What records at `sites`, at most `capacity`, see by this light; `numbers` (N,) are theirs in the cache. The atlas
        holds until the next call."""


def gather_records(
    gather: Gather,
    reduce: ReducePass,
    light: HitLight,
    cache: RecordCache,
    numbers: np.ndarray,
    seed: int,
    timers: Timers | None = None,
    where: Callable[[np.ndarray], Sites] | None = None,
) -> Atlas | None:
    """Gather the records of these `numbers` (N,) where the cache has them, and write what they hold into it.

    As many at once as the gather takes. timers: count the stages "gather" and "reduce". where: from where those of these numbers
    look, one record's after the other's; None: from where the cache has them. Returns what the last batch saw, None for no
    records.
    """
    atlas, sky = None, sky_uniforms(gather.world.scene, sky_maps(gather.world))
    where = where or cache.sites
    for first in range(0, len(numbers), gather.capacity):
        batch = numbers[first : first + gather.capacity]
        with timers("gather") if timers else nullcontext():
            atlas = gather(light, where(batch), np.repeat(batch, gather.places), seed)
        with timers("reduce") if timers else nullcontext():
            reduce(atlas, cache.records, sky, gather.radii)
    return atlas
