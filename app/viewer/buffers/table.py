"""The table of all buffers that the viewer can show. Their keys, menu, legends, values and help result from it.

A further buffer is one more entry. It may need a new shader in shaders/viewer/buffers/.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Legend, Shown, ShownBuffer, ViewSource, colour_map, first
from irrsplat.core.buffers import CHANNELS, Atlas, Uniforms
from irrsplat.core.vectors import corners
from irrsplat.core.words import amount
from irrsplat.gpu.target import texel
from irrsplat.image.tonemap import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.lighting.sky import sky_maps, sky_uniforms
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.renderer import Renderer
from irrsplat.settings import Settings

_NO_REFERENCE, _NO_SHADOWS = Legend("no reference of this view yet; Y traces it"), Legend("no light casts shadows here")
_ALBEDO, _ALPHA = Legend("reflectance, sRGB encoded", "0", "1"), Legend("share of the pixel", "0", "1")
_SHADOW_HELP = "every light's shadow maps: distance from the light along each one's axis"
_ATLAS_HELP = "what the records of the last batch saw, a hemisphere each"
_LIGHT_HELP = "all light that falls on surfaces, in lux, with isolines"
_SURFACE_HELP = "irradiance of all bounces but the last, as gathers look it up"
_ERROR_HELP = "irradiance minus the path-traced reference"
_DECADES = 50.0  # the upper end of the scale of weights is this factor above 1/a: Σw is 0, or at least 1/a


def _channel(name: str, fragment: str, show: Callable[[ViewSource], Shown], title: str = "", **more: Any) -> ShownBuffer:
    """Return the buffer of an image channel. Files hold these channels, too. more: further fields of ShownBuffer."""
    return ShownBuffer(name, title or name, CHANNELS[name].help, fragment, show, **more)


def _exposed(source: ViewSource, unit: str, more: str = "") -> Legend:
    """Return the legend of a buffer that has the exposure of the picture. more: the end of its text."""
    return Legend(f"{unit}, exposed by {source.exposure:+.1f} stops{more}", unit=unit)


# ---- radiance and irradiance -------------------------------------------------------------------------------------------


def _image(source: ViewSource) -> Shown:
    view, (lower, upper) = source.view, source.view.backdrop.ends
    shown = {"values": view.image, "alpha": view.alpha, "plain": view.backdrop.kind == "sky", "SMOOTHED": int(source.smoothed)}
    return {**shown, "lower": lower, "upper": upper, "gain": source.gain}, _exposed(source, CHANNELS["image"].unit)


def _radiance(source: ViewSource, texture: moderngl.Texture, covers_unseen: bool) -> Shown:
    """Return the shown form of radiance. covers_unseen: False if pixels without a surface show the backdrop instead."""
    behind = source.view.backdrop.uniforms(source.view.camera, source.view.image.size)
    uniforms = {"values": texture, "covers_unseen": covers_unseen, "gain": source.gain, **behind}
    return uniforms, _exposed(source, CHANNELS["direct"].unit)


def _emission(source: ViewSource) -> Shown:
    """Return the shown form of the mean over a pixel's samples; with one sample, of the surface or the backdrop."""
    averaged = source.view.emission
    return _radiance(source, averaged or source.view.gbuffer.emission, averaged is not None)


def _indirect(source: ViewSource) -> Shown:
    """Return the shown form of the mean over a pixel's samples; with one sample at its centre, of albedo/π times irradiance."""
    view, averaged = source.view, source.view.indirect is not None
    uniforms = {
        "values": view.indirect or view.splats.sums,
        "averaged": averaged,
        "albedo": view.gbuffer.albedo,
        "gain": source.gain,
    }
    return uniforms, _exposed(source, CHANNELS["indirect"].unit)


