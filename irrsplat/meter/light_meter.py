"""The light meter: irradiance at any points, without interpolation and without a camera.

Each point is gathered like a record, at its exact position. Direct light comes from the shadow maps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Unpack

import moderngl
import numpy as np
import numpy.typing as npt

from irrsplat.core.buffers import Sites
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import check_finite, unit
from irrsplat.core.words import GREATEST
from irrsplat.gather.kinds import shadow_caster
from irrsplat.gather.record_frame import offset_of
from irrsplat.gpu.resource import Tenant
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.gathering.record_gatherer import RecordGatherer
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.site_light import SiteLightPass
from irrsplat.meter.lit_scene import LitScene
from irrsplat.meter.readings import Readings, Status
from irrsplat.scene.model import Scene
from irrsplat.scene.model.checks import check_callback, check_type
from irrsplat.scene.spatial.solids import inside_solids
from irrsplat.settings import Settings, SettingValues, preset

if TYPE_CHECKING:
    from irrsplat.core.buffers import ShadowMaps

PRESET = "reference"  # accuracy before speed
_LIGHT_SAMPLES = 1024  # per point by default: a window's light then has an error of about 0.3 %
_FINEST = 128  # side of a gather from which the surface cache has its finest level, which takes about three times as long
_EYES = 8  # greatest number of points around which the surface cache has the finest cells
_AT_ONCE = 512  # points between two reports of progress
_PREPARED, _LEVEL = 0.1, 0.3  # shares of the first call's progress: before the surface cache has finer levels, and for each level
_OWN = 4e-7  # of the greatest coordinate or diagonal: the resolution of float32, within which a point lies on a surface

OnShare = Callable[[float], None]  # called with the finished share of the work, 0..1


class LightMeter(Tenant):
    """Measures the light of a scene at any points.

    scene: from `irrsplat.load`. preset: a name of settings.PRESETS, modified by settings of the stages `shadow` and `gather`, by
    name; others are not accepted. ctx: a moderngl context that its owner makes current (default: a new one). Raises InputError
    for invalid settings and too many lights, GLError without OpenGL 3.3. Like a Renderer, it works only in the thread and process
    that made it. Use it in a `with` block, or call `release`, to free its GPU resources.
    """

    def __init__(
        self, scene: Scene, preset: str = PRESET, ctx: moderngl.Context | None = None, **settings: Unpack[SettingValues]
    ) -> None:
        check_type("what a LightMeter measures", scene, Scene)
        scene = scene.recentred
        self._origin, self.scene = scene.origin, scene.local  # all positions are relative to it, except points and readings
        scene, self.settings = self.scene, measuring(preset, **settings)
        with self._moving_in(ctx):
            self.lit = self.own(LitScene(self.ctx, self.about, scene, self.settings))
            self.world, self.cache = self.lit.world, self.lit.cache
            self.gatherer = self.own(RecordGatherer(self.world, self.settings, self.cache, self.lit.timers, measuring=True))
        self._direct: SiteLightPass | None = None

    def measure(self, points: npt.ArrayLike, normals: npt.ArrayLike, on_progress: OnShare | None = None) -> Readings:
        """Return the readings of sensors at `points` (N, 3), metres, facing along `normals` (N, 3) or (3,), of any length.

        A result depends on other points through its point's number, which selects the directions of its rays. It also depends a
        little on the points of the first call, around which the surface cache is finest. on_progress: called repeatedly.
        Raises InputError for arrays of other shapes and non-finite numbers; IrrsplatError for a non-finite reading.
        """
        check_callback("on_progress", on_progress)
        report: OnShare = on_progress or (lambda share: None)
        places, sites = _sites(points, normals, self._origin)
        self._use()
        count = len(sites)
        direct, indirect, radius = (np.zeros(shape, np.float32) for shape in ((count, 3), (count, 3), count))
        first_call, lights, shadows = self._direct is None, self._prepared(sites, report), self.lit.shadows
        finer = self.gatherer.surface.refinements if first_call and self.gatherer.surface is not None else 0
        start = _PREPARED + _LEVEL * finer if finer else 0.0  # most of the first call's time passes before the first point
        greatest = float(np.abs(self.scene.bounds + np.asarray(self._origin)).max())
        offset, own = offset_of(self.scene), _OWN * max(self.scene.diagonal, greatest)
        lift = np.full(count, offset)  # metres, of a ray origin above its point: at most half the way to the first surface
        for first in range(0, count, _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            here = sites[some]
            direct[some], free = lights(shadows, here, np.zeros(len(here), np.float32), (own, 2.0 * offset))
            if lights.world is not None:
                lift[some] = 0.5 * free
            if self.settings.most_bounces:
                lower = (lift[some] - offset)[:, None] * here.normal  # the gather adds the offset
                indirect[some], radius[some] = self._gathered(shadows, replace(here, position=here.position + lower))
            report(start + (1.0 - start) * min((first + _AT_ONCE) / count, 1.0))
        status = np.full(count, Status.OK)
        if self.settings.most_bounces:
            status[radius < touching_distance(self.scene)] = Status.BEHIND
        lifted = sites.position.astype(float) + lift[:, None] * sites.normal
        status[inside_solids(self.scene, lifted, sites.normal.astype(float))] = Status.INSIDE
        measured = np.where((status == Status.OK)[:, None], direct + indirect, np.float32(0.0))
        check_finite("the light", measured, lambda at: "{:g} {:g} {:g}".format(*places[at[0]]))
        return Readings(places, sites.normal, direct, indirect, status)

    def _prepared(self, sites: Sites, report: OnShare) -> SiteLightPass:
        """Return the pass of direct light; at first use, make the surface cache, its finest level for a fine gather.

        sites: the first ones to be measured.
        """
        if self._direct is None:
            some = sites[:: -(-len(sites) // _EYES) or 1]
            self.world.eyes = some.position + 2.0 * offset_of(self.scene) * some.normal.astype(float)
            shadows = self.lit.shadows
            if self.settings.most_bounces:
                self.gatherer.prepare(shadows, Budget(None))
                surface = self.gatherer.surface
                while surface is not None and surface.may_refine and self.settings.gather_size >= _FINEST:
                    report(_PREPARED + _LEVEL * surface.refinements)
                    surface.refine(shadows, Budget(None))
            defines = {**light_defines(self.scene), "ANYWHERE": 1}
            caster = shadow_caster(self.world, self.settings)
            self._direct = self.own(SiteLightPass(self.ctx, defines, _AT_ONCE, caster))
        return self._direct

    def _gathered(self, shadows: ShadowMaps, sites: Sites) -> tuple[np.ndarray, np.ndarray]:
        """Return (N, 3) W/m² without direct light at the sites, and (N,) harmonic mean distances of the hits, metres."""
        try:
            self.gatherer.gather(sites, shadows, Budget(None))
            found = self.cache.read()
        finally:
            self.cache.truncate(0)
        return found["irradiance"], found["radius"]


def measuring(name: str = PRESET, **settings: Unpack[SettingValues]) -> Settings:
    """Return the meter's settings for these; raises InputError for unknown ones."""
    settings = {"light_samples": _LIGHT_SAMPLES, **settings}
    # gradients and placement only matter for interpolation
    return replace(preset(name, **settings), gradients=False, placement="tiles")


