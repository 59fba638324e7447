"""What can be shown of a view, and what the colours of each picture stand for."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.app.common.error_colours import FULL, error_colours
from irrsplat.app.viewer.background_truth import Truth
from irrsplat.core.buffers import CHANNELS, ShadowMaps
from irrsplat.image.tonemap import viridis
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings

_DECADES = 50.0  # the scale of weights goes so far above and below 1/a: Σw is 0, or at least that


@dataclass(frozen=True)
class Showing:
    """One thing to show: its title for a menu, its unit, what it is, and how it is drawn (a block of overlay_buffer.frag)."""

    name: str
    title: str
    unit: str
    help: str
    how: str


_HOW = {"indirect": "indirect", "irradiance": "irradiance", "weight": "weight", "normal": "range"}
_OTHERS = (
    Showing("asking", "asking", "", "where the examination asks for records", "asking"),
    Showing("shadow", "shadow maps", "m", "every light's shadow maps: distance from the light along each one's axis", "shadow"),
    Showing("atlas", "gather atlas", "W/(m² sr)", "what the records of the last batch saw, a hemisphere each", "atlas"),
    Showing("surface", "surface cache", "W/m²", "irradiance of all bounces but the last, as gathers look it up", "surface"),
    Showing("reference", "reference", "W/m²", "the path-traced truth of irradiance", "reference"),
    Showing("error", "error", "W/m²", "irradiance minus its path-traced truth", "error"),
)
_FIRST = ("image", "direct", "indirect", "irradiance", "weight", "position", "normal", "albedo", "depth")  # the keys 1 to 9
_ORDER = (*_FIRST, "asking", "shadow", "atlas", "emission", "surface", "reference", "error")
_ALL = {c.name: Showing(c.name, c.name, c.unit, c.help, _HOW.get(c.name, c.show)) for c in CHANNELS.values()}
_ALL |= {s.name: s for s in _OTHERS}

TRUTHS = ("reference", "error")  # the ways to show what must be traced first
NO_TRUTH = "no truth of this view yet: Y traces it"
NO_SURFACE = "no surface cache: it is made for more than one bounce"

SHOWINGS: dict[str, Showing] = {name: _ALL[name] for name in _ORDER}


@dataclass(frozen=True)
class Legend:
    """What a picture's colours stand for: the scale's ends `low` and `high` with `unit`, and a line of text.

    colours: (N, 3) display colours 0..1 from low to high, None where there is no scale. mark: the place 0..1 on the scale of
    what the text calls the threshold, or None.
    """

    low: str
    high: str
    unit: str
    colours: np.ndarray | None
    text: str
    mark: float | None = None


def legend(
    name: str,
    *,
    settings: Settings,
    scene: Scene,
    camera: Camera,
    exposure: float,
    shadows: ShadowMaps | None = None,
    truth: Truth | None = None,
    surface: moderngl.Texture | None = None,
) -> Legend:
    """The legend of the showing `name`, drawn with these arguments; exposure in stops."""
    showing = SHOWINGS[name]
    scale = viridis(np.linspace(0.0, 1.0, 64))
    if showing.how == "heat":
        low, high = depth_range(scene, camera)
        return Legend(f"{low:.3g}", f"{high:.3g}", showing.unit, scale, "distance along the view axis")
    if showing.how == "shadow":
        if shadows is None or not scene.lights:
            return Legend("", "", "", None, "no light casts shadows here")
        low, high = shadow_range(scene, shadows)
        return Legend(f"{low:.3g}", f"{high:.3g}", showing.unit, scale, "distance from the light; black: nothing there")
    if showing.how == "surface" and surface is None:
        return Legend("", "", "", None, NO_SURFACE)
    if showing.how in TRUTHS and truth is None:
        return Legend("", "", "", None, NO_TRUTH)
    if showing.how == "error" and truth is not None:
        text = f"mean of the channels; in full colour at {100.0 * FULL:g} % of the truth's mean; grey: no surface"
        colours = error_colours(np.linspace(-1.0, 1.0, 64))
        return Legend(f"{-truth.full:.3g}", f"{truth.full:.3g}", showing.unit, colours, f"{text}; {truth.about}")
    if showing.how == "weight":
        low, high = weight_range(settings)
        threshold = settings.threshold
        mark = float(np.log(threshold / low) / np.log(high / low)) if threshold > 0.0 else None
        text = f"logarithmic; the line is the tolerance {threshold:.3g}, black on the side that asks for records"
        return Legend(f"{low:.3g}", f"{high:.3g}", "", scale, text, mark)
    if showing.how == "asking":
        doubted = f", or whose records differ by {100.0 * settings.spread:.3g} %" if settings.spread else ""
        return Legend("", "", "", None, f"orange: pixels with Σw below {settings.threshold:.3g}{doubted}")
    if name == "normal":
        return Legend("-1", "1", "", None, "x y z as red, green, blue")
    if name == "position":
        low_corner, high_corner = (" ".join(f"{v:.3g}" for v in corner) for corner in scene.bounds)
        return Legend(low_corner, high_corner, showing.unit, None, "x y z as red, green, blue within the scene's bounds")
    if name == "albedo":
        return Legend("0", "1", "", None, "reflectance, sRGB encoded")
    text = f"{showing.unit}, exposed by {exposure:+.1f} stops"
    if name in ("irradiance", "surface", "reference"):
        text += ", as a white surface sends it out"
    return Legend("", "", showing.unit, None, text + (f"; {truth.about}" if name == "reference" and truth is not None else ""))


def weight_range(settings: Settings) -> tuple[float, float]:
    """The ends of the logarithmic scale of Σw, the threshold inside."""
    least, threshold = 1.0 / settings.a, settings.threshold
    low, high = 0.5 * least, _DECADES * least
    return (min(low, 0.5 * threshold) if threshold > 0.0 else low), max(high, 2.0 * threshold)


def depth_range(scene: Scene, camera: Camera) -> tuple[float, float]:
    """The least and greatest distance along the view axis that anything of the scene can have, in metres."""
    along = (scene.corners - np.asarray(camera.eye)) @ -camera.axes[2]
    low, high = max(float(along.min()), 0.0), float(along.max())
    return low, high if high > low else low + scene.diagonal


def shadow_range(scene: Scene, shadows: ShadowMaps) -> tuple[float, float]:
    """The least and greatest distance from a light, along a tile's axis, that its shadow maps can hold, in metres."""
    ends = []
    for tile in light_tiles(shadows):
        if tile.thickness:
            ends.append((0.0, tile.thickness))
            continue
        away = scene.corners - tile.eye
        along = np.abs(away).max(1) if tile.axis is None else np.maximum(away @ tile.axis, 0.0)
        ends.append((0.0 if tile.axis is None else along.min(), along.max()))
    low, high = (float(f([end[i] for end in ends])) for i, f in enumerate((min, max))) if ends else (0.0, 1.0)
    return low, high if high > low else low + scene.diagonal


@dataclass(frozen=True)
class LightTile:
    """A shadow map tile: the light's place, the tile's axis (None: one of six about a point), and the metres of depth in a
    parallel tile (0: a perspective one)."""

    eye: np.ndarray
    axis: np.ndarray | None
    thickness: float


def light_tiles(shadows: ShadowMaps) -> list[LightTile]:
    """The tiles of all lights in their order, read from the table of shaders/lighting/lights.glsl."""
    tiles: list[LightTile] = []
    for position, colour, _, _, cone, _, _, forward in shadows.table.reshape(-1, 8, 4):
        directional, count = position[3] > 0.5, round(colour[3])
        axis = forward[:3] if count == 1 else None
        tiles += [LightTile(position[:3], axis, float(cone[0]) if directional else 0.0)] * count
    return tiles
