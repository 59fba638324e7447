"""Light at points on surfaces from irradiance records, without a view: records are gathered at under-covered points and
splatted.

The method is the renderer's, with its stages; only the search for points within a splat's reach differs (splats.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Unpack

import moderngl
import numpy as np

from irrsplat.app.bake.places import Places
from irrsplat.app.bake.splats import PlaceSplats
from irrsplat.core.buffers import GBuffer
from irrsplat.core.vectors import check_finite, octahedral_encode, vector
from irrsplat.gather.kinds import shadow_caster
from irrsplat.gpu.resource import Owner, Tenant
from irrsplat.gpu.target import float_texture
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.scheduler import RecordScheduler, ViewState
from irrsplat.lighting.direct import DirectPass
from irrsplat.lighting.light_table import light_defines
from irrsplat.meter.lit_scene import LitScene
from irrsplat.scene.model import Camera, Scene, measure
from irrsplat.settings import MOST_ROUNDS, SettingValues, preset

OnBake = Callable[[float, str], None]  # called with the completed share 0..1 and a message
_AFAR = 1000.0  # of the scene's diagonal: distance of the camera that stands for a view, so that it has one scale everywhere


class PlaceLight(Tenant):
    """Light at any points on a scene's surfaces; records stay, so that further points add only missing ones.

    scene: recentred and local. preset, settings: settings of the stages shadow, gather, splat and examine. Raises InputError
    for invalid settings, GLError without OpenGL 3.3.
    """

    def __init__(
        self, scene: Scene, preset_name: str, ctx: moderngl.Context | None = None, **settings: Unpack[SettingValues]
    ) -> None:
        self.scene = scene
        self.settings = replace(preset(preset_name, **settings), placement="tiles")
        with self._moving_in(ctx):
            self.lit = self.own(LitScene(self.ctx, self.about, scene, self.settings))
            self.world, self.cache = self.lit.world, self.lit.cache
            self.scheduler = self.own(RecordScheduler(self.world, self.settings, self.cache, self.lit.timers))

    def gathered(self, where: Places, texel: float, on_bake: OnBake | None = None) -> tuple[np.ndarray, np.ndarray, bool]:
        """Return indirect light, light of emitters and of the sky at these places; gather until all places are covered.

        This is irradiance (H, W, 3) in W/m², the places (H, W) where it is valid, and True if no place requests another record.
        texel: metres between places.
        """
        self._use()
        empty = np.zeros((*where.seen.shape, 3), np.float32)
        if not self.settings.most_bounces or not where.seen.any():
            return empty, where.seen.copy(), True
        scheduler, settings, budget = self.scheduler, self.settings, Budget(None)
        scheduler.gatherer.prepare(self.lit.shadows, budget)
        camera, side = self._view(where.size)
        greatest = settings.radius_max / 100.0 * side or self.scene.diagonal
        least = max(settings.radius_min / 100.0 * side, texel)
        with (
            _Drawn(self.ctx, where, settings.gradients) as drawn,
            PlaceSplats(self.ctx, drawn.gbuffer, where, settings, (min(least, greatest), greatest)) as splats,
        ):
            view, before = ViewState((camera,)), self.cache.count
            for _ in range(MOST_ROUNDS):
                scheduler.limit_radii(view)
                sums = splats.update(self.cache)
                screen = scheduler.screen(drawn.gbuffer, sums, camera)
                view, _ = scheduler.gather_missing(view, screen, self.lit.shadows, budget)
                if scheduler.ended(view, screen):
                    break
                if on_bake is not None:
                    on_bake(view.coverage, f"{self.cache.count - before} records")
            splats.update(self.cache)
            totals = splats.read()
        covered = where.seen & (totals[..., 3] > 0.0)
        irradiance = np.where(covered[..., None], totals[..., :3] / np.maximum(totals[..., 3:], 1e-30), 0.0).astype(np.float32)
        check_finite("the baked irradiance", irradiance, lambda at: f"the point {where.position[at[:2]].tolist()}")
        return irradiance, covered, view.settled

    def _view(self, size: tuple[int, int]) -> tuple[Camera, float]:
        """Return a distant camera in place of a view, and the `measure` of its picture of `size` in the scene, metres."""
        side, away = self.scene.diagonal / math.sqrt(3.0), _AFAR * self.scene.diagonal  # the side of a cube with this diagonal
        fov = math.degrees(2.0 * math.atan(0.5 * side * size[1] / (measure(size) * away)))
        middle = vector(self.scene.bounds.mean(0))
        return Camera((*middle[:2], middle[2] + away), middle, fov=fov), side

    def direct(self, where: Places, number: int = 0) -> np.ndarray:
        """Return the irradiance (H, W, 3) of lights with shadows, in W/m²; number: index of the subtexel sample."""
        if not self.scene.lights:
            return np.zeros((*where.seen.shape, 3), np.float32)
        self._use()
        kinds, turned = {**light_defines(self.scene), **self.world.material_defines}, 2.399963 * number
        with _Drawn(self.ctx, where, True) as drawn, DirectPass(self.ctx, where.size, kinds, irradiance=True) as lights:
            caster = shadow_caster(self.world, self.settings)
            lit = lights(drawn.gbuffer, self.lit.shadows, rotation=turned, world=caster)
            found = np.frombuffer(lit.read(), "f4").reshape(*where.seen.shape, -1)[..., :3]
        return np.where(where.seen[..., None], found, 0.0).astype(np.float32)


class _Drawn(Owner):
    """G-buffer of places; bends: include mapped normals if the surfaces have them."""

    def __init__(self, ctx: moderngl.Context, where: Places, bends: bool) -> None:
        octahedral = np.zeros((2, *where.seen.shape), np.float32)
        octahedral[:, where.seen] = octahedral_encode(where.geometric[where.seen].astype(float))

        def texture(values: np.ndarray, last: np.ndarray) -> moderngl.Texture:
            made = self.own(float_texture(ctx, where.size))
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
