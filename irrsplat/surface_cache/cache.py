"""The surface cache (docs/METHOD.md, 11): irradiance at sites on all surfaces. The hits of records' rays reflect its light.

It stores E_(N−1) for records of E_N, and all views share it. It is a sequence of levels (site_level.py), each a complete
solution. Ticks begin with a coarse level, which takes a fraction of the time, and use its values until the full level is
complete. Progressive refinement adds finer levels.
"""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps, Sites, Uniforms
from irrsplat.core.memo import Memo
from irrsplat.core.vectors import octahedral_encode
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target, table_texture
from irrsplat.gpu.texel_table import table_rows
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.scene.change import SceneChange
from irrsplat.settings import Settings
from irrsplat.surface_cache.site_layout import COARSE, MAX_LEVEL, Detail
from irrsplat.surface_cache.site_level import SiteLevel
from irrsplat.surface_cache.surface_sites import no_sites
from irrsplat.surface_cache.transport import BouncedLight

_LIGHT = "seed", "bounces", "light_samples", "shadow_size"  # settings on which values depend


class SurfaceCache(Owner):
    """The surface cache of a world's scene. detail: the density of sites and rays of its full level.

    level: the full level. relit: True while its values are of other lights or materials. in_use: the level of the values that
    lookups read. In ticks, a coarse level provides the values until the full level is complete. Finer levels replace it.
    """

    def __init__(self, world: World, settings: Settings, timers: Timers, detail: Detail) -> None:
        self.world, self.timers = world, timers
        self.level = SiteLevel(world, settings, detail)
        self._coarse: SiteLevel | None = None  # made by the first tick
        self.in_use = self.level
        self._next: SiteLevel | None = None  # the unfinished finer level
        self.relit = False
        self._eye, self._suits = b"", Memo()  # the eye of the last view
        self._no_sites, self._view_pass, self._viewed = no_sites(world.ctx), SurfaceViewPass(world.ctx), Memo()

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        levels = dict.fromkeys((self.level, self._coarse, self.in_use, self._next))
        return (self._no_sites, self._view_pass, *levels)

    # ---- its values ------------------------------------------------------------------------------------------------

    @property
    def result(self) -> BouncedLight | None:
        """The values that lookups read; None before the first values exist."""
        return self.in_use.light

    @property
    def refinements(self) -> int:
        """The number of levels by which the values in use are finer."""
        return max(self.in_use.detail.level, 0)

    @property
    def may_refine(self) -> bool:
        """True if a finer level is possible."""
        return self.refinements < MAX_LEVEL

    @property
    def is_coarse(self) -> bool:
        """True while lookups find coarse values."""
        return self.in_use is self._coarse

    @property
    def current(self) -> bool:
        """True if lookups find values of about the present light. Moved meshes change little of the light."""
        return self.in_use.complete or (self.level.still == 0 and self.in_use.follower is not None) or not self._outdated

    @property
    def _outdated(self) -> bool:
        """True if the values of the full level are of another light, or missing."""
        return self.level.light is None or (self.relit and not (self.in_use is self.level and self.level.is_close))

    def uniforms(self) -> Uniforms:
        """Return the uniforms of shaders/surface_cache/lookup.glsl for the sites in use."""
        return (self.in_use.shown or self._no_sites).uniforms(self.world)

    def view(self, gbuffer: GBuffer) -> moderngl.Texture:
        """Return the cache's values at every pixel, see SurfaceViewPass; valid until the next call."""
        return self._viewed.get("view", (gbuffer, self.result), lambda: self._view_pass(gbuffer, self.uniforms()))

    def at(self, sites: Sites) -> np.ndarray:
        """Return (N, 3) the cache's irradiance at `sites`, whose triangles are known, W/m²."""
        return self._view_pass.at(sites, self.uniforms())

    # ---- changes ---------------------------------------------------------------------------------------------------

    def change(self, settings: Settings, change: SceneChange) -> None:
        """Use other settings, and the world's scene after a `change`. The former values stay until `advance` makes new ones."""
        level, coarse = self.level, self._coarse
        if change or any(getattr(level.settings, name) != getattr(settings, name) for name in _LIGHT):
            self._drop_finer()
        outdated = self._outdated
        self.relit |= change.changes_light and change.dimming is None
        level.change(settings, change)
        if coarse is not None and change.moved and level.follower is not None:  # the values of the full level follow
            self._coarse, self.in_use = None, level
            coarse.release()
        elif coarse is not None:  # coarse values would never be complete while light changes in every tick
            coarse.change(settings, change, finish=outdated)

    def expire(self) -> None:
        """Gather all again."""
        self._drop_finer()
        for level in filter(None, (self.level, self._coarse)):
            level.expire()

    def _drop_finer(self) -> None:
        """Return to the values from before all refinements."""
        finer = [level for level in (self.in_use, self._next) if level is not None and level.detail.level > 0]
        self._next = None
        if self.in_use in finer:
            self.in_use = self.level
        for level in finer:
            level.release()

    # ---- making ----------------------------------------------------------------------------------------------------

    def advance(self, shadows: ShadowMaps, budget: Budget) -> float | None:
        """Make values, coarse ones first, until the budget ends.

        Return the relative change of the values that lookups find, 1 for new ones; None if they are as before.
        """
        self._follow_view(budget)
        if self.level.complete:
            return None
        with self.timers("surface"):
            level = self.level
            made, changed = level, level.follow(shadows, budget)
            if changed is None and budget.limited and self._outdated:
                self._coarse = self._coarse or SiteLevel(self.world, level.settings, COARSE)
                made = level if self._coarse.complete else self._coarse
            if made is self.in_use is self._coarse:
                changed = made.follow(shadows, budget)
            if changed is None and made.make(shadows, budget):
                self.relit, changed = self.relit and made is self._coarse, 1.0
        if changed is not None:
            self.in_use = made
        return changed

    def _follow_view(self, budget: Budget) -> None:
        """Choose the sites of a complete full level again if the view needs others. In ticks, this waits for a still camera."""
        eye = self.world.eyes.tobytes()
        moving, self._eye = budget.limited and eye != self._eye, eye
        if not (self.level.complete and not moving):
            return
        if not self._suits.get("view", (eye, self.level.shown), self.level.suits_view):
            self._drop_finer()
            self.level.choose_again()

    def refine(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Continue the next finer level within the budget. Return True if lookups use its values now.

        They hold until the light of the scene changes.
        """
        if self.level.light is None or not self.level.complete:
            return False
        finer = self.level.detail.refined(self.refinements + 1)
        self._next = self._next or SiteLevel(self.world, self.level.settings, finer)
        with self.timers("surface"):
            if not self._next.make(shadows, budget):
                return False
        former, self.in_use, self._next = self.in_use, self._next, None
        if former is not self.level:
            former.release()
        return True


class SurfaceViewPass(Owner):
    """Pass that interpolates the surface cache at pixels."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.program = self.own(Program(ctx, "surface_cache/view", "lib/fullscreen"))
        self.targets = self.own(Workshop())

    def __call__(self, gbuffer: GBuffer, surface: Uniforms, target: str = "view") -> moderngl.Texture:
        """Return the RGBA32F texture of indirect irradiance in W/m²; a: 1 on a surface, else 0. It belongs to this pass.

        surface: the cache's uniforms for triangles numbered as in the scene. target: each of these keeps its last result.
        """
        g, size = gbuffer, gbuffer.position.size
        drawn = self.targets.get(target, size, lambda: Target(self.ctx, size, (4,)))
        self.program(drawn, position=g.position, normal=g.normal, albedo=g.albedo, emission=g.emission, **surface)
        return drawn.textures[0]

    def at(self, sites: Sites, surface: Uniforms) -> np.ndarray:
        """Return (N, 3) indirect irradiance at `sites`, W/m²; the sites must have triangles."""
        assert sites.triangle is not None
        x, y = octahedral_encode(sites.geometric)
        parts = (sites.position, np.ones(len(sites))), (sites.normal, x), (np.zeros((len(sites), 3)), y)
        columns = [*parts, (np.zeros((len(sites), 3)), sites.triangle)]
        textures = [table_texture(self.ctx, table_rows(np.column_stack(one)[:, None].astype("f4"))) for one in columns]
        drawn = self(GBuffer(textures[0], textures[1], textures[2], textures[3]), surface, "points")
        found = np.frombuffer(drawn.read(), "f4").reshape(-1, 4)[: len(sites), :3]
        for texture in textures:
            texture.release()
        return found
