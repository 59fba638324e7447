"""The table of all buffers that the viewer can show. Their keys, menu, legends, values and help result from it.

A further buffer is one more entry: of a kind in kinds.py, or of a new kind. A new kind may need a new shader in
shaders/viewer/buffers/.
"""

from __future__ import annotations

from irrsplat.app.viewer.buffers import kinds
from irrsplat.app.viewer.buffers.shown_buffer import Identity, ShownBuffer, ViewSource


def _surface_cache(source: ViewSource) -> object:
    surface = source.renderer.scheduler.gatherer.surface_now
    return None if surface is None else Identity(surface.result)


# In the order of the menu; the first twelve have the keys 1 to 9, 0, - and =.
BUFFERS: dict[str, ShownBuffer] = {
    buffer.name: buffer
    for buffer in (
        kinds.image(),
        kinds.radiance("direct", lambda view: view.direct),
        kinds.indirect(),
        kinds.irradiance(*kinds.about("irradiance")),
        kinds.weight(),
        kinds.position(),
        kinds.normal("normal", "normal", lambda view: view.gbuffer.lit_normal),
        kinds.share("albedo", lambda view: view.gbuffer.albedo, "reflectance, sRGB encoded"),
        kinds.depth(),
        kinds.requests(),
        kinds.shadow_maps(),
        kinds.gather_atlas(),
        kinds.light(),
        # the mean over a pixel's samples; with one sample at its centre, the emission of the surface or the backdrop there
        kinds.radiance("emission", lambda view: view.emission or view.gbuffer.emission, lambda view: view.emission is not None),
        kinds.normal("smooth_normal", "smooth normal", lambda view: view.gbuffer.normal),
        kinds.irradiance(
            "surface",
            "surface cache",
            "irradiance of all bounces but the last, as gathers look it up",
            lambda source: source.renderer.scheduler.gatherer.surface_at(source.view.gbuffer),
            "no surface cache: it is made for more than one bounce",
            _surface_cache,
        ),
        kinds.share("alpha", lambda view: view.alpha, "share of the pixel", components=1, everywhere=True),
        kinds.irradiance(
            "reference",
            "reference",
            "path-traced irradiance",
            lambda source: None if source.reference is None else source.reference.values,
            kinds.NO_REFERENCE,
            lambda source: Identity(source.reference),
            lambda source: "" if source.reference is None else f"; {source.reference.about}",
            needs_reference=True,
        ),
        kinds.error(),
    )
}
