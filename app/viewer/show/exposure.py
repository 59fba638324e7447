"""The levels of the view: the automatic exposure, and the brightest light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Identity
from irrsplat.app.viewer.show.screen import some_rows
from irrsplat.core.color import LUMINANCE
from irrsplat.image.view import View
from irrsplat.meter.light_scale import PERCENTILE
from irrsplat.renderer import Renderer

_TIME = 0.25  # seconds: time constant of the adaptation
_NEAR = 0.01  # stops within which the goal counts as reached
_SLACK = 1.0  # stops that it may be off while a view fills, so that it moves once, when all light is there
_FASTEST = 6.0  # stops a second
_MOST = 20.0  # stops, up and down: what is darker than that stays dark
_ROWS = 24  # of pixels that are read for the brightest light


class AutoExposure:
    """The exposure of both sides in stops, the same so that they compare; NaN until there is a picture.

    The first picture that is lit decides at once. After it nothing jumps: the exposure moves by at most _FASTEST. While a view
    fills, it moves only as far as it is off by more than _SLACK. It stays in a view that is black also with _MOST, so that
    the next lit view is not white, and while the blend alone changes.
    """

    def __init__(self) -> None:
        self.stops = math.nan
        self._goal = 0.0
        self._lit = False  # whether any picture has been
        self._view: View | None = None  # the last view that was metered
        self._inputs: object = None  # of the last view, but for its blend
        self._blend = math.nan  # of the last view
        self._held = False  # since the blend has changed, and nothing else

    @property
    def settled(self) -> bool:
        """True if it is constant for a constant picture."""
        return abs(self.stops - self._goal) <= _NEAR

    def tick(self, renderer: Renderer, view: View, dt: float, filling: bool = False) -> None:
        """Move by `dt` seconds towards what the renderer's settings say, or what its `view` needs; filling: light is still
        missing in it."""
        if renderer.settings.exposure != "auto":
            self.stops = self._goal = float(renderer.settings.exposure)
            self._view = None
            self._lit = True
            return
        self._hold(renderer, view)
        before = self._lit
        if view is not self._view and not self._held:
            self._view = view
            self._aim(renderer.automatic_stops(view))
        if not before:  # nothing to move from
            self.stops = self._goal
            return
        slack = _SLACK if filling else 0.0
        way = self._goal - self.stops
        way = math.copysign(max(abs(way) - slack, 0.0), way)
        if not slack and abs(way) <= _NEAR:
            self.stops = self._goal
        else:
            step = way * (1.0 - math.exp(-dt / _TIME))
            self.stops += min(max(step, -_FASTEST * dt), _FASTEST * dt)

    def _hold(self, renderer: Renderer, view: View) -> None:
        """Hold the exposure from a change of the blend on, until something else changes: less light then looks darker."""
        blend = renderer.settings.blend
        inputs = view.camera, Identity(renderer.scene), replace(renderer.settings, blend=0.0)
        if inputs != self._inputs:
            self._held = False
        elif blend != self._blend:
            self._held = self._lit
        self._inputs, self._blend = inputs, blend

    def _aim(self, found: float) -> None:
        """Take a measurement as the goal; 0 stands for an unlit picture. A picture that is black also with _MOST is unlit."""
        if found != 0.0 and (found < _MOST or not self._lit):
            self._goal, self._lit = min(max(found, -_MOST), _MOST), True
        elif not self._lit:
            self._goal = 0.0


def brightest_light(renderer: Renderer, view: View) -> float:
    """Return what nearly all light in the view stays below, W/m² weighted as luminance is: the upper end of false colours."""
    textures = view.gbuffer.position, view.sums, renderer.direct_irradiance(view)
    position, sums, direct = (some_rows(texture, _ROWS) for texture in textures)
    light = (direct[:, :3] + sums[:, :3] / np.where(sums[:, 3:] > 0.0, sums[:, 3:], 1.0)) @ LUMINANCE
    seen = position[:, 3] > 0.0
    return float(np.percentile(light[seen], PERCENTILE)) if seen.any() else 0.0
