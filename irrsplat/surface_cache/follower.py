"""The surface cache while lamps and meshes move: its values follow from tick to tick by what is known, until they are made again.

Light of one bounce at the sites is about E_1 = c + F·D, where D is the lamps' direct light there, of this moment, and c what
gathering a site once found beyond that. All bounces are E = E_1 + F·E, of which a tick does one step from the E of the tick
before.

Where all light is the lamps', c is what F·D was too coarse for: a ray that met a spot close to a lamp. It belongs to these as
they were, and fades as fast as their light changes. Else light of the sky and of emitters is in it, too, and it stays.
"""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import ShadowMaps
from irrsplat.gpu.resource import Workshop
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.site_light import SiteLightPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Scene
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

    def light(self, shadows: ShadowMaps) -> np.ndarray:
        """(S, 3) D, W/m²."""
        lights = light_defines(self.world.scene)
        lamps = self._made.get("site light", lights, lambda: SiteLightPass(self.world.ctx, lights, self._most))
        return lamps(shadows, self.records.sites(slice(0, self.records.count)), self._area)

    def begin(self, shadows: ShadowMaps) -> None:
        """Take the lamps of now for those of E_1."""
        if self._beyond is None:
            self._lamps = self.light(shadows)
            self._beyond = self._E_1 - self.transport(self._lamps)

    @property
    def _lamps_alone(self) -> bool:
        """Whether there is no other light."""
        scene = self.world.scene
        sky = any(scene.sky) or any(scene.sky_gradient) or scene.environment is not None
        return not sky and not any(any(material.emission) for material in scene.materials)

    def move(self, before: Scene, after: Scene) -> None:
        """Let the sites on moved meshes move along; which those near them see has to be found out again."""
        self.records.move_with_meshes(before, after)
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
        assert self._beyond is not None and self._lamps is not None
        last, D = self._lamps, self.light(shadows)
        if self._lamps_alone:
            self._beyond *= 1.0 - _share(np.abs(D - last), np.maximum(D, last), self._area)
        self._lamps = D
        if len(gathered):
            self._beyond[gathered] = self.records.values[gathered, :3] - self.transport(D, gathered)
        before, self.irradiance = self.irradiance, np.maximum(self._beyond + self.transport(D + self.irradiance), 0.0)
        self.change = float(np.abs(self.irradiance - before).mean() / max(float(before.mean()), 1e-20))
        return self.irradiance


def _share(part: np.ndarray, whole: np.ndarray, area: np.ndarray) -> float:
    """How much of `whole` (S, 3) `part` (S, 3) is on all of the `area` (S,), 0..1; 0 where all is dark."""
    total = float((area @ whole).sum())
    return float((area @ part).sum()) / total if total > 0.0 else 0.0
