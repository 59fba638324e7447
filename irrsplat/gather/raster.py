"""The gather by rasters: what many records see, drawn into an atlas (Jones 2010, section 3.4), a cell each.

A scene of few triangles is one instanced draw. Of many triangles, each face draws only the meshlets that may reach into it, and
notes which triangle each texel sees; then every texel is shaded once, however many triangles lie behind it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, Sites, Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS, VIEW_ROWS
from irrsplat.gather.hemicube import edge_table, faces, hemisphere_table
from irrsplat.gather.light_samples import LightSearch
from irrsplat.gather.look import Gather
from irrsplat.gather.record_frame import atlas_grid, eye_positions, frame_rows, sample_offsets, tangent_frames
from irrsplat.gpu.geometry import MeshletGeometry
from irrsplat.gpu.program import Draw, DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, float_texture, table_texture
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines

SINGLE_DRAW_TRIANGLES = 128  # at most, that one draw takes: there both ways cost about the same on llvmpipe
_ABOVE = 1e-4  # of the diagonal
_PAIRS = 1 << 21  # of faces and meshlets that are tested at once, at most; a texture of those that are drawn takes 16 MiB


class RasterGather(Gather):
    """Draws what records see of the world's geometry: hemicubes ("raster") or planes ("plane") of `side` texels.

    capacity: how many records one call takes at most (default: what a 96 MiB atlas holds). surface: the light that it is called
    with has a surface cache, too. light_samples: shadow rays of a record to emitters; the paper's planes take none.
    """

    def __init__(
        self,
        world: World,
        kind: str,
        side: int,
        capacity: int | None = None,
        *,
        surface: bool = False,
        light_samples: int = 0,
    ) -> None:
        super().__init__(world)
        self.ctx = ctx = world.ctx
        self.side = max(4, side // 4 * 4)  # so that four by four blocks fill a face
        self.kind = kind
        self.faces, cells = faces(kind)
        self.cells = cells * (self.side // 2)
        table = hemisphere_table(kind, self.side)
        self.cell = (table.shape[1], table.shape[0])
        self.share = table[..., 3]  # cosθ·dω of every texel of a cell
        self.table = table_texture(ctx, table)
        self.edges = table_texture(ctx, edge_table(kind, self.side))
        self.columns, self.capacity = atlas_grid(self.cell, capacity, int(ctx.info["GL_MAX_TEXTURE_SIZE"]))
        self.size = self.columns * self.cell[0], self.capacity // self.columns * self.cell[1]
        samples = 0 if kind == "plane" else light_samples
        self.search = LightSearch(world, samples, (self.side / 2.0) ** 2, strata=False)
        kinds = {**light_defines(world.scene), **world.material_defines, **self.search.defines}
        self.defines = {**kinds, "SURFACE": int(surface)}
        self.single_draw: SingleDraw | None = None  # either is made when it is first wanted
        self.meshlet_draw: MeshletDraw | None = None
        self.target: Target | None = None  # of the last call
        self.frames = float_texture(ctx, (self.capacity, 5))
        self.views = float_texture(ctx, (self.capacity, VIEW_ROWS * len(self.faces)))

    @property
    def offset(self) -> float:
        """Metres by which a record's eye lies above its surface: a nearer near plane leaves too little depth for the rest."""
        return _ABOVE * self.world.scene.diagonal

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.table, self.edges, self.single_draw, self.meshlet_draw, self.frames, self.views)

    def __call__(self, light: HitLight, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        """What records at `sites` (at most `capacity`) see; `numbers` (N,) are theirs in the cache."""
        geometry, count = self.world.geometry, len(sites)
        rotations = sites.frame_rotations(numbers)
        frame, eye = tangent_frames(sites.normal, rotations, seed), eye_positions(sites, geometry.corners, self.offset)
        described = np.zeros((5, count, 4), "f4")
        described[:4] = frame_rows(frame, sites, numbers)
        described[:2, :, 3] = sample_offsets(rotations, seed).T
        described[4, :, :3], described[4, :, 3] = eye, self.steps(sites)
        self.frames.write(described.tobytes(), viewport=(0, 0, count, 5))
        rows = self._views(frame, eye)
        self.views.write(rows.reshape(-1, count, 4).astype("f4").tobytes(), viewport=(0, 0, count, VIEW_ROWS * len(self.faces)))
        draw: SingleDraw | MeshletDraw
        if geometry.triangles <= SINGLE_DRAW_TRIANGLES:
            draw = self.single_draw = self.single_draw or SingleDraw(self.ctx, self.size, self.defines)
        else:
            draw = self.meshlet_draw = self.meshlet_draw or MeshletDraw(self.ctx, self.size, self.defines)
        used = (0, 0, self.size[0], -(-count // self.columns) * self.cell[1])
        searched = self.search.ray_uniforms
        target = self.target = draw(self.world, light, Views(rows, self.views, used, self.offset, searched))
        block = (self.side // 4, self.side // 4)
        radiance, planes = target.textures
        samples = self.search.light_samples(described, light)
        return Atlas(radiance, planes, self.table, self.edges, self.frames, count, self.columns, self.cell, block, samples)

    def _views(self, frame: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(F, 8, N, 4) float64: the rows of shaders/gather/raster/views.glsl for records with these frames (N, 3, 3) and eyes
        (N, 3)."""
        count = len(eye)
        rows = np.zeros((len(self.faces), VIEW_ROWS, count, 4))
        rows[:, :3, :, :3] = np.einsum("fij,njk->fink", self.faces, frame)
        rows[:, :3, :, 3] = -np.einsum("fink,nk->fin", rows[:, :3, :, :3], eye)
        corner = np.stack([np.arange(count) % self.columns, np.arange(count) // self.columns], axis=-1) * self.cell
        half = self.cells[:, 2:] / 2.0
        rows[:, 3, :, :2] = corner + (self.cells[:, :2] + half)[:, None]
        rows[:, 3, :, 2:] = half[:, None]
        rows[:, 4, :, :3] = eye
        # the direction of (x, y) is F⁻¹(x, y, 1), F = face·frame; from texel to texel x and y advance by 1/half
        directions = np.einsum("fij,nik->fjnk", np.linalg.inv(self.faces), frame)
        rows[:, 5:, :, :3] = directions / np.insert(half, 2, 1.0, axis=1)[:, :, None, None]
        return rows


@dataclass(frozen=True)
class Views:
    """The views of one call: F faces of N records.

    rows: (F, 8, N, 4), as shaders/gather/raster/views.glsl reads them from `texture`. used: the rectangle of the atlas that they
    fill, (x, y, width, height) texels. near: the records' offset above their surfaces, metres. emitters: the uniforms by
    which what they see counts beside light samples.
    """

    rows: np.ndarray
    texture: moderngl.Texture
    used: tuple[int, int, int, int]
    near: float
    emitters: Uniforms = field(default_factory=dict)

    @property
    def uniforms(self) -> Uniforms:
        """The uniforms of programs that draw every face of every record."""
        return {"views": self.texture, "faces": len(self.rows), "near": self.near}

    @property
    def count(self) -> int:
        """The number of faces of all records together."""
        return len(self.rows) * int(self.rows.shape[2])


class SingleDraw(Owner):
    """One draw of all triangles in all views, into an atlas of `size` texels."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], defines: Mapping[str, int]) -> None:
        self.program = Program(ctx, "gather/raster/draw", defines={"EMITTERS": 0, "VIRTUAL_LIGHTS": 0, **defines, "MESHLETS": 0})
        self.target = Target(ctx, size, (4, 4), depth=True)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.target)

    def __call__(self, world: World, light: HitLight, views: Views) -> Target:
        """Draw these views; returns the target, whose textures are radiance and planes as Atlas has them."""
        self.target.use(scissor=views.used)
        self.target.gl.clear(viewport=views.used)
        self.program(
            self.target,
            geometry=world.geometry,
            part="lit",
            instances=views.count,
            state=DrawState(depth="<", depth_clamp=True, clip_planes=5),
            atlas=self.target.size,
            **views.uniforms,
            **(world.gather_uniforms | light.uniforms | views.emitters),
        )
        return self.target


class MeshletDraw(Owner):
    """A draw for each meshlet, in the views that it may reach into, and then one that shades what is seen."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], defines: Mapping[str, int]) -> None:
        self.ctx = ctx
        cut_outs = {name: defines.get(name, 0) for name in ("TEXTURES", "CUT_OUTS")}
        self.find_triangles = Program(ctx, "gather/raster/triangle", "gather/raster/draw", {"MESHLETS": 1})
        self.find_cut_outs = Program(ctx, "gather/raster/triangle", "gather/raster/draw", {"MESHLETS": 1, **cut_outs})
        self.shade = Program(ctx, "gather/raster/shade", defines={"EMITTERS": 0, "VIRTUAL_LIGHTS": 0, **defines, "MESHLETS": 0})
        self.triangle = Target(ctx, size, (1,), depth=True)
        self.target = Target(ctx, size, (4, 4))
        self.pairs: moderngl.Texture | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.find_triangles, self.find_cut_outs, self.shade, self.triangle, self.target, self.pairs)

    def __call__(self, world: World, light: HitLight, views: Views) -> Target:
        """As SingleDraw does."""
        in_meshlets, rows = world.geometry.meshlet_geometry, views.rows
        self.triangle.use(scissor=views.used)
        self.triangle.gl.clear(viewport=views.used)
        step = max(_PAIRS // max(len(rows) * len(in_meshlets.meshlets), 1), 1)
        for start in range(0, rows.shape[2], step):
            for cut_out, clips, draws in self._draws(in_meshlets, rows[:, :3, start : start + step], start, views.near):
                find = self.find_cut_outs if cut_out else self.find_triangles
                find(
                    self.triangle,
                    geometry=in_meshlets,
                    draws=draws,
                    state=DrawState(depth="<", depth_clamp=True, clip_planes=clips),
                    near=views.near,
                    atlas=self.triangle.size,
                    views=views.texture,
                    pairs=self.pairs,
                    **(world.materials.light_uniforms if cut_out else {}),
                )
        self.shade(
            self.target,
            vertices=4,
            mode=moderngl.TRIANGLE_STRIP,
            instances=views.count,
            seen=self.triangle.textures[0],
            atlas=self.target.size,
            **views.uniforms,
            **(light.uniforms | in_meshlets.uniforms | world.gather_uniforms | views.emitters),
        )
        return self.target

    def _draws(
        self, geometry: MeshletGeometry, rows: np.ndarray, start: int, near: float
    ) -> Iterator[tuple[bool, int, list[Draw]]]:
        """The draws of meshlets in the views that may see them: whether these are cut out, and the clip planes that these draws
        need: 5 where a meshlet may reach beyond a view's border, else 0.

        rows: (F, 3, N, 4), x, y and w of the views. start: the number of their first record. An instance is a view, which the
        shader finds by the pairs (record, face) that this writes.
        """
        meshlets = geometry.meshlets
        some, within = meshlets.seen(rows.swapaxes(1, 2), near)
        parts = [np.stack(np.nonzero(part)) for part in (some & ~within, within)]
        meshlet, face, record = np.concatenate(parts, axis=1)
        height = -(-max(len(meshlet), 1) // TABLE_COLUMNS)
        table = np.zeros((height * TABLE_COLUMNS, 2), "f4")
        table[: len(meshlet)] = np.stack([record + start, face], axis=1)
        if self.pairs is None or self.pairs.height < height:
            if self.pairs is not None:
                self.pairs.release()
            self.pairs = float_texture(self.ctx, (TABLE_COLUMNS, height), 2)
        self.pairs.write(table.tobytes(), viewport=(0, 0, TABLE_COLUMNS, height))
        before = 0
        for clips, part in zip((5, 0), parts, strict=True):
            instances = np.bincount(part[0], minlength=len(meshlets))
            first = before + np.cumsum(instances) - instances
            before += len(part[0])
            numbers = np.stack([meshlets.first, meshlets.count, instances, first], axis=1)
            for cut_out, of_them in enumerate((numbers[: geometry.solid], numbers[geometry.solid :])):
                draws = [Draw(3 * t, 3 * n, i, {"piece": (p, t)}) for t, n, i, p in of_them[of_them[:, 2] > 0].tolist()]
                if draws:
                    yield bool(cut_out), clips, draws
