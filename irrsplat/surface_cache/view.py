"""Irradiance of the surface cache at each pixel of a view, and at other points."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Sites, Uniforms
from irrsplat.core.vectors import octahedral_encode
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, table_texture
from irrsplat.gpu.texel_table import table_rows


class SurfaceViewPass(Owner):
    """Pass that interpolates the surface cache at pixels."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.program = self.own(Program(ctx, "surface_cache/view", "lib/fullscreen"))
        self.targets = self.own(Workshop())

    def __call__(self, gbuffer: GBuffer, surface: Uniforms, target: str = "view") -> moderngl.Texture:
        """Return the RGBA32F texture of indirect irradiance in W/m²; a: 1 on a surface, else 0. It belongs to this pass.

        surface: the cache's uniforms for triangles numbered as in the scene. target: each of these keeps its last result.
        """
        g, size = gbuffer, gbuffer.position.size
        drawn = self.targets.get(target, size, lambda: Target(self.ctx, size, (4,)))
        self.program(drawn, position=g.position, normal=g.normal, albedo=g.albedo, emission=g.emission, **surface)
        return drawn.textures[0]

    def at(self, sites: Sites, surface: Uniforms) -> np.ndarray:
        """Return (N, 3) indirect irradiance at `sites`, W/m²; the sites must have triangles."""
        assert sites.triangle is not None
        x, y = octahedral_encode(sites.geometric)
        parts = (sites.position, np.ones(len(sites))), (sites.normal, x), (np.zeros((len(sites), 3)), y)
        columns = [*parts, (np.zeros((len(sites), 3)), sites.triangle)]
        textures = [table_texture(self.ctx, table_rows(np.column_stack(one)[:, None].astype("f4"))) for one in columns]
        drawn = self(GBuffer(textures[0], textures[1], textures[2], textures[3]), surface, "points")
        found = np.frombuffer(drawn.read(), "f4").reshape(-1, 4)[: len(sites), :3]
        for texture in textures:
            texture.release()
        return found
