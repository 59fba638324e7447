"""The kinds of buffers: textures of the view or derived from them, with pictures, legends, and values at a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.app.viewer.buffers.shown_buffer import (
    GROUND,
    Canvas,
    Identity,
    Legend,
    ShownBuffer,
    Uniform,
    ViewSource,
    colour_map,
)
from irrsplat.app.viewer.show.screen import texel
from irrsplat.core.buffers import CHANNELS, Atlas, Uniforms
from irrsplat.image.view import View
from irrsplat.lighting.sky import sky_defines, sky_maps, sky_uniforms
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings

Texture = Callable[[View], moderngl.Texture]
NO_REFERENCE = "no reference of this view yet; Y traces it"
_DECADES = 50.0  # the upper end of the scale of weights is this factor above 1/a: Σw is 0, or at least 1/a


def about(name: str, title: str = "") -> tuple[str, str, str]:
    """Return name, title (default: the name) and help of an image channel. Files hold these channels, too."""
    return name, title or name, CHANNELS[name].help


def exposed(unit: str, words: str = "") -> Callable[[ViewSource], Legend]:
    """Return the legend of a buffer that has the exposure of the picture."""
    return lambda source: Legend(f"{unit}, exposed by {source.exposure:+.1f} stops{words}", unit=unit)


def first(texture: Texture, components: int = 3) -> Callable[[ViewSource, int, int], np.ndarray]:
    """Return a function that reads the first components of a texel."""
    return lambda source, x, y: texel(texture(source.view), x, y)[:components]


def mean_of(sums: np.ndarray) -> np.ndarray:
    """Return (3,) Σ k·E / Σ k of a texel; 0 for Σ k = 0."""
    mean: np.ndarray = sums[:3] / (sums[3] if sums[3] > 0.0 else np.float32(1.0))
    return mean


def irradiance_at(view: View, x: int, y: int) -> np.ndarray:
    """Return (3,) the picture's indirect irradiance in W/m² at pixel (x, y) of the view; 0 if no record contributes."""
    return mean_of(texel(view.sums, x, y))


# ---- radiance ----------------------------------------------------------------------------------------------------------


def radiance(name: str, texture: Texture, covers_unseen: Callable[[View], bool] = lambda view: True) -> ShownBuffer:
    """Show radiance with the exposure and the tone mapping of the picture.

    covers_unseen: a call that returns True if the texture also covers pixels without a surface. Else they show the backdrop.
    """

    def draw(canvas: Canvas, source: ViewSource) -> None:
        view = source.view
        behind = view.backdrop.uniforms(view.camera, view.image.size)
        canvas.picture(source, "radiance", texture(view), covers_unseen=covers_unseen(view), gain=source.gain, **behind)

    return ShownBuffer(*about(name), draw, exposed(CHANNELS[name].unit), first(texture))


def image() -> ShownBuffer:
    """Show the picture in front of its backdrop."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        view = source.view
        lower, upper = view.backdrop.ends
        plain = view.backdrop.kind == "sky"
        canvas.picture(source, "image", view.image, alpha=view.alpha, plain=plain, lower=lower, upper=upper, gain=source.gain)

    legend = exposed(CHANNELS["image"].unit)
    return ShownBuffer(*about("image"), draw, legend, first(lambda view: view.image), everywhere=True)


def indirect() -> ShownBuffer:
    """Show indirect radiance: the mean over a pixel's samples; with one sample at its centre, albedo/π times the irradiance."""
    mean = radiance("indirect", lambda view: view.indirect or view.sums)

    def draw(canvas: Canvas, source: ViewSource) -> None:
        view = source.view
        if view.indirect is not None:
            mean.draw(canvas, source)
        else:
            canvas.picture(source, "indirect", view.sums, albedo=view.gbuffer.albedo, gain=source.gain)

    def read(source: ViewSource, x: int, y: int) -> np.ndarray | None:
        view = source.view
        if view.indirect is not None:
            return mean.read(source, x, y)
        found: np.ndarray = irradiance_at(view, x, y) * texel(view.gbuffer.albedo, x, y)[:3] / np.float32(np.pi)
        return found

    return replace(mean, draw=draw, read=read)


# ---- light -------------------------------------------------------------------------------------------------------------


