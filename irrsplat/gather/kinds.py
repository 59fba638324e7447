"""The kinds of gathers, and the kind that the setting `gather` selects."""

from __future__ import annotations

import moderngl

from irrsplat.core.errors import InputError
from irrsplat.gather.hemisphere import Gather
from irrsplat.gather.plane import PlaneGather
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu import context
from irrsplat.gpu.world import World
from irrsplat.scene import ray_caster
from irrsplat.settings import Settings


def kind(ctx: moderngl.Context, settings: Settings) -> str:
    """Return how records are gathered: "plane", "trace" or "embree"; auto is rays.

    Raises InputError where Embree is requested and missing.
    """
    return "plane" if settings.gather == "plane" else ray_kind(ctx, settings)


def ray_kind(ctx: moderngl.Context, settings: Settings) -> str:
    """Return how rays are traced, "embree" or "trace".

    If the setting `gather` names neither, Embree traces the rays of `auto` and of the surface cache where OpenGL is software
    and embreex is installed; a GPU is faster than Embree. Raises InputError where Embree is requested and missing.
    """
    if settings.gather == "embree" and not ray_caster.available():
        raise InputError(f"--gather embree needs the package embreex ({ray_caster.INSTALL}); without it: --gather auto")
    if settings.gather in ("embree", "trace"):
        return settings.gather
    return "embree" if ray_caster.available() and context.describe(ctx)["software"] else "trace"


def shadow_caster(world: World, settings: Settings, hurried: bool = False) -> World | None:
    """Return the world of shadow rays; None for the paper's plane, which uses shadow maps alone, and beyond a GPU's limits.

    hurried: None also while the tree of the rays is built.
    """
    return world if settings.gather != "plane" and world.casts_rays(hurried) else None


def gather_pass(world: World, settings: Settings, capacity: int | None = None) -> Gather:
    """Return the gather pass for `world` and `settings`, for batches of at most `capacity` records (None: the default batch).

    Raises InputError for rays through more triangles than the GPU can hold.
    """
    how, surface = kind(world.ctx, settings), settings.most_bounces > 1
    if how in ("trace", "embree"):
        return TraceGather(
            world,
            settings.gather_size,
            capacity,
            surface=surface,
            light_samples=settings.light_samples,
            embree=how == "embree",
        )
    return PlaneGather(world, settings.gather_size, capacity, surface=surface)
