"""The surface cache while lights and meshes move: its values are updated from frame to frame until they are gathered again.

One-bounce irradiance at the sites is about E_1 = c + F·D. D is the present direct irradiance by the lights.
The residual c of a gather holds light of the sky and of emitters, and detail that F·D is too coarse for.
All bounces are E = E_1 + F·E; a frame begins with the E of the frame before. The detail in c belongs to the positions of the
lights at the gather: the less D overlaps with that of the gather, the smaller the share of c that counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.core.buffers import ShadowMaps
from irrsplat.records.motion import moved_sites, of_meshes
from irrsplat.scene.change import SceneChange, emits
from irrsplat.scene.emitters import mean_emission
from irrsplat.surface_cache.clustering import voxel_keys
from irrsplat.surface_cache.site_rays import SiteRays
from irrsplat.surface_cache.surface_sites import SurfaceSites
from irrsplat.surface_cache.transport import CONVERGED, BouncedLight

_OTHER_HITS = 0.05  # of a site's hemisphere: where moved meshes covered or cover that much, its rays meet other sites
_HIDDEN = 0.5  # of a site's reflected light: a moved emitter that reflects so much of it hides the site from the room
_AROUND = 6.0  # widths of clusters: size of the cubes whose sites have common means
_FROM_BLACK = 4.0  # growth of reflected light, beyond which the residual is of light from other surfaces


class Follower:
    """Values at `sites` that follow moving light. The transport between the sites is known.

    E_1: (S, 3) irradiance gathered with the present lights, W/m². made: the light of all bounces by E_1. gathered: (S, 3) its
    irradiance. direct: (S, 3) the D of these lights. relit: True if lights have changed since the last step. is_rough: True if
    emission has changed since the gather.
    """

    def __init__(self, rays: SiteRays, sites: SurfaceSites, E_1: np.ndarray, made: BouncedLight, shadows: ShadowMaps) -> None:
        assert sites.transport is not None
        self._rays, self._sites, self._transport = rays, sites, sites.transport
        self.gathered, self.direct = made.irradiance, rays.direct_light(sites, shadows)
        self._beyond = E_1 - self._transport(self.direct)  # c
        self.relit = self.is_rough = False
        self._kept = np.ones((sites.records.count, 1))  # share of each site's c that is valid for the present light
        self._moved_emitters = np.zeros(sites.records.count, bool)  # True for sites on emissive meshes that have moved

    def dim(self, factor: np.ndarray) -> None:
        """Scale all light by `factor`, (3,)."""
        self._beyond, self.direct, self.gathered = self._beyond * factor, self.direct * factor, self.gathered * factor

    def move(self, change: SceneChange) -> None:
        """Move the sites on moved meshes, and their places, along. The hits of rays from near sites become unknown."""
        held = self._sites
        assert held.places is not None
        for mesh, _, own, _ in of_meshes(held.records.column("triangle"), change, change.moved):
            self._moved_emitters[own] = any(mesh.material.emission)
        held.records.move_with_meshes(change)
        held.places = moved_sites(held.places, change)
        self._transport.known[held.records.column("due") > _OTHER_HITS] = False

    def repaint(self, change: SceneChange) -> None:
        """Let the transport and the residual follow the materials of repainted meshes, about, until all is gathered again.

        A hit on a cell of a site counts as a hit on the site's mesh. Detail in the residual belongs to bright spots, which rays
        of single sites miss: it follows the reflectance at hits by the squares of D, in means over sites around.
        """
        pairs = [(change.old.meshes[i].material, change.new.meshes[i].material) for i in change.repainted]
        if any(replace(a, emission=b.emission, emission_texture=b.emission_texture) != b for a, b in pairs):
            self._transport.known[:] = False
        before, after, emitted = np.ones_like(self.direct), np.ones_like(self.direct), np.zeros_like(self.direct)
        for old, new, own, inside in of_meshes(self._sites.records.column("triangle"), change, change.repainted):
            before[own], after[own] = old.material.albedo, new.material.albedo
            emitted[own] = (mean_emission(new) - mean_emission(old))[inside[own]]
        if (before != after).any():
            reflected = self._means_around(self._transport(self.direct**2))
            self._transport.repaint(before, after)
            share = self._means_around(self._transport(self.direct**2)) / np.maximum(reflected, 1e-30)
            share[(share > _FROM_BLACK) | (reflected <= 0.0) | emits(change.old)] = 1.0
            self._beyond = (share * self._beyond).astype(np.float32)
        if emitted.any():  # few rays hit an emitter: light that fades does so by a mean ratio
            more, self.is_rough = self._transport.received(emitted), True
            around, of_all = (self._means_around(values) for values in (np.minimum(more, 0.0), self._beyond))
            left = np.clip(1.0 + around / np.maximum(of_all, 1e-30), 0.0, 1.0)
            self._beyond = (left * self._beyond + np.maximum(more, 0.0)).astype(np.float32)

    def _means_around(self, values: np.ndarray) -> np.ndarray:
        """Return (S, 3) the means of `values` (S, 3) over sites that are close together and face alike."""
        held = self._sites
        where = held.records.sites(slice(0, held.records.count))
        size = _AROUND * float(np.sqrt(np.median(held.area * 4.0**held.level)))
        _, group = np.unique(voxel_keys(where.position, where.normal, size, held.level), return_inverse=True)
        sums = [np.bincount(group, of_channel) for of_channel in (*values.T, np.ones(len(group)))]
        return np.stack([one / sums[3] for one in sums[:3]], axis=1)[group]

    def step(self, shadows: ShadowMaps, E: np.ndarray, gathered: np.ndarray) -> np.ndarray:
        """Return (S, 3) the present irradiance, W/m², from that of the frame before, E. gathered: the sites that were gathered
        with the present lights."""
        D = self._rays.direct_light(self._sites, shadows)
        if self.relit:
            self._kept[:], self.relit = overlap(self.direct, D, self._sites.area), False
        if len(gathered):
            self._beyond[gathered] = self._sites.records.values[gathered, :3] - self._transport(D, gathered)
            self._kept[gathered] = 1.0
        beyond = self._beyond * np.where(emits(self._rays.world.scene), 1.0, self._kept).astype(np.float32)
        hidden, stale = self._hidden, np.flatnonzero(self._sites.records.column("due"))
        least, change = CONVERGED * E.mean(), np.inf
        while change > least:
            before, light = E, D + E
            E = beyond + self._transport(light)
            if hidden is not None:  # only stale rows of F have rays from afar to hidden sites
                E[stale] = beyond[stale] + self._transport(np.where(hidden, 0.0, light), stale)
            E = np.maximum(E, 0.0)
            least, change = max(least, CONVERGED * E.mean()), np.abs(E - before).mean()
        return E

    @property
    def _hidden(self) -> np.ndarray | None:
        """(S, 1) True for sites whose rays mostly meet moved emitters; None without moved emitters."""
        if not self._moved_emitters.any():
            return None
        moved = np.repeat(self._moved_emitters[:, None], 3, axis=1)
        reflected, whole = (self._transport(sites).sum(1) for sites in (moved, np.ones_like(moved)))
        return np.asarray(reflected > _HIDDEN * whole)[:, None]


def overlap(before: np.ndarray, after: np.ndarray, area: np.ndarray) -> float:
    """Return the share of the residual c that stays valid, 0..1, by the direct light at sites (S, 3) before and after.

    1: unchanged light. 0: less than half of the light is common to both, as measured with a light that moves through a box.
    """
    both, either = (float(area @ light(before, after).sum(1)) for light in (np.minimum, np.maximum))
    return max(2.0 * both / either - 1.0, 0.0) if either > 0.0 else 1.0
