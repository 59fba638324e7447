"""The table of all buffers that the viewer can show. Their keys, menu, legends, values and help result from it.

A further buffer is one more entry. It may need a new shader in shaders/viewer/buffers/.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Legend, ShownBuffer, ViewSource, colour_map, first
from irrsplat.core.buffers import CHANNELS, Atlas, Uniforms
from irrsplat.core.words import amount
from irrsplat.gpu.target import texel
from irrsplat.image.view import View
from irrsplat.lighting.sky import sky_maps, sky_uniforms
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings

NO_REFERENCE = "no reference of this view yet; Y traces it"
_DECADES = 50.0  # the upper end of the scale of weights is this factor above 1/a: Σw is 0, or at least 1/a


def _channel(name: str, fragment: str, uniforms: Callable[[ViewSource], Uniforms | None], **more: Any) -> ShownBuffer:
    """Return the buffer of an image channel. Files hold these channels, too. more: further fields of ShownBuffer."""
    channel = CHANNELS[name]
    return ShownBuffer(name, more.pop("title", name), channel.help, fragment, uniforms, **more)


def _exposed(unit: str, words: Callable[[ViewSource], str] = lambda source: "") -> Callable[[ViewSource], Legend]:
    """Return the legend of a buffer that has the exposure of the picture."""
    return lambda source: Legend(f"{unit}, exposed by {source.exposure:+.1f} stops{words(source)}", unit=unit)


# ---- radiance and irradiance -------------------------------------------------------------------------------------------


def _image(source: ViewSource) -> Uniforms:
    view, (lower, upper) = source.view, source.view.backdrop.ends
    plain = view.backdrop.kind == "sky"
    return {"values": view.image, "alpha": view.alpha, "plain": plain, "lower": lower, "upper": upper, "gain": source.gain}


def _radiance(source: ViewSource, texture: moderngl.Texture, covers_unseen: bool) -> Uniforms:
    """Return the uniforms of radiance. covers_unseen: False if pixels without a surface show the backdrop instead."""
    behind = source.view.backdrop.uniforms(source.view.camera, source.view.image.size)
    return {"values": texture, "covers_unseen": covers_unseen, "gain": source.gain, **behind}


def _indirect(source: ViewSource) -> Uniforms:
    """Return the uniforms of the mean over a pixel's samples; with one sample at its centre, of albedo/π times irradiance."""
    view, averaged = source.view, source.view.indirect is not None
    albedo = view.gbuffer.albedo
    return {"values": view.indirect or view.sums, "averaged": averaged, "albedo": albedo, "gain": source.gain}


