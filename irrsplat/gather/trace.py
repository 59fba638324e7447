"""The gather by rays: radiance of many records along cosine-stratified directions.

A fragment is a ray. It traverses a tree of the scene's triangles, or uses the hit that Embree found (scene/ray_caster.py). Its
radiance and distance go into an atlas like that of the plane gather, which the same reduction sums.
"""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, Sites, Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gather.hemisphere import Gather
from irrsplat.gather.light_samples import LightSearch
from irrsplat.gather.record_frame import atlas_grid, eye_positions, frame_rows, places_of_texels, sample_offsets, tangent_frames
from irrsplat.gather.sky_share import SkyShares
from irrsplat.gather.stratified import ray_directions, site_directions, stratum_edges, stratum_table
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Resource
from irrsplat.gpu.target import Target, float_texture, integer_texture, table_texture, uneven
from irrsplat.gpu.texel_table import row_count
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines


class TraceGather(Gather):
    """Tracer of side² rays a record, in the shader through the world's tree, or with `embree` by Embree.

    capacity: greatest number of records in one call (default: a 32 MiB atlas). surface: the light of a call includes a surface
    cache. hits: the pass only notes the surface cache's values at the hits, and the hit points, for the methods `hits` and
    `met`. places: number of eye positions of a record, see Gather.places. light_samples: a record's shadow rays to emitters.
    survey: True for a pass without shadow rays, whose hits count for the nearest site; with the program of other `hits`.
    Raises InputError for more triangles than the GPU's textures hold, and if embreex is required and missing.
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
        survey: bool = False,
        embree: bool = False,
    ) -> None:
        super().__init__(world, places)
        self.ctx = ctx = world.ctx
        self.side = max(4, side // 4 * 4)  # so that blocks fill a cell
        self.kind = "embree" if embree else "trace"
        world.seen_uniforms(embree)  # raises InputError here for too many triangles
        table = stratum_table(self.side)
        self.cell = (table.shape[1], table.shape[0])
        self.share = table[..., 3]  # cosθ·dω of every texel of a cell
        self.directions = table[..., :3].reshape(-1, 3)  # their directions in a record's frame
        self.table = table_texture(ctx, table, varying=True)
        self.edges = table_texture(ctx, stratum_edges(self.side), varying=True)
        self.rays = (ray_directions if places == 1 else site_directions)(self.side)
        looks = np.concatenate([self.rays.reshape(*table.shape[:2], 3), table[..., 3:]], axis=-1)
        self.looks = table_texture(ctx, looks, varying=True)
        self.places_of_texels = places_of_texels(self.cell, places)
        # each place has as many texels; for one place a slice suffices, and numpy copies slices ten times as fast
        self._by_place = np.argsort(self.places_of_texels, kind="stable") if places > 1 else slice(None)
        self.search = LightSearch(world, light_samples, self.share.size / np.pi, embree=embree)
        self.program = Program(
            ctx,
            "gather/trace",
            "lib/fullscreen",
            defines={
                **light_defines(world.scene),
                **world.material_defines,
                **self.search.defines,
                "SURFACE": int(surface),
                "HITS": int(hits),
                "KNOWN_HITS": int(embree),
            },
        )
        self.outputs = (4,) * (5 if hits else 2)
        self.survey = survey
        limit, count = int(ctx.info["GL_MAX_TEXTURE_SIZE"]), self.share.size
        self.columns, self.capacity = atlas_grid(self.cell, capacity, limit // places)
        self.first_hits: moderngl.Texture | None = None
        if embree:
            self.columns, self.capacity = atlas_grid(self.cell, min(self.capacity, limit * TABLE_COLUMNS // count), limit)
            self.first_hits = integer_texture(ctx, (TABLE_COLUMNS, uneven(row_count(self.capacity * count))))
        # a surface cache has so many sites that the noise of each averages out
        lines = self.capacity // self.columns
        self.sky = None if hits or places > 1 else SkyShares(world, self.side, self.columns, lines, embree)
        self.target: Target | None = None
        self.frames = float_texture(ctx, (uneven(self.capacity * places), 5))

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.table, self.edges, self.looks, self.program, self.target, self.frames, self.first_hits, self.sky)

    def __call__(self, light: HitLight, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        """Return the radiance at `sites`, at most `capacity` times `places`; numbers: (N,) of the records in the cache."""
        if self.target is None:
            down = self.capacity // self.columns
            size = uneven(self.columns * self.cell[0]), uneven(down * self.cell[1])
            self.target = Target(self.ctx, size, self.outputs)
        looks, count = len(sites), len(sites) // self.places
        rows = np.zeros((5, looks, 4), "f4")
        rotations = sites.frame_rotations(numbers)
        rows[:4] = frame_rows(tangent_frames(sites.normal, rotations, seed), sites, numbers)
        rows[:2, :, 3] = sample_offsets(rotations // self.places, seed).T  # one sample pattern for all places of a record
        rows[4, :, :3], rows[4, :, 3] = eye_positions(sites, self.world.geometry.corners, self.offset), self.steps(sites)
        self.frames.write(rows.tobytes(), viewport=(0, 0, looks, 5))
        hits = self._trace(rows)
        known: Uniforms = {} if hits is None else {"first_hits": self.first_hits}
        known |= self.program.declared({"survey": int(self.survey)})
        lines, rest = divmod(count, self.columns)
        width, height = self.cell
        whole = (0, 0, self.columns * width, lines * height), (0, lines * height, rest * width, height)
        areas = tuple(area for area in whole if area[2] * area[3])
        for area in areas:
            self.program(
                self.target,
                scissor=area,
                frames=self.frames,
                directions=self.looks,
                cell=self.cell,
                columns=self.columns,
                places=self.places,
                near=self.offset,
                closed=self.world.geometry.counts.closed,
                **(known | self.world.seen_uniforms(self.kind == "embree") | light.uniforms | self.search.ray_uniforms(light)),
            )
        block = (self.side // 4, self.side // 4)
        radiance, planes = self.target.textures[:2]
        samples = () if self.survey else self.search.light_samples(rows, light)
        return Atlas(
            radiance,
            planes,
            self.table,
            self.edges,
            self.frames,
            count,
            self.columns,
            self.cell,
            block,
            samples,
            self.looks,
            None if self.sky is None else self.sky(rows, hits, radiance, self.frames, areas),
        )

    def _trace(self, rows: np.ndarray) -> np.ndarray | None:
        """Have Embree trace the rays of records with these rows of `frames`; return (N, R) the triangles hit, None without it."""
        if self.first_hits is None:
            return None
        rays = self.rays[self._by_place].reshape(self.places, -1, 3)
        found = self.world.caster.first_hits(rows[4, :, :3], rows[:3, :, :3].swapaxes(0, 1), rays)
        count, lines = found.size // self.share.size, -(-found.size // TABLE_COLUMNS)
        table = np.zeros(lines * TABLE_COLUMNS, np.int32)
        hits = table[: found.size].reshape(count, -1)
        hits[:, self._by_place] = found.reshape(count, -1)
        self.first_hits.write(table, viewport=(0, 0, TABLE_COLUMNS, lines))
        return hits

    def hits(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the hits of the last call's first `count` records, R rays each in the order of the cell's texels.

        The number (N, R) of a value of the surface cache at each hit, -1 for a miss or an unknown value; and the reflectance
        (N, R, 3), 0 there. The value is one of three there, drawn by its weight; in a survey, that of the greatest weight.
        """
        (found,) = self._read((2,), count)
        return found[..., 3].astype(np.intp), found[..., :3]

    def met(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position and shading normal on the side of the hit, (N, R, 3) each, and the triangle's number in the scene,
        (N, R), for the rays of `hits`; undefined for a miss."""
        place, normal = self._read((3, 4), count)
        return place[..., :3], normal[..., :3], place[..., 3].astype(np.intp)

    def _read(self, outputs: tuple[int, ...], count: int) -> list[np.ndarray]:
        """Return (N, R, 4) each, these outputs of the last call's first `count` records."""
        assert self.target is not None
        lines, (width, height) = -(-count // self.columns), self.cell
        used = 0, 0, self.columns * width, lines * height
        return [
            np.frombuffer(self.target.gl.read(used, 4, attachment=number, dtype="f4"), "f4")
            .reshape(lines, height, self.columns, width, 4)
            .swapaxes(1, 2)
            .reshape(-1, width * height, 4)[:count]
            for number in outputs
        ]
