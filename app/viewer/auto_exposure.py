"""The exposure of what is shown: as the settings say, or following the picture, as an eye does."""

from __future__ import annotations

import math

from irrsplat.image.composite import CompositePass
from irrsplat.image.view import View
from irrsplat.renderer import Renderer

_TIME = 0.25  # seconds in which it goes 63 % of its way
_NEAR = 0.01  # stops


class AutoExposure:
    """The stops that both sides are exposed by, so that they compare; NaN until there is a picture."""

    def __init__(self) -> None:
        self.stops = math.nan
        self._goal = 0.0
        self._view: View | None = None  # the last one that was metered
        self._meter: CompositePass | None = None  # whose reading is still to come

    @property
    def settled(self) -> bool:
        """Whether it would stay as it is while the picture does."""
        return self._meter is None and abs(self.stops - self._goal) <= _NEAR

    def tick(self, renderer: Renderer, view: View, dt: float) -> None:
        """Go on by `dt` seconds towards what the renderer's settings say, or its `view` asks for."""
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
        if math.isnan(self.stops):  # the first picture of all waits for its own
            self._meter, self._goal = None, meter.metered()
            self.stops = self._goal
        way = self._goal - self.stops
        self.stops += way * (1.0 - math.exp(-dt / _TIME)) if abs(way) > _NEAR else way
