"""The difference that a change of few lights among many makes. Light is linear, so that only the changed lights are
gathered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.core.buffers import HitLight
from irrsplat.core.timing.background import Steps
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import table_texture
from irrsplat.gpu.texel_table import table_rows
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.world import PartlyLitWorld, World
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Light
from irrsplat.settings import Settings
from irrsplat.surface_cache.site_layout import FIRST_SITE, Detail
from irrsplat.surface_cache.site_rays import SiteRays
from irrsplat.surface_cache.surface_sites import SurfaceSites
from irrsplat.surface_cache.transport import BouncedLight, sum_bounces

_FEW = 8  # the rays are traced once for added and once for removed lights: it pays up to one of so many lights


class LightPart(Owner):
    """The light of some `lights` of a world. sign: 1 if a change adds the lights, -1 if it removes them.

    The parts of a change add up to the difference between two states of the world with different lights.
    """

    def __init__(self, world: World, settings: Settings, lights: tuple[Light, ...], sign: float) -> None:
        self.world, self.settings, self.sign = self.own(PartlyLitWorld(world, lights)), settings, sign
        shadows = self.own(ShadowPass(world.ctx))(self.world, settings.shadow_size)
        self.light = HitLight(shadows)  # at hits of records' rays
        self._rays: SiteRays | None = None
        self._sites: RecordCache | None = None  # E_1 of the first `_done` sites
        self._done = FIRST_SITE
        self._bouncing: Steps[BouncedLight] | None = None
        self._bounced: BouncedLight | None = None

    @property
    def at_sites(self) -> np.ndarray:
        """(2, S, 3) the change of E_1 and of the irradiance of all bounces at the sites, W/m²."""
        assert self._sites is not None and self._bounced is not None
        return self.sign * np.stack([self._sites.read()["irradiance"], self._bounced.irradiance])

    def bounce(self, sites: SurfaceSites, detail: Detail, budget: Budget) -> bool:
        """Continue the light between the sites within the budget. Return True once it is complete."""
        ctx, settings, count = self.world.ctx, self.settings, sites.records.count
        if self._rays is None or self._sites is None:
            self._rays, self._sites = self.own(SiteRays(self.world, settings, detail)), self.own(RecordCache(ctx))
            self._sites.append(sites.records.sites(slice(0, count)))
        gather, left = self._rays.gather_for(count), np.arange(self._done, count)
        for batch in self._rays.gathered(gather, sites, left, self.light.shadows, budget, self._sites):
            self._done += len(batch)
        if self._done == count and self._bounced is None:
            E_1 = self._sites.read()["irradiance"]
            self._bouncing = self._bouncing or sum_bounces(E_1, sites.transport, sites.area, settings)
            self._bounced = made = budget.advance(self._bouncing)
            if made is not None:
                values = self.own(table_texture(ctx, table_rows(sites.texels(made.irradiance)[:, None])))
                self.light = replace(self.light, surface=sites.uniforms(self.world) | {"surface_values": values})
        return self._bounced is not None


def changed_lights(change: SceneChange) -> tuple[list[Light], list[Light]] | None:
    """Return the light that a `change` adds and the light that it removes; None for more than few lights, or other changes."""
    old, new = change.old.lights, change.new.lights
    if change.moved or change.repainted or change.other_sky or change.dimming is not None:
        return None
    added, removed = list(new[len(old) :]), list(old[len(new) :])
    for a, b in zip(old, new, strict=False):
        if replace(a, color=b.color, name=b.name) == b:  # one part is enough for a light that fades or grows
            more = np.subtract(b.color, a.color)
            for lights, part in ((added, more), (removed, -more)):
                lights += [replace(a, color=tuple(np.maximum(part, 0.0)))] if (part > 0.0).any() else []
        else:
            added, removed = [*added, b], [*removed, a]
    return (added, removed) if 0 < _FEW * (len(added) + len(removed)) <= len(new) else None
