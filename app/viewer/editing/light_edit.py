"""The scene's lights as the user has set them: moved, dimmed, coloured, switched off or added."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irrsplat.app.viewer.editing.colour_temperature import blackbody
from irrsplat.core.color import LUMINANCE
from irrsplat.scene.model import Light

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class LightEdit:
    """A light of the scene as it is set: `light` with its full colour, brighter by `stops`, or off.

    loaded: the light as the scene's files have it, or as it was added. kelvin: the temperature by which it has its colour; None:
    it has one of its own. of_sky: whether it is a sun of the scene's sky, which sets it when the time is another.
    """

    light: Light
    loaded: Light
    stops: float = 0.0
    on: bool = True
    kelvin: float | None = None
    of_sky: bool = False

    @classmethod
    def of(cls, light: Light, of_sky: bool = False) -> LightEdit:
        """Return a light without changes."""
        return cls(light, light, of_sky=of_sky)

    @property
    def emitted(self) -> Light:
        """The light that the scene gets."""
        if self.on and self.stops == 0.0:
            return self.light
        red, green, blue = self.light.color
        gain = 2.0**self.stops if self.on else 0.0
        return replace(self.light, color=(red * gain, green * gain, blue * gain))

    def moved(self, position: Vector) -> LightEdit:
        """Return the light at another place. A spot keeps its target; a luminaire keeps its direction."""
        light = replace(self.light, position=position)
        if light.photometry is not None and light.spot_target is not None:
            x, y, z = (float(t) for t in np.add(light.spot_target, np.subtract(position, self.light.position)))
            light = replace(light, spot_target=(x, y, z))
        return replace(self, light=light)

    def aimed(self, target: Vector) -> LightEdit:
        """The spot with another aim."""
        return replace(self, light=replace(self.light, spot_target=target))

    def coloured(self, color: Vector) -> LightEdit:
        """Return the light in another colour."""
        return replace(self, light=replace(self.light, color=color), kelvin=None)

    def heated(self, kelvin: float) -> LightEdit:
        """Return the light in the colour of a black body, with the same luminance."""
        luminance = float(LUMINANCE @ np.asarray(self.light.color))
        red, green, blue = blackbody(kelvin)
        color = red * luminance, green * luminance, blue * luminance
        return replace(self, light=replace(self.light, color=color), kelvin=kelvin)

    def coned(self, cutoff: float, inner: float) -> LightEdit:
        """The spot with another cone: half angles in degrees, the inner one at most the outer one."""
        return replace(self, light=replace(self.light, spot_cutoff=cutoff, spot_inner=min(inner, cutoff)))
