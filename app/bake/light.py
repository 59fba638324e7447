"""The light at points on surfaces by irradiance records, without any view: gathered where none serves a point, splatted there.

It is the renderer's own method, by its own stages; only how splats find what they reach is another one (splats.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Unpack

import moderngl
import numpy as np

from irrsplat.app.bake.places import Places
from irrsplat.app.bake.splats import PlaceSplats, Reach
from irrsplat.core.buffers import GBuffer
from irrsplat.core.vectors import check_finite, octahedral_encode
from irrsplat.gather.kinds import shadow_caster
from irrsplat.gpu.resource import Owner, Resource, Tenant
from irrsplat.gpu.target import float_texture
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.indirect.view_state import ViewState
from irrsplat.lighting.direct import DirectPass
from irrsplat.lighting.light_table import light_defines
from irrsplat.meter.lit_scene import LitScene
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import SettingValues, preset

OnBake = Callable[[float, str], None]  # called with the share that is done, 0..1, and words
_NOBODY = Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))  # rounds take a camera, which matters to windows alone


@dataclass(frozen=True, eq=False)
class Gathered:
    """What records say at places, (H, W, 3) W/m², where `served` (H, W) bool; how many records there are by then, and whether no
    place asked for more."""

    irradiance: np.ndarray
    served: np.ndarray
    records: int
    converged: bool


class PlaceLight(Tenant):
    """Light at any points on a scene's surfaces. The records stay, so that further points cost only what is new.

    scene: recentred and local. preset, settings: of the stages shadow, gather, splat and examine.
    Raises InputError for settings that cannot be, GLError where there is no OpenGL 3.3.
    """

    def __init__(
        self, scene: Scene, preset_name: str, ctx: moderngl.Context | None = None, **settings: Unpack[SettingValues]
    ) -> None:
        self.scene = scene
        self.settings = replace(preset(preset_name, **settings), placement="tiles", coarse=False)
        with self._moving_in(ctx) as made:
            self.lit = made.enter_context(LitScene(self.ctx, self.about, scene, self.settings))
            self.world, self.cache = self.lit.world, self.lit.cache
            self.scheduler = made.enter_context(RecordScheduler(self.world, self.settings, self.cache, self.lit.timers))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees; the context is apart."""
        return (self.scheduler, self.lit)

    def gathered(self, where: Places, texel: float, on_bake: OnBake | None = None) -> Gathered:
        """The light that records hold at these places, of all bounces, and of emitters and the sky; more are gathered until all
        places are served. texel: metres from a place to the next."""
        self._use()
        empty = np.zeros((*where.seen.shape, 3), np.float32)
        if not self.settings.most_bounces or not where.seen.any():
            return Gathered(empty, where.seen.copy(), self.cache.count, True)
        scheduler, settings, budget = self.scheduler, self.settings, Budget(None)
        scheduler.prepare(self.lit.shadows, budget)
        with (
            _Drawn(self.ctx, where, settings.gradients) as drawn,
            PlaceSplats(self.ctx, drawn.gbuffer, where.position, where.seen, settings, self._reach(texel)) as splats,
        ):
            view, before = ViewState(_NOBODY), self.cache.count
            for _ in range(settings.max_rounds):
                view, _ = scheduler.limit_radii(view)
                sums = splats.update(self.cache)
                if view.stalled or view.settled == (sums, settings.asking):
                    break
                screen = scheduler.screen(drawn.gbuffer, sums, _NOBODY)
                view, _ = scheduler.gather_missing(view, screen, self.lit.shadows, _NOBODY, budget)
                if on_bake is not None:
                    on_bake(view.coverage, f"{self.cache.count - before} records")
            splats.update(self.cache)
            totals, _ = splats.read()
        served = where.seen & (totals[..., 3] > 0.0)
        irradiance = np.where(served[..., None], totals[..., :3] / np.maximum(totals[..., 3:], 1e-30), 0.0).astype(np.float32)
        check_finite("the baked irradiance", irradiance, lambda at: f"the point {where.position[at[:2]].tolist()}")
        return Gathered(irradiance, served, self.cache.count, view.settled is not None)

    def _reach(self, texel: float) -> Reach:
        """The bounds that a view sets elsewhere: the image height there is the side of a cube with the scene's diagonal here."""
        side = self.scene.diagonal / np.sqrt(3.0) / 100.0
        greatest = self.settings.radius_max * side or self.scene.diagonal
        least = max(self.settings.radius_min * side, texel)
        return Reach(min(least, greatest), greatest, texel)

    def direct(self, where: Places, number: int = 0) -> np.ndarray:
        """Return (H, W, 3) W/m², the irradiance of lights with their shadows. number: of the subtexel sample."""
        self._use()
        with _Drawn(self.ctx, where, True) as drawn:
            found = np.zeros((*where.seen.shape, 3), np.float32)
            if self.scene.lights:
                kinds, turned = {**light_defines(self.scene), **self.world.material_defines}, 2.399963 * number
                with DirectPass(self.ctx, where.size, kinds, irradiance=True) as lamps:
                    found += _colours(
                        lamps(drawn.gbuffer, self.lit.shadows, rotation=turned, world=shadow_caster(self.world, self.settings))
                    )
        return np.where(where.seen[..., None], found, 0.0).astype(np.float32)


def _colours(texture: moderngl.Texture) -> np.ndarray:
    """(H, W, 3) of an RGBA32F texture, in the order of its rows."""
    return np.frombuffer(texture.read(), "f4").reshape(texture.height, texture.width, -1)[..., :3]


class _Drawn(Owner):
    """Places as a g-buffer. bends: whether mapped normals are in it, where there are any."""

    def __init__(self, ctx: moderngl.Context, where: Places, bends: bool) -> None:
        octahedral = np.zeros((2, *where.seen.shape), np.float32)
        octahedral[:, where.seen] = octahedral_encode(where.geometric[where.seen].astype(float))

        def texture(values: np.ndarray, last: np.ndarray) -> moderngl.Texture:
            made = float_texture(ctx, where.size)
            made.write(np.ascontiguousarray(np.dstack([values, last]), "f4").tobytes())
            return made

        mapped = bends and bool((where.mapped != where.normal).any())
        self.textures = [
            texture(where.position, where.seen),
            texture(where.normal, octahedral[0]),
            texture(where.albedo, octahedral[1]),
            texture(where.emission, where.triangle),
            *([texture(where.mapped, np.zeros_like(octahedral[0]))] if mapped else []),
        ]
        position, normal, albedo, emission = self.textures[:4]
        self.gbuffer = GBuffer(position, normal, albedo, emission, self.textures[4] if mapped else None)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return tuple(self.textures)