def irradiance(
    name: str,
    title: str,
    words: str,
    texture: Callable[[ViewSource], moderngl.Texture | None] = lambda source: source.view.sums,
    missing: str = "",
    state: Callable[[ViewSource], object] = lambda source: None,
    more: Callable[[ViewSource], str] = lambda source: "",
    needs_reference: bool = False,
) -> ShownBuffer:
    """Show irradiance as the radiance of a white surface, so that it compares with the picture.

    texture: a call that returns the texture of Σ k·E and Σ k, or None before it is made; the legend is then `missing`. more: a
    call that returns further words for the legend.
    """

    def draw(canvas: Canvas, source: ViewSource) -> None:
        found = texture(source)
        if found is None:
            canvas.blank()
        else:
            canvas.picture(source, "irradiance", found, gain=source.gain)

    def legend(source: ViewSource) -> Legend:
        if texture(source) is None:
            return Legend(missing)
        return exposed("W/m²", f", as reflected by a white surface{more(source)}")(source)

    def read(source: ViewSource, x: int, y: int) -> np.ndarray | None:
        found = texture(source)
        sums = None if found is None else texel(found, x, y)
        return None if sums is None or (sums[3] == 0.0 and missing) else mean_of(sums)

    return ShownBuffer(name, title, words, draw, legend, read, needs_reference=needs_reference, state=state)


def light() -> ShownBuffer:
    """Show illuminance by the user's scale, independently of the surface's reflectance."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        scale, (low, high) = source.light_scale, source.light_scale.ends
        canvas.picture(
            source,
            "light",
            source.view.sums,
            direct=source.renderer.direct_irradiance(source.view),
            weights=scale.weights,
            low=low,
            high=high,
            steps=float(STEPS) if scale.lines else 0.0,
            ground=GROUND,
            palette=false_colours(),
        )

    def legend(source: ViewSource) -> Legend:
        scale, (low, high) = source.light_scale, source.light_scale.ends
        lines = f"a line every {(high - low) / STEPS:.4g} {scale.shown_unit}"
        return Legend(lines, f"{low:.4g}", f"{high:.4g}", scale.shown_unit, false_colours())

    def read(source: ViewSource, x: int, y: int) -> np.ndarray:
        direct = texel(source.renderer.direct_irradiance(source.view), x, y)[:3]
        return np.array([(direct + irradiance_at(source.view, x, y)) @ source.light_scale.weights], np.float32)

    words = "all light that falls on surfaces, in lux, with isolines"
    return ShownBuffer("light", "light (false colours)", words, draw, legend, read, state=lambda source: source.light_scale)


def error() -> ShownBuffer:
    """Show the error of irradiance against the reference, in the colours of `irrsplat verify`."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        reference = source.reference
        if reference is None:
            return canvas.blank()
        bright, dark, grey = (np.array(colour) / 255.0 for colour in (BRIGHT, DARK, GREY))
        ends: dict[str, Uniform] = {"full": reference.full, "bright": bright, "dark": dark, "unseen": grey}
        canvas.picture(source, "error", source.view.sums, reference=reference.values, **ends)

    def legend(source: ViewSource) -> Legend:
        reference = source.reference
        if reference is None:
            return Legend(NO_REFERENCE)
        text = f"mean of the channels; in full colour at {100.0 * FULL:g} % of the reference's mean; grey: no surface"
        colours = error_colours(np.linspace(-1.0, 1.0, 64))
        return Legend(f"{text}; {reference.about}", f"{-reference.full:.3g}", f"{reference.full:.3g}", "W/m²", colours)

    def read(source: ViewSource, x: int, y: int) -> np.ndarray | None:
        found = None if source.reference is None else texel(source.reference.values, x, y)
        if found is None or found[3] == 0.0:
            return None
        off: np.ndarray = np.mean(irradiance_at(source.view, x, y) - found[:3], keepdims=True)
        return off

    words, state = "irradiance minus the path-traced reference", lambda source: Identity(source.reference)
    return ShownBuffer("error", "error", words, draw, legend, read, everywhere=True, needs_reference=True, state=state)


# ---- weights -----------------------------------------------------------------------------------------------------------


