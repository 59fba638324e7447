"""The inputs of gathers without a view."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from functools import cached_property

import moderngl

from irrsplat.core.buffers import ShadowMaps
from irrsplat.gpu import self_test
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.lighting import gl_limits
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings


class LitScene(Owner):
    """A scene on the GPU, its shadow maps, and a cache of records.

    scene: recentred and local. about: the context, from gpu.context.describe. Raises InputError for too many lights, GLError if
    OpenGL fails its self-test.
    """

    def __init__(self, ctx: moderngl.Context, about: Mapping[str, object], scene: Scene, settings: Settings) -> None:
        self_test.numbers_triangles(ctx)
        gl_limits.check(ctx, (1, 1), scene)
        with ExitStack() as made:
            made.push(self)
            self.world = self.own(World(ctx, scene))
            self.cache = self.own(RecordCache(ctx))
            self.shadow_pass = self.own(ShadowPass(ctx))
            made.pop_all()
        self.timers = Timers(ctx, bool(about["software"]))
        self._shadow_size = settings.shadow_size

    @property
    def notices(self) -> tuple[str, ...]:
        """One-line remarks for a user on parts of the scene that are shown with less detail, or not at all."""
        small = gl_limits.shadow_notices(self.shadow_pass.ctx, self.world.scene, self._shadow_size)
        return (*small, *self.world.materials.notices)

    @cached_property
    def shadows(self) -> ShadowMaps:
        """Shadow maps, drawn at first use."""
        return self.shadow_pass(self.world, self._shadow_size)
