"""The gather by rays: radiance of many records along cosine-stratified directions.

A fragment is a ray. It traverses a tree of the scene's triangles, or uses the hit that Embree found (scene/ray_caster.py).
Radiance and distance are stored in an atlas, as in the plane gather. Both gathers share the reduction.
"""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, Sites
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gather.close_light import LEAST, CloseLight
from irrsplat.gather.hemisphere import Gather
from irrsplat.gather.light_samples import LightSearch
from irrsplat.gather.record_frame import FEW_RAYS, PLACES, atlas_grid, eye_heights, places_of_texels, sample_offsets
from irrsplat.gather.sky_share import SkyShares
from irrsplat.gather.stratified import LEAST_SIDE, ray_directions, site_directions, stratum_edges, stratum_table
from irrsplat.gpu.program import Program
from irrsplat.gpu.target import Target, float_texture, integer_texture, table_texture, uneven
from irrsplat.gpu.texel_table import row_count
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines

_BESIDE = 0.014  # of the image height: distance of a record's additional eyes for next-event estimation
_SCREEN = 0.25  # of the scene's diagonal: default of the image height


class TraceGather(Gather):
    """The gather along side² rays per record, traced by the shader through the world's tree, or with `embree` by Embree.

    capacity: greatest number of records in one call (default: a 32 MiB atlas). surface: True if the light of a call includes a
    surface cache. hits: True if the pass also outputs hit points and the values of the surface cache at the hits, for the
    methods `hits` and `met`; with one place, it is a survey without shadow rays. places: number of eye positions of a record, see
    Gather.places. light_samples: shadow rays to emitters per record. rays: (4, R) the directions of a record's rays in its frame,
    and cosθ·dω. Raises InputError for more triangles than the GPU's textures hold, and if embreex is required and missing.
    """

    def __init__(
        self,
        world: World,
        side: int,
        capacity: int | None = None,
        *,
        surface: bool = False,
        hits: bool = False,
        places: int = 1,
        light_samples: int = 0,
        embree: bool = False,
    ) -> None:
        world.seen_uniforms(embree)  # raises InputError here for too many triangles
        side, ctx = max(LEAST_SIDE, side // 4 * 4), world.ctx  # so that blocks fill a cell
        table, rays = stratum_table(side), (ray_directions if places == 1 else site_directions)(side)
        cell, limit = (table.shape[1], table.shape[0]), int(ctx.info["GL_MAX_TEXTURE_SIZE"])
        columns, capacity = atlas_grid(cell, capacity, limit // places)
        if embree:
            columns, capacity = atlas_grid(cell, min(capacity, limit * TABLE_COLUMNS // len(rays)), limit)
        super().__init__(world, table, capacity, places)
        self._light_samples = light_samples
        self.kind, self._survey = "embree" if embree else "trace", hits and places == 1
        self.search = LightSearch(world, light_samples, len(rays) / np.pi, embree=embree)
        defines = {
            **light_defines(world.scene),
            **world.material_defines,
            **self.search.defines,
            "SURFACE": int(surface or hits),
            "HITS": int(hits),
            "KNOWN_HITS": int(embree),
        }
        self.program = self.own(Program(ctx, "gather/trace", "lib/fullscreen", defines))
        size = uneven(columns * cell[0]), uneven(capacity // columns * cell[1])
        self.target = self.own(Target(ctx, size, (4,) * (5 if hits else 2)))
        directions = np.concatenate([rays.reshape(*table.shape[:2], 3), table[..., 3:]], axis=-1)
        atlas = self._empty_atlas(self.target, columns, stratum_edges(side))
        self.atlas = replace(atlas, rays=self.own(table_texture(ctx, directions, varying=True)))
        hits_size = TABLE_COLUMNS, uneven(row_count(capacity * len(rays)))
        self._first_hits = self.own(integer_texture(ctx, hits_size)) if embree else None
        # each place has as many texels; for one place a slice suffices, and numpy copies slices ten times as fast
        self._by_place = np.argsort(places_of_texels(cell, places), kind="stable") if places > 1 else slice(None)
        self._rays_of_places = rays[self._by_place].reshape(places, -1, 3)
        self.rays = np.stack([*rays.T, table[..., 3].ravel()])
        resolves_close = surface and not hits and places == 1 and len(rays) > LEAST
        self._close_light = self.own(float_texture(ctx, (uneven(capacity), 1), 2)) if resolves_close else None
        # a surface cache has so many sites that the noise of each averages out
        self.sky = None if hits or places > 1 else self.own(SkyShares(world, side, self.atlas, embree))

    def __call__(self, light: HitLight, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        atlas, count = self.atlas, len(sites) // self.places
        rows = self._frame_rows(sites, numbers, seed, eye_heights(sites, self.world.scene))
        # one sample pattern for all places of a record
        rows[:2, :, 3] = sample_offsets(sites.frame_rotations(numbers) // self.places, seed).T
        # about the radius that a record covers on screen, so that its additional eyes sample the change of light within it
        screen = np.where(sites.screen_heights > 0.0, sites.screen_heights, _SCREEN * self.world.scene.diagonal)
        rows[4, :, 3] = np.maximum(_BESIDE * screen, self.offset)
        atlas.frames.write(rows.tobytes(), viewport=(0, 0, len(sites), 5))
        hits: np.ndarray | None = None
        uniforms, samples = self.search(rows, light)
        if self._first_hits is not None:
            hits = self._find(rows, self._first_hits)
            uniforms["first_hits"] = self._first_hits
        uniforms |= self.world.seen_uniforms(hits is not None) | light.uniforms
        lines, rest = divmod(count, atlas.columns)
        width, height = atlas.cell
        whole = (0, 0, atlas.columns * width, lines * height), (0, lines * height, rest * width, height)
        areas = tuple(area for area in whole if area[2] * area[3])
        for area in areas:
            self.program(
                self.target,
                scissor=area,
                frames=atlas.frames,
                directions=atlas.rays,
                cell=atlas.cell,
                columns=atlas.columns,
                places=self.places,
                near=self.offset,
                closed=self.world.geometry.counts.closed,
                **uniforms,
            )
        sky_share = None if self.sky is None else self.sky(rows, hits, areas)
        close = None
        if self._close_light is not None:
            rotations, planes = sites.frame_rotations(numbers), self._read(1, count)
            found = self._close_hits()(light, rows, sites, rotations, planes, self.rays, hits, seed)
            self._close_light.write(found.tobytes(), viewport=(0, 0, count, 1))
            close = {**(light.surface or {}), "close_light": self._close_light}
        return replace(atlas, count=count, light_samples=() if self._survey else samples, sky_share=sky_share, close_light=close)

    def _find(self, rows: np.ndarray, texture: moderngl.Texture) -> np.ndarray:
        """Trace the rays of records with these `rows` of Atlas.frames by Embree, and write the triangles hit to the `texture`.

        Return their numbers (N, R), -1: none.
        """
        found = self.world.caster.first_hits(rows[4, :, :3], rows[:3, :, :3].swapaxes(0, 1), self._rays_of_places)
        table = np.zeros(row_count(found.size) * TABLE_COLUMNS, np.int32)
        hits = table[: found.size].reshape(-1, self.rays.shape[1])
        hits[:, self._by_place] = found.reshape(hits.shape)
        texture.write(table, viewport=(0, 0, TABLE_COLUMNS, len(table) // TABLE_COLUMNS))
        return hits

    def _close_hits(self) -> CloseLight:
        """Return the passes for light at close hits, which all gathers of the world share."""
        world, embree, samples = self.world, self.kind == "embree", min(self._light_samples, PLACES)
        emitters = samples > 0 and emitter_table(world) is not None
        inputs = light_defines(world.scene), dict(world.material_defines), samples, embree, emitters

        def made() -> CloseLight:
            count = FEW_RAYS // LEAST_SIDE**2
            return CloseLight(
                TraceGather(world, LEAST_SIDE, count, surface=True, places=PLACES, light_samples=samples, embree=embree)
            )

        return world.derived.get("close light", inputs, made)

    def hits(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the hits of the last call's first `count` records, R rays each in the order of the cell's texels.

        The number (N, R) of a value of the surface cache at each hit; -1 for a miss, an unknown value, or a ray below the
        surface. The share (N, R, 3) of the value's irradiance that the record receives: ρ/π·cosθ·dω, 0 there. The value is one
        of three there, drawn by its weight; in a survey, that of the greatest weight.
        """
        found = self._read(2, count)
        return found[..., 3].astype(np.intp), (self.rays[3] / np.pi)[:, None] * found[..., :3]

    def met(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position and shading normal on the side of the hit, (N, R, 3) each, and the triangle's number in the scene,
        (N, R), for the rays of `hits`; undefined for a miss."""
        place, normal = (self._read(output, count) for output in (3, 4))
        return place[..., :3], normal[..., :3], place[..., 3].astype(np.intp)

    def _read(self, output: int, count: int) -> np.ndarray:
        """Return (N, R, 4) an output of the last call for the texels of its first `count` records."""
        lines, columns, (width, height) = -(-count // self.atlas.columns), self.atlas.columns, self.cell
        texels = self.target.gl.read((0, 0, columns * width, lines * height), 4, attachment=output, dtype="f4")
        cells = np.frombuffer(texels, "f4").reshape(lines, height, columns, width, 4).swapaxes(1, 2)
        return cells.reshape(-1, height * width, 4)[:count]
