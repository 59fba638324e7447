"""The scene's lights as the user has set them: moved, dimmed, coloured, or switched off."""

from __future__ import annotations

from dataclasses import dataclass, replace

from irrsplat.scene.model import Light, Scene


@dataclass
class Lamp:
    """A light of the scene as it is set: `light` with its full colour, brighter by `stops`, or off."""

    light: Light
    stops: float = 0.0
    on: bool = True

    @property
    def emitted(self) -> Light:
        """The light that the scene gets."""
        red, green, blue = self.light.color
        gain = 2.0**self.stops if self.on else 0.0
        return replace(self.light, color=(red * gain, green * gain, blue * gain))


class Lamps:
    """A scene's lamps, which begin as its files have them. selected: the number of the one that the lights' panel shows."""

    def __init__(self, scene: Scene) -> None:
        self._loaded = scene.lights
        self.all = [self.as_loaded(number) for number in range(len(scene.lights))]
        self.selected = 0

    @property
    def lights(self) -> list[Light]:
        """What the scene is lit by."""
        return [lamp.emitted for lamp in self.all]

    @property
    def changed(self) -> bool:
        """Whether any of them is no longer as the scene's files have it."""
        return any(lamp != self.as_loaded(number) for number, lamp in enumerate(self.all))

    def as_loaded(self, number: int) -> Lamp:
        """A lamp as the scene's files have it."""
        return Lamp(self._loaded[number])

    def reset(self, number: int) -> None:
        """Put a lamp back to what the scene's files say."""
        self.all[number] = self.as_loaded(number)
