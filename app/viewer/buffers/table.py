"""The table of all buffers that the viewer can show: its keys, menu, legends, values and help come from here.

A further buffer is one more entry: of a class in texture_buffers.py where it is a texture of the view, else of a class of its own
(with its shader, where none of those in shaders/viewer/buffers/ will do).
"""

from __future__ import annotations

from irrsplat.app.viewer.buffers.light import LightBuffer
from irrsplat.app.viewer.buffers.reference import ErrorBuffer, ReferenceBuffer
from irrsplat.app.viewer.buffers.shown_buffer import ShownBuffer
from irrsplat.app.viewer.buffers.texture_buffers import (
    DepthBuffer,
    EmissionBuffer,
    ImageBuffer,
    IndirectBuffer,
    IrradianceBuffer,
    RadianceBuffer,
    ShareBuffer,
    SurfaceCacheBuffer,
    VectorBuffer,
)
from irrsplat.app.viewer.buffers.tiled_buffers import GatherAtlasBuffer, ShadowMapsBuffer
from irrsplat.app.viewer.buffers.weight import AskingBuffer, WeightBuffer
from irrsplat.core.buffers import CHANNELS


def _channel(name: str, title: str = "") -> tuple[str, str, str, str]:
    """Name, title (default: the name), unit and help of an image channel, which files hold too."""
    return name, title or name, CHANNELS[name].unit, CHANNELS[name].help


# In the order of the menu; the first twelve have the keys 1 to 9, 0, - and =.
BUFFERS: dict[str, ShownBuffer] = {
    buffer.name: buffer
    for buffer in (
        ImageBuffer(*_channel("image"), texture=lambda view: view.image, everywhere=True),
        RadianceBuffer(*_channel("direct"), texture=lambda view: view.direct),
        IndirectBuffer(*_channel("indirect"), texture=lambda view: view.indirect or view.sums),
        IrradianceBuffer(*_channel("irradiance"), texture=lambda view: view.sums),
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
        EmissionBuffer(*_channel("emission"), texture=lambda view: view.emission or view.gbuffer.emission),
        VectorBuffer(*_channel("smooth_normal", "smooth normal"), texture=lambda view: view.gbuffer.normal),
        SurfaceCacheBuffer("surface", "surface cache", "W/m²", "irradiance of all bounces but the last, as gathers look it up"),
        ShareBuffer(*_channel("alpha"), texture=lambda view: view.alpha, components=1, everywhere=True),
        ReferenceBuffer("reference", "reference", "W/m²", "path-traced irradiance"),
        ErrorBuffer("error", "error", "W/m²", "irradiance minus the path-traced reference"),
    )
}
