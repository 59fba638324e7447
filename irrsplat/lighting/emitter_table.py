"""Area lights for sampling in shaders: tables of emissive triangles and of their clusters."""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.glsl import MAX_EMITTER_CLUSTERS, TABLE_COLUMNS
from irrsplat.core.vectors import along_a_way
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import float_texture, table_texture
from irrsplat.gpu.texel_table import row_count, table_rows, write
from irrsplat.gpu.world import World
from irrsplat.scene.emitters import emitters


class EmitterTable(Owner):
    """Tables for shaders/lighting/emitters.glsl, of the world's present scene. count: number of emissive triangles.

    Raises InputError for more triangles than rays can traverse on this GPU.
    """

    def __init__(self, world: World) -> None:
        world.triangles  # noqa: B018  # used by the samples; raises InputError here for too many triangles
        found, corners = emitters(world.scene), world.geometry.corners
        # cluster by cluster, each along a space-filling curve: neighbours in the list are neighbours in space
        order = np.lexsort((along_a_way(corners[found.triangle].mean(axis=1, dtype=np.float64)), found.cluster))
        triangle, cluster, power = (x[order] for x in (found.triangle, found.cluster, found.luminance * found.area))
        self.count, clusters = len(found), len(found.radius)
        total = np.bincount(cluster, weights=power, minlength=clusters)
        first = np.searchsorted(cluster, np.arange(clusters))
        density = found.in_place[order] / total[cluster]
        before = np.cumsum(power) - power
        share = (before + power - before[first][cluster]) / total[cluster] if self.count else np.zeros(0)
        rows = np.stack([triangle, share, density, found.one_sided[order]], axis=-1)
        self.triangles = self.own(table_texture(world.ctx, table_rows(rows[:, None].astype("f4"))))
        known = np.zeros((MAX_EMITTER_CLUSTERS, 2, 4), "f4")
        known[:clusters, 0] = np.column_stack([found.centre, found.radius**2])
        known[:clusters, 1, :3] = np.stack([total, first, np.bincount(cluster, minlength=clusters)], axis=-1)
        self._common: Uniforms = {
            "emitter_clusters": known.reshape(-1, 4),
            "emitter_cluster_count": clusters,
        }
        numbers = np.zeros((len(corners), 2), "f4")
        numbers[triangle] = np.stack([density, cluster], axis=-1)
        self.numbers = self.own(float_texture(world.ctx, (TABLE_COLUMNS, row_count(len(numbers))), 2))
        write(self.numbers, 0, numbers)

    def ray_uniforms(self, samples: int) -> Uniforms:
        """Return the uniforms of shaders/lighting/emitters.glsl for ray hits; samples: number of next-event samples."""
        return {**self._common, "emitter_numbers": self.numbers, "emitter_samples": float(samples)}

    def sample_uniforms(self, samples: int) -> Uniforms:
        """Return the uniforms of shaders/lighting/emitters.glsl for so many next-event `samples`."""
        return {**self._common, "emitter_triangles": self.triangles, "emitter_samples": float(samples)}


def emitter_table(world: World) -> EmitterTable | None:
    """Return the table of the world's area lights, cached by the world until something moves.

    None for no area lights, or for more triangles than rays can traverse.
    """
    if not world.scene.emissive:
        return None
    try:
        table = world.derived.get("emitters", world.scene.meshes, lambda: EmitterTable(world))
    except InputError:
        return None
    return table if table.count else None
