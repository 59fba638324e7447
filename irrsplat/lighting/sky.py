"""The sky as shaders have it."""

from __future__ import annotations

from irrsplat.core.buffers import Uniforms
from irrsplat.scene.model import Scene


def sky_uniforms(scene: Scene) -> Uniforms:
    """The uniforms of shaders/lighting/sky.glsl: what comes from the unit direction d is sky + sky_gradient·dot(d, sky_up)."""
    return {"sky": scene.sky, "sky_gradient": scene.sky_gradient, "sky_up": scene.up}
