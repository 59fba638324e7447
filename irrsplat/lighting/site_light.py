"""Direct irradiance at arbitrary points, with shadow maps."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import ShadowMaps, Sites
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, float_texture
from irrsplat.gpu.texel_table import table_rows
from irrsplat.gpu.world import World


class SiteLightPass(Owner):
    """Direct irradiance of up to `most` points at once. lights: light_defines.

    world: its rays decide where shadow samples differ; None: use the mean of the samples.
    """

    def __init__(self, ctx: moderngl.Context, lights: Mapping[str, int], most: int, world: World | None = None) -> None:
        rows, self.world = -(-most // TABLE_COLUMNS), world
        kinds = {} if world is None else {**world.material_defines, "SHADOW_RAYS": 1}
        self.program = self.own(Program(ctx, "lighting/site_light", "lib/fullscreen", {**lights, **kinds}))
        self.sites = self.own(float_texture(ctx, (3 * TABLE_COLUMNS, rows)))
        self.target = self.own(Target(ctx, (TABLE_COLUMNS, rows), (4,)))

    def __call__(
        self, shadows: ShadowMaps, sites: Sites, area: np.ndarray, reach: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (N, 3) W/m² at `sites`, and (N,) metres from each to the first surface along its geometric normal.

        area: (N,) m² that each site represents: its irradiance is the mean over that area. reach: metres, least and greatest
        length of the rays along the normal; a nearer surface is the site's own. Without a world all distances are 0.
        """
        columns = np.stack([sites.position, sites.normal, sites.geometric], axis=1)
        rows = table_rows(np.concatenate([columns, np.repeat(area[:, None, None], 3, axis=1)], axis=-1, dtype="f4"))
        self.sites.write(rows.tobytes(), viewport=(0, 0, 3 * TABLE_COLUMNS, len(rows)))
        rays = {} if self.world is None else self.world.ray_uniforms
        given = {"sites": self.sites, "reach": reach, **shadows.uniforms, **rays}
        self.program(self.target, scissor=(0, 0, TABLE_COLUMNS, len(rows)), **self.program.declared(given))
        found = np.frombuffer(self.target.textures[0].read(), "f4").reshape(-1, 4)[: len(sites)]
        return found[:, :3], found[:, 3]
