"""The surface cache while lights and meshes move: its values are updated from frame to frame until they are gathered again.

One-bounce irradiance at the sites is about E_1 = c + F·D. D is the present direct irradiance by the lights.
The residual c of a gather holds light of the sky and of emitters, and detail that F·D is too coarse for.
All bounces are E = E_1 + F·E; a frame does one step from the E of the frame before. The detail in c belongs to former
positions of the lights: c fades as they move, faster where the light before and after overlaps less.
"""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import ShadowMaps
from irrsplat.gpu.resource import Workshop
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.site_light import SiteLightPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange, emits
from irrsplat.surface_cache.transport import Transport

_OTHER_HITS = 0.05  # of a site's hemisphere: where moved meshes covered or cover that much, its rays meet other sites


class Follower:
    """Follows the light at the sites `records`, between which `transport` is known, from `begin` on.

    area: (S,) m² of the surface that each stands for. E_1, E: (S, 3) W/m², as gathered with the present lights, and of all
    bounces. made: keeps its pass. Records, transport and workshop belong to others.
    """

    def __init__(
        self,
        world: World,
        records: RecordCache,
        area: np.ndarray,
        transport: Transport,
        made: Workshop,
        E_1: np.ndarray,
        E: np.ndarray,
    ) -> None:
        self.world, self.records, self.transport, self.irradiance = world, records, transport, E
        self._made, self._area = made, area
        self.change = 0.0  # of E by the last step, relative to it
        self._direct: np.ndarray | None = None  # D of the last step; None before `begin`
        self._beyond = E_1  # c once `begin` has taken F·D away
        self._relit = False  # True if lights have changed since

    def begin(self, shadows: ShadowMaps) -> None:
        """Measure the direct light before the first change of the scene."""
        if self._direct is None:
            self._direct = self.light(shadows)
            self._beyond = self._beyond - self.transport(self._direct)

    @property
    def begun(self) -> bool:
        """True if the direct light before the first change is known."""
        return self._direct is not None

    def light(self, shadows: ShadowMaps) -> np.ndarray:
        """Return (S, 3) D, W/m²."""
        lights = light_defines(self.world.scene)
        count = self.records.count
        light_pass = self._made.get("site light", (lights, count), lambda: SiteLightPass(self.world.ctx, lights, max(count, 1)))
        E, _ = light_pass(shadows, self.records.sites(slice(0, count)), self._area)
        return E

    def relight(self) -> None:
        """Mark the lights as changed."""
        self._relit = True

    def dim(self, factor: np.ndarray) -> None:
        """Scale direct and indirect light by `factor`, (3,)."""
        self.irradiance, self._beyond = self.irradiance * factor, self._beyond * factor
        if self._direct is not None:
            self._direct = self._direct * factor

    def move(self, change: SceneChange) -> None:
        """Move the sites on moved meshes along. The hits of rays from near sites become unknown."""
        self.records.move_with_meshes(change)
        self.transport.known[self.records.column("due") > _OTHER_HITS] = False

    @property
    def order(self) -> np.ndarray:
        """The sites around which something has moved since they were gathered, in the order in which they are to be gathered
        again: those around which most has changed come first."""
        due = self.records.column("due")
        order = np.argsort(-due, kind="stable")
        return order[: np.count_nonzero(due > 0.0)]

    def step(self, shadows: ShadowMaps, gathered: np.ndarray) -> np.ndarray:
        """Return (S, 3) the present irradiance E, W/m². gathered: the sites that were gathered with the present lights."""
        assert self._direct is not None
        D = self.light(shadows)
        if self._relit:
            self._beyond *= np.where(emits(self.world.scene), 1.0, overlap(self._direct, D, self._area)).astype(np.float32)
        self._direct, self._relit = D, False
        if len(gathered):
            self._beyond[gathered] = self.records.values[gathered, :3] - self.transport(D, gathered)
        before, self.irradiance = self.irradiance, np.maximum(self._beyond + self.transport(D + self.irradiance), 0.0)
        self.change = float(np.abs(self.irradiance - before).mean() / max(float(before.mean()), 1e-20))
        return self.irradiance


def overlap(before: np.ndarray, after: np.ndarray, area: np.ndarray) -> float:
    """Return the share of the residual c that stays valid, 0..1, by the direct light at sites (S, 3) before and after.

    1: unchanged light. 0: less than half of the light is common to both, as measured with a light that moves through a box.
    """
    both, either = (float(area @ light(before, after).sum(1)) for light in (np.minimum, np.maximum))
    return max(2.0 * both / either - 1.0, 0.0) if either > 0.0 else 1.0