def _read_indirect(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    if uniforms["averaged"]:
        return texel(uniforms["values"], x, y)[:3]
    found: np.ndarray = _mean(uniforms, x, y) * texel(uniforms["albedo"], x, y)[:3] / np.float32(np.pi)
    return found


def _mean(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    """Return (3,) Σ k·E / Σ k of a texel; 0 for Σ k = 0."""
    sums = texel(uniforms["values"], x, y)
    return sums[:3] / (sums[3] if sums[3] > 0.0 else np.float32(1.0))


def _irradiance(source: ViewSource, texture: moderngl.Texture, more: str = "") -> Shown:
    """Return the shown form of irradiance from Σ k·E and Σ k, as radiance of a white surface, to compare with the picture."""
    return {"values": texture, "gain": source.gain}, _exposed(source, "W/m²", f", as reflected by a white surface{more}")


def _surface(source: ViewSource) -> Shown:
    surface = source.renderer.scheduler.gatherer.surface_now
    if surface is None:
        return None, Legend("no surface cache: it is made for more than one bounce")
    return _irradiance(source, surface.view(source.view.gbuffer))


def _reference(source: ViewSource) -> Shown:
    reference = source.reference
    return (None, _NO_REFERENCE) if reference is None else _irradiance(source, reference.values, f"; {reference.about}")


def _mean_if_any(uniforms: Uniforms, x: int, y: int) -> np.ndarray | None:
    return _mean(uniforms, x, y) if texel(uniforms["values"], x, y)[3] else None


def _light(source: ViewSource) -> Shown:
    """Return the shown form of illuminance by the user's scale, independently of the surface's reflectance."""
    scale, (low, high) = source.light_scale, source.light_scale.ends
    ends = {"low": low, "high": high, "steps": float(STEPS) if scale.lines else 0.0, "ground": GROUND, "palette": false_colours()}
    light = {
        "values": source.view.splats.sums,
        "direct": source.renderer.direct_irradiance(source.view),
        "weights": scale.weights,
    }
    return {**light, **ends}, _light_legend(source)


def _light_legend(source: ViewSource) -> Legend:
    """Return the legend of illuminance. It draws no direct light: the lights may have changed since the view was drawn."""
    (low, high), unit = source.light_scale.ends, source.light_scale.shown_unit
    text = f"a line every {amount((high - low) / STEPS)} {unit}"
    return Legend(text, amount(low), amount(high), unit, false_colours())


def _read_light(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    return np.array([(texel(uniforms["direct"], x, y)[:3] + _mean(uniforms, x, y)) @ uniforms["weights"]], np.float32)


def _error(source: ViewSource) -> Shown:
    """Return the shown form of the error of irradiance against the reference, in the colours of `irrsplat verify`."""
    reference = source.reference
    if reference is None:
        return None, _NO_REFERENCE
    bright, dark, grey = (np.array(colour) / 255.0 for colour in (BRIGHT, DARK, GREY))
    ends = {"full": reference.full, "bright": bright, "dark": dark, "unseen": grey}
    text = f"mean of the channels; in full colour at {100.0 * FULL:g} % of the reference's mean; grey: no surface"
    colours = error_colours(np.linspace(-1.0, 1.0, 64))
    legend = Legend(f"{text}; {reference.about}", f"{-reference.full:.3g}", f"{reference.full:.3g}", "W/m²", colours)
    return {"values": source.view.splats.sums, "reference": reference.values, **ends}, legend


def _read_error(uniforms: Uniforms, x: int, y: int) -> np.ndarray | None:
    found = texel(uniforms["reference"], x, y)
    off: np.ndarray = np.mean(_mean(uniforms, x, y) - found[:3], keepdims=True)
    return None if found[3] == 0.0 else off


# ---- weights -----------------------------------------------------------------------------------------------------------


def weight_range(settings: Settings) -> tuple[float, float]:
    """Return the ends of the logarithmic scale of Σw. The threshold lies between them."""
    least, threshold = 1.0 / settings.a, settings.threshold
    low, high = 0.5 * least, _DECADES * least
    return (min(low, 0.5 * threshold) if threshold > 0.0 else low), max(high, 2.0 * threshold)


def _weight(source: ViewSource) -> Shown:
    """Return the shown form of the sum of weights Σw on a logarithmic scale, with the contour of the threshold."""
    (low, high), threshold = weight_range(source.renderer.settings), source.renderer.settings.threshold
    mark = float(np.log(threshold / low) / np.log(high / low)) if threshold > 0.0 else None
    text = f"logarithmic; the line is the tolerance {threshold:.3g}, black on the side that requests records"
    legend = Legend(text, f"{low:.3g}", f"{high:.3g}", "", colour_map(), mark)
    return {"values": source.view.splats.weight, "low": low, "high": high, "threshold": threshold}, legend


def _requests(source: ViewSource) -> Shown:
    splats, settings = source.view.splats, source.renderer.settings
    limits = {"tolerance": settings.threshold, "spread": settings.spread, "luminance_floor": splats.luminance_floor}
    variance = f", or whose records differ by {100.0 * settings.spread:.3g} %" if settings.spread else ""
    legend = Legend(f"orange: pixels with Σw below {settings.threshold:.3g}{variance}")
    return {"values": splats.weight, "image": source.view.image, "gain": source.gain, "sums": splats.sums, **limits}, legend


# ---- the surface that a pixel sees -------------------------------------------------------------------------------------


def _normal(texture: moderngl.Texture) -> Shown:
    """Return the shown form of unit vectors: x, y and z from -1 to 1 as red, green and blue."""
    ends = {"low": np.full(3, -1.0), "high": np.ones(3)}
    return {"values": texture, **ends}, Legend("x y z as red, green, blue", "-1", "1")


def _position(source: ViewSource) -> Shown:
    low, high = source.renderer.scene.near_bounds
    form, digits = (".2f", ".3f") if any(source.origin) else (".3g", ".4g")  # far from the origin, %g has too few digits
    first, last = (" ".join(f"{v:{form}}" for v in end + source.origin) for end in (low, high))
    text, unit = "x y z as red, green, blue within these bounds", CHANNELS["position"].unit
    ends = {"low": low, "high": np.where(high > low, high, low + 1.0)}
    uniforms = {"values": source.view.gbuffer.position, "origin": source.origin, **ends}
    return uniforms, Legend(text, first, last, unit, form=digits)


def _read_position(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    """Return (3,) float64 the position in world space."""
    found: np.ndarray = texel(uniforms["values"], x, y)[:3].astype(float) + uniforms["origin"]
    return found


def _depth(source: ViewSource) -> Shown:
    """Return the shown form of the distance along the view axis, in metres. The scene's bounds give its ends."""
    scene, camera = source.renderer.scene, source.view.camera
    near, whole = ((corners(of) - camera.eye) @ -camera.axes[2] for of in (scene.near_bounds, scene.bounds))
    along = near if near.max() > 0.1 * np.ptp(near) else whole  # a wide ground counts for a view away from all else
    low, high = max(float(along.min()), 0.0), float(along.max())
    high = high if high > low else low + scene.diagonal
    legend = Legend("distance along the view axis", f"{low:.3g}", f"{high:.3g}", CHANNELS["depth"].unit, colour_map())
    return {"values": source.view.gbuffer.position, "low": low, "high": high}, legend


def _read_depth(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    return np.array([texel(uniforms["values"], x, y)[3] or np.inf], "f4")


# ---- tiles -------------------------------------------------------------------------------------------------------------


def atlas_tiles(atlas: Atlas, renderer: Renderer, gain: float) -> Uniforms:
    """Return the uniforms of an atlas, radiance times `gain`. A texel whose ray misses all surfaces shows the sky."""
    cells = {"count": atlas.count, "cell": atlas.cell, "columns": atlas.columns}
    textures = {"radiance": atlas.radiance, "table": atlas.table, "frames": atlas.frames}
    return {**cells, **textures, "gain": gain, **sky_uniforms(renderer.scene, sky_maps(renderer.world))}


def _atlas(source: ViewSource) -> Shown:
    atlas = source.renderer.scheduler.gatherer.atlas
    uniforms = None if atlas is None else atlas_tiles(atlas, source.renderer, source.gain)
    return uniforms, _exposed(source, "W/(m² sr)")


def _shadow(source: ViewSource) -> Shown:
    shadows, lit = source.renderer.shadows, bool(source.renderer.scene.lights)
    if shadows is None:
        return None, _NO_SHADOWS
    side, columns, _ = shadows.layout
    count = int(shadows.table.reshape(-1, 8, 4)[:, 1, 3].round().sum())  # see shaders/lighting/lights.glsl
    uniforms = {"count": count, "cell": (side, side), "columns": int(columns), "shadow_depth": shadows.depth}
    legend = Legend("distance from the light / depth of the map; black: nothing", "0", "1", "", colour_map())
    return uniforms, legend if lit else _NO_SHADOWS


# In the order of the menu; the first twelve have the keys 1 to 9, 0, - and =.
BUFFERS: dict[str, ShownBuffer] = {
    buffer.name: buffer
    for buffer in (
        _channel("image", "image", _image, everywhere=True),
        _channel("direct", "radiance", lambda source: _radiance(source, source.view.direct, True)),
        _channel("indirect", "indirect", _indirect, read=_read_indirect),
        _channel("irradiance", "irradiance", lambda source: _irradiance(source, source.view.splats.sums), read=_mean),
        _channel("weight", "weight", _weight, read=first(1)),
        _channel("position", "range", _position, read=_read_position),
        _channel("normal", "range", lambda source: _normal(source.view.gbuffer.lit_normal)),
        _channel("albedo", "unit", lambda source: ({"values": source.view.gbuffer.albedo, "grey": False}, _ALBEDO)),
        _channel("depth", "depth", _depth, read=_read_depth, everywhere=True),
        ShownBuffer("requests", "requests", "pixels that request a record", "requests", _requests, first(1)),
        ShownBuffer("shadow", "shadow maps", _SHADOW_HELP, "shadow_maps", _shadow, in_view=False),
        ShownBuffer("atlas", "gather atlas", _ATLAS_HELP, "gather_atlas", _atlas, in_view=False),
        ShownBuffer("light", "light (false colours)", _LIGHT_HELP, "light", _light, _read_light, legend_alone=_light_legend),
        _channel("emission", "radiance", _emission),
        _channel("smooth_normal", "range", lambda source: _normal(source.view.gbuffer.normal), "smooth normal"),
        ShownBuffer("surface", "surface cache", _SURFACE_HELP, "irradiance", _surface, _mean_if_any),
        _channel("alpha", "unit", lambda s: ({"values": s.view.alpha, "grey": True}, _ALPHA), read=first(1), everywhere=True),
        ShownBuffer("reference", "reference", "path-traced irradiance", "irradiance", _reference, _mean_if_any),
        ShownBuffer("error", "error", _ERROR_HELP, "error", _error, _read_error, everywhere=True),
    )
}