def _read_indirect(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    if uniforms["averaged"]:
        return texel(uniforms["values"], x, y)[:3]
    found: np.ndarray = _mean(uniforms, x, y) * texel(uniforms["albedo"], x, y)[:3] / np.float32(np.pi)
    return found


def _mean(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    """Return (3,) Σ k·E / Σ k of a texel; 0 for Σ k = 0."""
    sums = texel(uniforms["values"], x, y)
    mean: np.ndarray = sums[:3] / (sums[3] if sums[3] > 0.0 else np.float32(1.0))
    return mean


def _irradiance(source: ViewSource, texture: moderngl.Texture | None) -> Uniforms | None:
    """Return the uniforms of irradiance from Σ k·E and Σ k, drawn as radiance of a white surface to compare with the picture."""
    return None if texture is None else {"values": texture, "gain": source.gain}


def _white(words: Callable[[ViewSource], str] = lambda source: "") -> Callable[[ViewSource], Legend]:
    """Return the legend of irradiance."""
    return _exposed("W/m²", lambda source: f", as reflected by a white surface{words(source)}")


def _mean_if_any(uniforms: Uniforms, x: int, y: int) -> np.ndarray | None:
    return _mean(uniforms, x, y) if texel(uniforms["values"], x, y)[3] else None


def _light(source: ViewSource) -> Uniforms:
    """Return the uniforms of illuminance by the user's scale, independently of the surface's reflectance."""
    scale, (low, high), direct = source.light_scale, source.light_scale.ends, source.renderer.direct_irradiance(source.view)
    steps = float(STEPS) if scale.lines else 0.0
    ends = {"low": low, "high": high, "steps": steps, "ground": GROUND, "palette": false_colours()}
    return {"values": source.view.sums, "direct": direct, "weights": scale.weights, **ends}


def _light_legend(source: ViewSource) -> Legend:
    (low, high), unit = source.light_scale.ends, source.light_scale.shown_unit
    return Legend(f"a line every {amount((high - low) / STEPS)} {unit}", amount(low), amount(high), unit, false_colours())


def _read_light(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    return np.array([(texel(uniforms["direct"], x, y)[:3] + _mean(uniforms, x, y)) @ uniforms["weights"]], np.float32)


def _error(source: ViewSource) -> Uniforms | None:
    """Return the uniforms of the error of irradiance against the reference, in the colours of `irrsplat verify`."""
    reference = source.reference
    if reference is None:
        return None
    bright, dark, grey = (np.array(colour) / 255.0 for colour in (BRIGHT, DARK, GREY))
    ends = {"full": reference.full, "bright": bright, "dark": dark, "unseen": grey}
    return {"values": source.view.sums, "reference": reference.values, **ends}


def _error_legend(source: ViewSource) -> Legend:
    reference = source.reference
    assert reference is not None
    text = f"mean of the channels; in full colour at {100.0 * FULL:g} % of the reference's mean; grey: no surface"
    colours = error_colours(np.linspace(-1.0, 1.0, 64))
    return Legend(f"{text}; {reference.about}", f"{-reference.full:.3g}", f"{reference.full:.3g}", "W/m²", colours)


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


def _weight(source: ViewSource) -> Uniforms:
    """Return the uniforms of the sum of weights Σw on a logarithmic scale, with the contour of the threshold."""
    low, high = weight_range(source.renderer.settings)
    return {"values": source.view.splats.weight, "low": low, "high": high, "threshold": source.renderer.settings.threshold}


def _weight_legend(source: ViewSource) -> Legend:
    (low, high), threshold = weight_range(source.renderer.settings), source.renderer.settings.threshold
    mark = float(np.log(threshold / low) / np.log(high / low)) if threshold > 0.0 else None
    text = f"logarithmic; the line is the tolerance {threshold:.3g}, black on the side that requests records"
    return Legend(text, f"{low:.3g}", f"{high:.3g}", "", colour_map(), mark)


def _requests(source: ViewSource) -> Uniforms:
    splats, settings = source.view.splats, source.renderer.settings
    limits = {"tolerance": settings.threshold, "spread": settings.spread, "luminance_floor": splats.luminance_floor}
    return {"values": splats.weight, "image": source.view.image, "gain": source.gain, "sums": splats.sums, **limits}


def _requests_legend(source: ViewSource) -> Legend:
    settings = source.renderer.settings
    variance = f", or whose records differ by {100.0 * settings.spread:.3g} %" if settings.spread else ""
    return Legend(f"orange: pixels with Σw below {settings.threshold:.3g}{variance}")


# ---- the surface that a pixel sees -------------------------------------------------------------------------------------


def _normal(name: str, title: str, texture: Callable[[View], moderngl.Texture]) -> ShownBuffer:
    """Return a buffer of unit vectors: x, y and z from -1 to 1 as red, green and blue."""
    ends, legend = {"low": np.full(3, -1.0), "high": np.ones(3)}, Legend("x y z as red, green, blue", "-1", "1")
    uniforms = lambda source: {"values": texture(source.view), **ends}  # noqa: E731
    return _channel(name, "range", uniforms, described=lambda source: legend, title=title)


def _position(source: ViewSource) -> Uniforms:
    low, high = source.renderer.scene.bounds
    return {"values": source.view.gbuffer.position, "low": low, "high": np.where(high > low, high, low + 1.0)}


def _position_legend(source: ViewSource) -> Legend:
    form = ".2f" if any(source.origin) else ".3g"
    low, high = (" ".join(f"{v:{form}}" for v in end) for end in source.renderer.scene.bounds + source.origin)
    return Legend("x y z as red, green, blue within the scene's bounds", low, high, CHANNELS["position"].unit)


def _depth(source: ViewSource) -> Uniforms:
    low, high = _depth_range(source.renderer.scene, source.view.camera)
    return {"values": source.view.gbuffer.position, "low": low, "high": high}


def _depth_legend(source: ViewSource) -> Legend:
    low, high = _depth_range(source.renderer.scene, source.view.camera)
    return Legend("distance along the view axis", f"{low:.3g}", f"{high:.3g}", CHANNELS["depth"].unit, colour_map())


def _read_depth(uniforms: Uniforms, x: int, y: int) -> np.ndarray:
    return np.array([texel(uniforms["values"], x, y)[3] or np.inf], "f4")


def _depth_range(scene: Scene, camera: Camera) -> tuple[float, float]:
    """Return the least and the greatest distance along the view axis, in metres, within the scene's bounds."""
    along = (scene.corners - np.asarray(camera.eye)) @ -camera.axes[2]
    low, high = max(float(along.min()), 0.0), float(along.max())
    return low, high if high > low else low + scene.diagonal


# ---- tiles -------------------------------------------------------------------------------------------------------------


def atlas_tiles(atlas: Atlas, renderer: Renderer, gain: float) -> Uniforms:
    """Return the uniforms of an atlas, radiance times `gain`. A texel whose ray misses all surfaces shows the sky."""
    cells = {"count": atlas.count, "cell": atlas.cell, "columns": atlas.columns}
    textures = {"radiance": atlas.radiance, "table": atlas.table, "frames": atlas.frames}
    return {**cells, **textures, "gain": gain, **sky_uniforms(renderer.scene, sky_maps(renderer.world))}


def _atlas(source: ViewSource) -> Uniforms | None:
    atlas = source.renderer.scheduler.gatherer.atlas
    return None if atlas is None else atlas_tiles(atlas, source.renderer, source.gain)


def _shadow(source: ViewSource) -> Uniforms | None:
    shadows = source.renderer.shadows
    if shadows is None:
        return None
    side, columns, _ = shadows.layout
    count = int(shadows.table.reshape(-1, 8, 4)[:, 1, 3].round().sum())  # see shaders/lighting/lights.glsl
    return {"count": count, "cell": (side, side), "columns": int(columns), "shadow_depth": shadows.depth}


def _shadow_legend(source: ViewSource) -> Legend:
    if source.renderer.shadows is None or not source.renderer.scene.lights:
        return Legend("no light casts shadows here")
    return Legend("distance from the light / depth of the map; black: nothing", "0", "1", "", colour_map())


# In the order of the menu; the first twelve have the keys 1 to 9, 0, - and =.
BUFFERS: dict[str, ShownBuffer] = {
    buffer.name: buffer
    for buffer in (
        _channel("image", "image", _image, described=_exposed(CHANNELS["image"].unit), everywhere=True),
        _channel("direct", "radiance", lambda s: _radiance(s, s.view.direct, True), described=_exposed(CHANNELS["direct"].unit)),
        _channel("indirect", "indirect", _indirect, described=_exposed(CHANNELS["indirect"].unit), read=_read_indirect),
        _channel("irradiance", "irradiance", lambda s: _irradiance(s, s.view.sums), described=_white(), read=_mean),
        _channel("weight", "weight", _weight, described=_weight_legend, read=first(1)),
        _channel("position", "range", _position, described=_position_legend),
        _normal("normal", "normal", lambda view: view.gbuffer.lit_normal),
        _channel(
            "albedo",
            "unit",
            lambda source: {"values": source.view.gbuffer.albedo, "grey": False},
            described=lambda source: Legend("reflectance, sRGB encoded", "0", "1"),
        ),
        _channel("depth", "depth", _depth, described=_depth_legend, read=_read_depth, everywhere=True),
        ShownBuffer(
            "requests", "requests", "pixels that request a record", "requests", _requests, _requests_legend, read=first(1)
        ),
        ShownBuffer(
            "shadow",
            "shadow maps",
            "every light's shadow maps: distance from the light along each one's axis",
            "shadow_maps",
            _shadow,
            _shadow_legend,
            in_view=False,
        ),
        ShownBuffer(
            "atlas",
            "gather atlas",
            "what the records of the last batch saw, a hemisphere each",
            "gather_atlas",
            _atlas,
            _exposed("W/(m² sr)"),
            in_view=False,
        ),
        ShownBuffer(
            "light",
            "light (false colours)",
            "all light that falls on surfaces, in lux, with isolines",
            "light",
            _light,
            _light_legend,
            _read_light,
        ),
        _channel(  # the mean over a pixel's samples; with one sample at its centre, the emission of the surface or the backdrop
            "emission",
            "radiance",
            lambda s: _radiance(s, s.view.emission or s.view.gbuffer.emission, s.view.emission is not None),
            described=_exposed(CHANNELS["emission"].unit),
        ),
        _normal("smooth_normal", "smooth normal", lambda view: view.gbuffer.normal),
        ShownBuffer(
            "surface",
            "surface cache",
            "irradiance of all bounces but the last, as gathers look it up",
            "irradiance",
            lambda source: _irradiance(source, source.renderer.scheduler.gatherer.surface_at(source.view.gbuffer)),
            _white(),
            _mean_if_any,
            missing="no surface cache: it is made for more than one bounce",
        ),
        _channel(
            "alpha",
            "unit",
            lambda source: {"values": source.view.alpha, "grey": True},
            described=lambda source: Legend("share of the pixel", "0", "1"),
            read=first(1),
            everywhere=True,
        ),
        ShownBuffer(
            "reference",
            "reference",
            "path-traced irradiance",
            "irradiance",
            lambda source: _irradiance(source, None if source.reference is None else source.reference.values),
            _white(lambda source: "" if source.reference is None else f"; {source.reference.about}"),
            _mean_if_any,
            missing=NO_REFERENCE,
        ),
        ShownBuffer(
            "error",
            "error",
            "irradiance minus the path-traced reference",
            "error",
            _error,
            _error_legend,
            _read_error,
            everywhere=True,
            missing=NO_REFERENCE,
        ),
    )
}
