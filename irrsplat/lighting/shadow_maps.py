"""Shadow maps: depth of the scene from every light, as tiles of one depth texture (Jones 2010, section 3.3)."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from irrsplat.core.buffers import ShadowMaps
from irrsplat.gpu.program import Draw, DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, float_texture
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import focus_of, light_table, near_plane, sheet, tile_count
from irrsplat.lighting.luminaire_table import luminaire_rows, photometries, photometry_texels
from irrsplat.scene.seen_by_light import CUT_OUT, sort_of

_PARTS = "closed", "open", "cut_out"
_ONE = np.array([0.0, 0.0, 0.0, 1.0])  # w of a parallel tile


class ShadowPass(Owner):
    """Pass that draws the shadow maps of a scene's lights. Transmitting surfaces cast no shadow; cut-outs leave holes in it."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.program = self.own(Program(ctx, "lighting/shadow"))
        self._made = self.own(Workshop())
        self._drawn: tuple[object, Sequence[object]] = None, []  # what all tiles depend on, and each one

    def forget(self) -> None:
        """Draw all tiles again next time."""
        self._drawn = None, []

    def _photometry(self, world: World) -> moderngl.Texture | None:
        """Return the candela of the scene's luminaires; None for none."""
        different = photometries(world.scene.lights)
        if not different:
            self._made.drop("photometry")
            return None

        def make() -> moderngl.Texture:
            texels = photometry_texels(different)
            texture = float_texture(self.ctx, texels.shape[::-1], 1)
            texture.write(texels.tobytes())
            return texture

        return self._made.get("photometry", different, make)

    def __call__(self, world: World, side: int) -> ShadowMaps:
        """Return the shadow maps of all lights, and the light table. side: of a tile in texels, reduced to fit.

        Cascades are around the first eye of the world. Tiles of unchanged lights stay. The shadow maps of the last call
        become void.
        """
        side, columns, lines = sheet(tile_count(world.scene), side, int(self.ctx.info["GL_MAX_TEXTURE_SIZE"]))
        lights = light_table(world.scene, side, focus_of(world.scene, world.eyes))
        near = near_plane(world.scene)
        cut_outs = [mesh for mesh in world.scene.meshes if sort_of(mesh) == CUT_OUT]  # other paint casts the same shadow
        made_of, before = (world.parts, cut_outs, side, columns, lines, near, lights.far), self._drawn
        tiles = [(matrix.tobytes(), bool(parallel)) for matrix, parallel in zip(lights.tiles, lights.parallel, strict=True)]
        self._drawn = None, []  # until all are drawn
        defines = world.material_defines
        size = side * columns, side * lines
        target = self._made.get("target", size, lambda: Target(self.ctx, size, depth=True))
        if before[0] != made_of:
            before = made_of, []
            target.clear()
        for i, (matrix, parallel) in enumerate(zip(lights.tiles, lights.parallel, strict=True)):
            if before[1][i : i + 1] == tiles[i : i + 1]:
                continue
            cell = (side * (i % columns), side * (i // columns), side, side)
            if before[1]:
                target.use()
                target.gl.clear(depth=1.0, viewport=cell)
            seen = world.parts.seen(matrix[0], matrix[1], _ONE if parallel else matrix[2], lights.far)
            for part in _PARTS:
                first, count = world.geometry.parts[part]
                draws = [Draw(3 * at, 3 * n, {}) for _, at, n in world.parts.runs(first // 3, count // 3, seen)]
                if not draws:
                    continue
                cut_out = part == "cut_out"
                program = self.program
                if cut_out:
                    program = self._made.get("cut_out", defines, lambda: Program(self.ctx, "lighting/shadow", defines=defines))
                program(
                    target,
                    geometry=world.geometry,
                    draws=draws,
                    # geometry before the near plane casts a shadow in parallel light only
                    state=DrawState(depth="<", depth_clamp=bool(parallel)),
                    viewport=cell,
                    scissor=cell,
                    tile_right=matrix[0],
                    tile_up=matrix[1],
                    tile_forward=matrix[2],
                    tile_near=0.0 if parallel else near,
                    tile_far=lights.far,
                    **(world.materials.light_uniforms if cut_out else {}),
                )
        self._drawn = made_of, tiles
        assert target.depth is not None
        photometry = self._photometry(world)
        luminaires = None if photometry is None else luminaire_rows(world.scene.lights)
        return ShadowMaps(target.depth, lights.rows, (side, columns, lights.far), luminaires, photometry)
