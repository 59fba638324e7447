"""The table of all buffers that the viewer can show: its keys, menu, legends, values and help come from here.

A further buffer is one more entry: of a class in texture_buffers.py where it is a texture of the view, else of a class of its own
(with its shader, where none of those in shaders/viewer/buffers/ will do).
"""

from __future__ import annotations

from irrsplat.app.viewer.buffers.light_buffers import NO_REFERENCE, AskingBuffer, ErrorBuffer, LightBuffer, WeightBuffer
from irrsplat.app.viewer.buffers.shown_buffer import Identity, ShownBuffer, ViewSource
from irrsplat.app.viewer.buffers.texture_buffers import (
    DepthBuffer,
    ImageBuffer,
    IndirectBuffer,
    IrradianceBuffer,
    RadianceBuffer,
    ShareBuffer,
    VectorBuffer,
)
from irrsplat.app.viewer.buffers.tiled_buffers import GatherAtlasBuffer, ShadowMapsBuffer
from irrsplat.core.buffers import CHANNELS


def _channel(name: str, title: str = "") -> tuple[str, str, str, str]:
    """Name, title (default: the name), unit and help of an image channel, which files hold too."""
    return name, title or name, CHANNELS[name].unit, CHANNELS[name].help


def _surface_cache(source: ViewSource) -> object:
    surface = source.renderer.scheduler.gatherer.surface_now
    return None if surface is None else Identity(surface.result)


# In the order of the menu; the first twelve have the keys 1 to 9, 0, - and =.
BUFFERS: dict[str, ShownBuffer] = {
    buffer.name: buffer
    for buffer in (
        ImageBuffer(*_channel("image"), texture=lambda view: view.image, everywhere=True),
        RadianceBuffer(*_channel("direct"), texture=lambda view: view.direct),
        IndirectBuffer(*_channel("indirect"), texture=lambda view: view.indirect or view.sums),
        IrradianceBuffer(*_channel("irradiance")),
        WeightBuffer(*_channel("weight"), texture=lambda view: view.splats.weight, components=1),
        VectorBuffer(
            *_channel("position"),
            texture=lambda view: view.gbuffer.position,
            ends=lambda scene: scene.bounds,
            note=" within the scene's bounds",
        ),
        VectorBuffer(*_channel("normal"), texture=lambda view: view.gbuffer.lit_normal),
        ShareBuffer(*_channel("albedo"), texture=lambda view: view.gbuffer.albedo, text="reflectance, sRGB encoded"),
        DepthBuffer(*_channel("depth"), texture=lambda view: view.gbuffer.position),
        AskingBuffer(
            "asking", "requests", "", "pixels that request a record", texture=lambda view: view.splats.weight, components=1
        ),
        ShadowMapsBuffer(
            "shadow", "shadow maps", "1", "every light's shadow maps: distance from the light along each one's axis"
        ),
        GatherAtlasBuffer("atlas", "gather atlas", "W/(m² sr)", "what the records of the last batch saw, a hemisphere each"),
        LightBuffer("light", "light (false colours)", "lux", "all light that falls on surfaces, in lux or W/m², with isolines"),
        RadianceBuffer(  # the mean of a pixel's samples, or, of the one at its centre, the surface's or the backdrop's
            *_channel("emission"),
            texture=lambda view: view.emission or view.gbuffer.emission,
            covers_unseen=lambda view: view.emission is not None,
        ),
        VectorBuffer(*_channel("smooth_normal", "smooth normal"), texture=lambda view: view.gbuffer.normal),
        IrradianceBuffer(
            "surface",
            "surface cache",
            "W/m²",
            "irradiance of all bounces but the last, as gathers look it up",
            texture=lambda source: source.renderer.scheduler.gatherer.surface_at(source.view.gbuffer),
            missing="no surface cache: it is made for more than one bounce",
            state=_surface_cache,
        ),
        ShareBuffer(*_channel("alpha"), texture=lambda view: view.alpha, components=1, everywhere=True),
        IrradianceBuffer(
            "reference",
            "reference",
            "W/m²",
            "path-traced irradiance",
            texture=lambda source: None if source.reference is None else source.reference.values,
            missing=NO_REFERENCE,
            state=lambda source: Identity(source.reference),
            about=lambda source: "" if source.reference is None else f"; {source.reference.about}",
            needs_reference=True,
        ),
        ErrorBuffer("error", "error", "W/m²", "irradiance minus the path-traced reference"),
    )
}