def weight() -> ShownBuffer:
    """Show the sum of weights Σw on a logarithmic scale, with the contour of the threshold."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        low, high = weight_range(source.settings)
        canvas.picture(source, "weight", source.view.splats.weight, low=low, high=high, threshold=source.settings.threshold)

    def legend(source: ViewSource) -> Legend:
        low, high = weight_range(source.settings)
        threshold = source.settings.threshold
        mark = float(np.log(threshold / low) / np.log(high / low)) if threshold > 0.0 else None
        text = f"logarithmic; the line is the tolerance {threshold:.3g}, black on the side that requests records"
        return Legend(text, f"{low:.3g}", f"{high:.3g}", "", colour_map(), mark)

    return ShownBuffer(*about("weight"), draw, legend, first(lambda view: view.splats.weight, 1))


def requests() -> ShownBuffer:
    """Show the pixels that request a record in orange over the dim picture. The value is Σw."""

    def legend(source: ViewSource) -> Legend:
        settings = source.settings
        variance = f", or whose records differ by {100.0 * settings.spread:.3g} %" if settings.spread else ""
        return Legend(f"orange: pixels with Σw below {settings.threshold:.3g}{variance}")

    def draw(canvas: Canvas, source: ViewSource) -> None:
        """Draw the picture dim and grey, and over it in orange the pixels that request a record."""
        splats, settings = source.view.splats, source.settings
        canvas.picture(
            source,
            "requests",
            splats.weight,
            image=source.view.image,
            gain=source.gain,
            sums=splats.sums,
            tolerance=settings.threshold,
            spread=settings.spread,
            luminance_floor=splats.luminance_floor,
        )

    read = first(lambda view: view.splats.weight, 1)
    return ShownBuffer("requests", "requests", "pixels that request a record", draw, legend, read)


def weight_range(settings: Settings) -> tuple[float, float]:
    """Return the ends of the logarithmic scale of Σw. The threshold lies between them."""
    least, threshold = 1.0 / settings.a, settings.threshold
    low, high = 0.5 * least, _DECADES * least
    return (min(low, 0.5 * threshold) if threshold > 0.0 else low), max(high, 2.0 * threshold)


# ---- the surface that a pixel sees -------------------------------------------------------------------------------------


def share(name: str, texture: Texture, text: str, components: int = 3, everywhere: bool = False) -> ShownBuffer:
    """Show values 0..1, sRGB encoded. text: the text of the legend. everywhere: see ShownBuffer."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        canvas.picture(source, "unit", texture(source.view), grey=components == 1)

    return ShownBuffer(*about(name), draw, lambda source: Legend(text, "0", "1"), first(texture, components), everywhere)


def normal(name: str, title: str, texture: Texture) -> ShownBuffer:
    """Show unit vectors: x, y and z from -1 to 1 as red, green and blue."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        canvas.picture(source, "range", texture(source.view), low=np.full(3, -1.0), high=np.ones(3))

    return ShownBuffer(*about(name, title), draw, lambda source: Legend("x y z as red, green, blue", "-1", "1"), first(texture))


def position() -> ShownBuffer:
    """Show positions: x, y and z within the bounds of the scene as red, green and blue."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        low, high = source.scene.bounds
        canvas.picture(source, "range", source.view.gbuffer.position, low=low, high=np.where(high > low, high, low + 1.0))

    def legend(source: ViewSource) -> Legend:
        form = ".2f" if any(source.origin) else ".3g"
        low, high = (" ".join(f"{v:{form}}" for v in end) for end in source.scene.bounds + source.origin)
        return Legend("x y z as red, green, blue within the scene's bounds", low, high, CHANNELS["position"].unit)

    return ShownBuffer(*about("position"), draw, legend, first(lambda view: view.gbuffer.position))


def depth() -> ShownBuffer:
    """Show the distance along the view axis, the fourth component of the position's texels, in metres."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        low, high = _depth_range(source.scene, source.view.camera)
        canvas.picture(source, "depth", source.view.gbuffer.position, low=low, high=high)

    def legend(source: ViewSource) -> Legend:
        low, high = _depth_range(source.scene, source.view.camera)
        return Legend("distance along the view axis", f"{low:.3g}", f"{high:.3g}", CHANNELS["depth"].unit, colour_map())

    def read(source: ViewSource, x: int, y: int) -> np.ndarray:
        return np.array([texel(source.view.gbuffer.position, x, y)[3] or np.inf], "f4")

    return ShownBuffer(*about("depth"), draw, legend, read, everywhere=True)


def _depth_range(scene: Scene, camera: Camera) -> tuple[float, float]:
    """Return the least and the greatest distance along the view axis, in metres, within the scene's bounds."""
    along = (scene.corners - np.asarray(camera.eye)) @ -camera.axes[2]
    low, high = max(float(along.min()), 0.0), float(along.max())
    return low, high if high > low else low + scene.diagonal