def touching_distance(scene: Scene) -> float:
    """Return the distance, metres, within which a surface counts as touching a point."""
    return min(0.01, 1e-3 * scene.diagonal)


def _sites(points: npt.ArrayLike, normals: npt.ArrayLike, origin: tuple[float, float, float]) -> tuple[np.ndarray, Sites]:
    """Return the points (N, 3), and the sites there, relative to an origin; float32, except points far from 0 0 0."""
    try:
        p, n = np.asarray(points, float), np.asarray(normals, float)
        n = np.broadcast_to(n, p.shape)
    except (TypeError, ValueError):
        p = n = np.zeros(0)
    if p.ndim != 2 or p.shape[1] != 3:
        raise InputError("points are an array (N, 3) of numbers, and normals (N, 3) or (3,)")
    if not ((np.abs(p) <= GREATEST).all() and (np.abs(n) <= GREATEST).all()):  # false for NaN
        raise InputError(f"points and normals must be finite numbers, at most {GREATEST:g}")
    if not (np.abs(n).max(1, initial=0.0) > 0.0).all():
        raise InputError("a normal is 0 0 0; give the direction that the point faces")
    direction = unit(n).astype(np.float32)
    near = (p - origin if any(origin) else p).astype(np.float32)
    return p if any(origin) else near, Sites(near, direction, direction, frame_rotation=np.arange(len(p)))


def irradiance(
    scene: Scene, points: npt.ArrayLike, normals: npt.ArrayLike, preset: str = PRESET, **settings: Unpack[SettingValues]
) -> np.ndarray:
    """Return (N, 3) W/m², float32: irradiance at `points` (N, 3), metres, from the side of `normals` (N, 3) or (3,).

    Includes lights, emitters and sky, directly and by all bounces, without a camera. Arguments and errors as for LightMeter.
    """
    with LightMeter(scene, preset, **settings) as meter:
        return meter.measure(points, normals).total
