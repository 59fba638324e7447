"""Order in which stale records are refreshed: first those that cover most of the view and have been stale for longest."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Records
from irrsplat.core.memo import Memo
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


class RefreshOrder(Owner):
    """Priority order of a cache's stale records, updated for each view and each invalidation."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        defines = (record_defines(gradients) for gradients in (False, True))
        self.programs = [self.own(Program(ctx, "records/coverage", "lib/fullscreen", some)) for some in defines]
        self.targets = self.own(Workshop())
        self._memo = Memo()

    def covered(self, records: Records, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """Return (N,) float32, the number of pixels that each record covers, by samples of its bounding box on screen.

        The number is 0 for hidden or off-screen records.
        """
        target = self.targets.get("target", records.size, lambda: Target(self.ctx, records.size, (1,)))
        width, height = gbuffer.position.size
        columns = records.size[0]
        self.programs[settings.gradients](
            target,
            scissor=(0, 0, columns, -(-records.count // columns)),
            **records.uniforms,
            count=records.count,
            clip_from_world=camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
            **view_radius_uniforms(camera, (width, height), settings),
            pixel=camera.pixel((width, height)),
            **gbuffer.surface_uniforms,
        )
        return np.asarray(np.frombuffer(target.textures[0].read(), "f4")[: records.count])

    def order(self, cache: RecordCache, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """Return (N,) the numbers of the stale records in the order of their refresh.

        Priority is the product of covered pixels, age in invalidations, and change of light: no record in view waits for ever,
        even under constant change of light. Hidden records come last, the oldest first.
        """

        def made() -> np.ndarray:
            stale = cache.stale
            if not len(stale):
                return stale
            waited = cache.age(stale)
            covered = self.covered(cache.records, gbuffer, camera, settings)[stale]
            return stale[np.lexsort((-waited, -covered * waited * cache.column("drift")[stale]))]

        numbers = self._memo.get("order", (gbuffer, cache.invalidation_epoch, cache.evicted), made)
        return numbers[cache.age(numbers) > 0]
