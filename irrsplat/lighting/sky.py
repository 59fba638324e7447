"""Textures and uniforms of the sky."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.world import World
from irrsplat.scene.model import Scene
from irrsplat.sky.environment import Environment


class SkyMaps(Owner):
    """Maps of an environment as textures: `light` for rays, `seen` for the camera."""

    def __init__(self, ctx: moderngl.Context, environment: Environment) -> None:
        self.light = self.own(_texture(ctx, environment.light_levels))
        self.seen = self.own(_texture(ctx, [level[::-1] for level in environment.seen_levels]))
        self.seen.repeat_x = True
        self.uniforms: Uniforms = {"sky_light": self.light, "sky_from_world": environment.frame}


def sky_maps(world: World) -> SkyMaps | None:
    """Return the maps of the world's sky, cached by the world; None for a sky without environment."""
    environment = world.scene.environment
    if environment is None:
        return None
    return world.derived.get("sky", environment, lambda: SkyMaps(world.ctx, environment))


def sky_uniforms(scene: Scene, maps: SkyMaps | None = None) -> Uniforms:
    """Return the uniforms of shaders/lighting/sky.glsl: radiance from the unit direction d is sky + sky_gradient·dot(d, sky_up).

    maps: of the scene's sky; then the uniforms for SKY_MAP.
    """
    if maps is not None:
        return maps.uniforms
    return {"sky": scene.sky, "sky_gradient": scene.sky_gradient, "sky_up": scene.up}


def sky_defines(uniforms: Uniforms) -> dict[str, int]:
    """Return the defines of shaders that use these uniforms of shaders/lighting/sky.glsl."""
    return {"SKY_MAP": int("sky_light" in uniforms)}


def _texture(ctx: moderngl.Context, levels: list[np.ndarray]) -> moderngl.Texture:
    """Return a float texture of a pyramid's levels, (H, W, 3) each, bottom row first, clamped to its edges."""
    height, width = levels[0].shape[:2]
    texture = ctx.texture((width, height), 3, dtype="f4")
    if len(levels) > 1:
        texture.build_mipmaps(max_level=len(levels) - 1)  # allocates the levels
    for number, level in enumerate(levels):
        texture.write(np.ascontiguousarray(level, "f4").tobytes(), level=number)
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR if len(levels) > 1 else moderngl.LINEAR), moderngl.LINEAR
    texture.repeat_x = texture.repeat_y = False
    return texture
