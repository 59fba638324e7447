"""The surface cache while lamps and meshes move: its values follow from tick to tick by what is known, until they are made again.

Light of one bounce at the sites is about E_1 = c + F·D, where D is the lamps' direct light there, of this moment, and c what
gathering a site once found beyond that: light of the sky and of emitters, and all that F·D is too coarse for. All bounces
are E = E_1 + F·E, of which a tick does one step from the E of the tick before. The latter part of c is of where the lamps were:
it fades as they move, the faster the less their light now overlaps with that before.
"""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import ShadowMaps
from irrsplat.gpu.resource import Workshop
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.site_light import SiteLightPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange, shines
from irrsplat.surface_cache.transport import Transport

_OTHER_HITS = 0.05  # of a site's hemisphere: where moved meshes covered or cover that much, its rays meet other sites


class Follower:
    """Follows the light at the sites `records`, between which `transport` is known. It borrows all of these.

    area: (S,) m² of the surface that each stands for. E_1: (S, 3) W/m², as it was gathered by the lamps
    of now; E: (S, 3) of all bounces. made: keeps its pass. most: sites at most.
    """

    def __init__(
        self,
        world: World,
        records: RecordCache,
        area: np.ndarray,
        transport: Transport,
        made: Workshop,
        most: int,
        E_1: np.ndarray,
        E: np.ndarray,
    ) -> None:
        self.world, self.records, self.transport, self.irradiance = world, records, transport, E
        self._made, self._most, self._area = made, most, area
        self._E_1 = E_1
        self.change = 0.0  # of E by the last step, relative to it
        self._beyond: np.ndarray | None = None  # c, once D is known
        self._lamps: np.ndarray | None = None  # D of the last step
        self._relit = False  # whether lamps have changed since

    def light(self, shadows: ShadowMaps) -> np.ndarray:
        """(S, 3) D, W/m²."""
        lights = light_defines(self.world.scene)
        lamps = self._made.get("site light", lights, lambda: SiteLightPass(self.world.ctx, lights, self._most))
        E, _ = lamps(shadows, self.records.sites(slice(0, self.records.count)), self._area)
        return E

    def begin(self, shadows: ShadowMaps) -> None:
        """Take the lamps of now for those of E_1."""
        if self._beyond is None:
            self._lamps = self.light(shadows)
            self._beyond = self._E_1 - self.transport(self._lamps)

    def relight(self) -> None:
        """Lamps have changed."""
        self._relit = True

    def dim(self, factor: np.ndarray) -> None:
        """Take all light, the lamps' and what comes of it, for `factor` times as strong, (3,)."""
        self._E_1, self.irradiance = self._E_1 * factor, self.irradiance * factor
        if self._beyond is not None and self._lamps is not None:
            self._beyond, self._lamps = self._beyond * factor, self._lamps * factor

    def move(self, change: SceneChange) -> None:
        """Let the sites on moved meshes move along; which those near them see has to be found out again."""
        self.records.move_with_meshes(change)
        self.transport.known[self.records.due > _OTHER_HITS] = False

    @property
    def order(self) -> np.ndarray:
        """The sites around which something has moved since they were gathered, in the order in which they are to be gathered
        again: those around which most has changed come first."""
        due = self.records.due
        order = np.argsort(-due, kind="stable")
        return order[: np.count_nonzero(due > 0.0)]

    def step(self, shadows: ShadowMaps, gathered: np.ndarray) -> np.ndarray:
        """(S, 3) the irradiance E of this moment, W/m²; `gathered`: the sites that were gathered by the lamps of now."""
        assert self._beyond is not None
        D = self.light(shadows)
        if self._relit and self._lamps is not None:
            self._beyond *= np.where(shines(self.world.scene), 1.0, overlap(self._lamps, D, self._area)).astype(np.float32)
        self._lamps, self._relit = D, False
        if len(gathered):
            self._beyond[gathered] = self.records.values[gathered, :3] - self.transport(D, gathered)
        before, self.irradiance = self.irradiance, np.maximum(self._beyond + self.transport(D + self.irradiance), 0.0)
        self.change = float(np.abs(self.irradiance - before).mean() / max(float(before.mean()), 1e-20))
        return self.irradiance


def overlap(before: np.ndarray, after: np.ndarray, area: np.ndarray) -> float:
    """How much of what is known of lamps in detail still holds, 0..1, by their light at sites (S, 3) before and after.

    1 where all is as it was; 0 where less than half of all that is lit by either is lit alike by both, as measured with a lamp
    that moves through a box.
    """
    both, either = (float(area @ light(before, after).sum(1)) for light in (np.minimum, np.maximum))
    return max(2.0 * both / either - 1.0, 0.0) if either > 0.0 else 1.0
