"""The levels of the view: the automatic exposure, and the brightest light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Identity
from irrsplat.core.color import LUMINANCE
from irrsplat.gpu.target import some_rows
from irrsplat.image.view import View
from irrsplat.meter.light_scale import brightest
from irrsplat.renderer import Renderer

_TIME = 0.25  # seconds: the time constant of the adaptation
_NEAR = 0.01  # stops: within this difference, the goal counts as reached
_SLACK = 1.0  # stops: the error that stays while light is missing, so that the picture's brightness is steady meanwhile
_FASTEST = 6.0  # stops a second: the fastest change
_MOST = 20.0  # stops, up and down: a darker view stays dark
_ROWS = 24  # about: rows of pixels that are read for the brightest light


class AutoExposure:
    """The exposure in stops, equal on both sides for comparison; NaN before the first picture.

    The first picture with indirect light sets the exposure at once. Afterwards the exposure moves by at most _FASTEST. It stays
    in a view that is black even with _MOST, and within _SLACK of an incomplete view. It stays in a complete view, and from the
    first edit of lights or blend, until another input changes: less light makes a view darker.
    """

    def __init__(self) -> None:
        self.stops = math.nan
        self._goal = 0.0
        self._lit = False  # True after the first picture with indirect light
        self._view: View | None = None  # the last metered view
        self._inputs: object = None  # the inputs of the last view, without its lights and its blend
        self._edited: object = None  # lights and blend of the last view
        self._metered = False  # True once a complete view of these inputs has been metered, or lights or blend have changed

    @property
    def settled(self) -> bool:
        """True if the exposure stays constant for a constant picture."""
        return abs(self.stops - self._goal) <= _NEAR

    def tick(self, renderer: Renderer, view: View, dt: float, filling: bool) -> None:
        """Move for `dt` seconds towards the settings' exposure, or the automatic one of a view that may be `filling`."""
        if renderer.settings.exposure != "auto":
            self.stops = self._goal = float(renderer.settings.exposure)
            self._view, self._inputs, self._lit = None, None, True
            return
        inputs = view.camera, Identity(renderer.scene.meshes), replace(renderer.settings, blend=0.0)
        edited, before = (renderer.scene.lights, renderer.settings.blend), self._lit
        self._metered = (self._metered or (before and edited != self._edited)) and inputs == self._inputs
        self._inputs, self._edited = inputs, edited
        if view is not self._view and not self._metered:
            self._view, found = view, renderer.stops(view)
            if found != 0.0 and (found < _MOST or not self._lit):  # 0 or more than _MOST means an unlit picture
                self._goal, self._lit = min(max(found, -_MOST), _MOST), not renderer.scheduler.gatherer.awaits_light
            self._metered = self._lit and not filling
        if not before or self.settled:  # the first light sets the exposure at once
            self.stops = self._goal
        if filling and abs(self._goal - self.stops) < _SLACK:
            return
        step = (self._goal - self.stops) * (1.0 - math.exp(-dt / _TIME))
        self.stops += min(max(step, -_FASTEST * dt), _FASTEST * dt)


def brightest_light(renderer: Renderer, view: View) -> float:
    """Return the brightest light in the view, luminance-weighted W/m²: the upper end of false colours."""
    textures = view.gbuffer.position, view.splats.sums, renderer.direct_irradiance(view)
    position, sums, direct = (some_rows(texture, _ROWS) for texture in textures)
    light = (direct[:, :3] + sums[:, :3] / np.where(sums[:, 3:] > 0.0, sums[:, 3:], 1.0)) @ LUMINANCE
    return brightest(light[position[:, 3] > 0.0])
