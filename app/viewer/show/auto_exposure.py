"""The exposure of what is shown: as the settings say, or following the picture as an eye adapts."""

from __future__ import annotations

import math

from irrsplat.image.composite import CompositePass
from irrsplat.image.view import View
from irrsplat.renderer import Renderer

_TIME = 0.25  # seconds: time constant of the adaptation
_NEAR = 0.01  # stops within which the goal counts as reached


class AutoExposure:
    """The exposure of both sides in stops, the same so that they compare; NaN until there is a picture."""

    def __init__(self) -> None:
        self.stops = math.nan
        self._goal = 0.0
        self._view: View | None = None  # the last view that was metered
        self._meter: CompositePass | None = None  # that was asked, and has yet to be read

    @property
    def settled(self) -> bool:
        """Whether it would stay as it is while the picture does."""
        return self._meter is None and abs(self.stops - self._goal) <= _NEAR

    def tick(self, renderer: Renderer, view: View, dt: float) -> None:
        """Move by `dt` seconds towards what the renderer's settings say, or what its `view` needs."""
        if renderer.settings.exposure != "auto":
            self.stops = self._goal = float(renderer.settings.exposure)
            self._view = self._meter = None
            return
        meter = renderer.composite_pass
        if self._meter is meter:
            self._goal = meter.metered()
        self._meter = None
        if view is not self._view:
            self._view, self._meter = view, meter
            meter.measure(view.image)
        if math.isnan(self.stops):  # the very first picture: wait for the reading
            self._meter, self._goal = None, meter.metered()
            self.stops = self._goal
        way = self._goal - self.stops
        self.stops += way * (1.0 - math.exp(-dt / _TIME)) if abs(way) > _NEAR else way