_GAP = 2.0  # pixels between tiles


def tile_uniforms(size: tuple[int, int], count: int, cell: tuple[float, float], columns: int) -> dict[str, Any]:
    """Return the uniforms of tiles.glsl for `count` tiles of `cell` texels, as large as possible and centred in a target.

    size: of the target in pixels. columns: tiles per row of the texture.
    """
    per_row = np.arange(1, max(count, 1) + 1)
    rows = -(-max(count, 1) // per_row)
    pixels = np.minimum((size[0] - _GAP * (per_row - 1)) / (per_row * cell[0]), (size[1] - _GAP * (rows - 1)) / (rows * cell[1]))
    best = int(np.argmax(pixels))
    scale = max(float(pixels[best]), 1.0 / max(cell))  # pixels per texel
    width, height = (float(n[best]) * (c * scale + _GAP) - _GAP for n, c in ((per_row, cell[0]), (rows, cell[1])))
    place = (size[0] - width) / 2.0, (size[1] + height) / 2.0, 1.0 / scale, _GAP
    return {"cell": cell, "columns": columns, "count": count, "place": place, "across": int(per_row[best]), "ground": GROUND}


def draw_atlas(canvas: Canvas, atlas: Atlas, gain: float, sky: Uniforms) -> None:
    """Draw the cells of an atlas, radiance times `gain`. A texel whose ray misses all surfaces shows the sky.

    sky: the uniforms of shaders/lighting/sky.glsl.
    """
    canvas.programs("viewer/buffers/gather_atlas", defines=sky_defines(sky))(
        canvas.target,
        scissor=canvas.region,
        radiance=atlas.radiance,
        gain=gain,
        table=atlas.table,
        frames=atlas.frames,
        **tile_uniforms(canvas.target.size, atlas.count, atlas.cell, atlas.columns),
        **sky,
    )


def gather_atlas() -> ShownBuffer:
    """Show the hemispheres of the records of the last batch."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        atlas = source.renderer.scheduler.gatherer.atlas
        if atlas is None:
            canvas.blank()
        else:
            draw_atlas(canvas, atlas, source.gain, sky_uniforms(source.scene, sky_maps(source.renderer.world)))

    words, legend = "what the records of the last batch saw, a hemisphere each", exposed("W/(m² sr)")
    state = lambda source: Identity(source.renderer.scheduler.gatherer.atlas)  # noqa: E731
    return ShownBuffer("atlas", "gather atlas", words, draw, legend, in_view=False, state=state)


def shadow_maps() -> ShownBuffer:
    """Show the shadow maps of all lights."""

    def draw(canvas: Canvas, source: ViewSource) -> None:
        shadows = source.renderer.shadows
        if shadows is None:
            return canvas.blank()
        side, columns, _ = shadows.layout
        count = int(shadows.table.reshape(-1, 8, 4)[:, 1, 3].round().sum())  # see shaders/lighting/lights.glsl
        canvas.programs("viewer/buffers/shadow_maps")(
            canvas.target,
            scissor=canvas.region,
            shadow_depth=shadows.depth,
            colours=canvas.programs.colours,
            **tile_uniforms(canvas.target.size, count, (side, side), int(columns)),
        )

    def legend(source: ViewSource) -> Legend:
        if source.renderer.shadows is None or not source.scene.lights:
            return Legend("no light casts shadows here")
        return Legend("distance from the light / depth of the map; black: nothing", "0", "1", "", colour_map())

    words = "every light's shadow maps: distance from the light along each one's axis"
    state = lambda source: Identity(source.renderer.shadows)  # noqa: E731
    return ShownBuffer("shadow", "shadow maps", words, draw, legend, in_view=False, state=state)
