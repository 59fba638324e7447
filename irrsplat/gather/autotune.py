"""Which gather is faster: for a single bounce in a small scene both are timed on it once, and the times are kept in a file.

The cost of a record by rasters grows with the number of triangles, by rays hardly; how much either costs depends on the machine,
its driver and the scene's lights.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path

import moderngl
import numpy as np

from irrsplat.core import paths
from irrsplat.core.buffers import HitLight, Sites
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.files import write_text
from irrsplat.gather.look import Gather, gather_records
from irrsplat.gather.raster import RasterGather
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu import context
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene import ray_caster
from irrsplat.scene.model import Scene
from irrsplat.scene.seen_by_light import face_counts
from irrsplat.settings import Settings

# Triangles up to which rays are not certain to be faster. On llvmpipe a hemicube of 64 costs 1.1 times what 64² rays cost at
# 30 triangles, 1.4 times at 2500, and 3 times at 20 thousand; a GPU draws triangles far faster.
DOUBTFUL = {True: 2000, False: 100_000}  # by whether OpenGL is software
_GUESS = {True: 100, False: 1000}  # triangles up to which rasters are taken where times cannot be kept
_SIDES = (16, 32, 64)  # gather sizes that are timed; for another the next smaller one counts
_SITES = 16  # records that either gathers
_TIMES = 3  # runs, of which the fastest counts
_SHADOWS = 64  # texels of a tile
_FILE, _VERSION, _MOST = "gathers.json", 1, 500  # entries

Times = tuple[float, float]  # milliseconds a record: by rasters, by rays
_known: dict[str, str] = {}  # the choices of this process, which stay as they are


def kind(ctx: moderngl.Context, scene: Scene, settings: Settings) -> str:
    """How records are gathered in `scene`: "plane", "raster", "trace" or "embree" (the setting `gather`, its auto resolved).

    auto: rays in large scenes, and for more than one bounce, which needs the rays' tree anyway. Else rasters and rays are timed
    once, and the choice holds for the rest of the process and, where the times can be kept, for later ones.
    Raises InputError where Embree is asked for and missing.
    """
    rays = ray_kind(ctx, settings)
    if settings.gather != "auto":
        return settings.gather
    triangles = scene.triangles
    if settings.most_bounces > 1 or triangles > max(DOUBTFUL.values()):
        return rays
    about = context.describe(ctx)
    software = bool(about["software"])
    guess = "raster" if triangles <= _GUESS[software] else rays
    if triangles > DOUBTFUL[software] or not triangles or not settings.most_bounces:
        return guess
    side = max((s for s in _SIDES if s <= settings.gather_size), default=_SIDES[0])
    lights = " ".join(map(str, light_defines(scene).values()))
    name = f"{context.machine(about)}; {triangles} triangles; lights {lights}; {side} texels"
    if any(material.albedo_texture or material.emission_texture for material in scene.materials):
        name += "; textures"
    if face_counts(scene).cut_out:
        name += "; cut-outs"
    if rays == "embree":
        name += "; embree"
    if name not in _known:
        times = _times(name, lambda: race(ctx, scene, side, rays))
        _known[name] = guess if times is None else "raster" if rasters(times) else rays
    return _known[name]


def ray_kind(ctx: moderngl.Context, settings: Settings) -> str:
    """How rays are traced, "embree" or "trace". Where the setting `gather` names neither, Embree traces those of `auto` and of
    the surface cache where OpenGL is software and embreex is installed: a GPU needs no help.

    Raises InputError where Embree is asked for and missing.
    """
    if settings.gather == "embree" and not ray_caster.available():
        raise InputError(f"--gather embree needs the package embreex ({ray_caster.INSTALL}); without it: --gather auto")
    if settings.gather in ("embree", "trace"):
        return settings.gather
    return "embree" if ray_caster.available() and context.describe(ctx)["software"] else "trace"


def gather_pass(world: World, settings: Settings, capacity: int | None = None) -> Gather:
    """The pass that gathers as `settings` say in `world`, at most `capacity` records at once (None: as many as are worth it).

    Raises InputError where rays are to go through more triangles than the GPU can hold.
    """
    how, surface = kind(world.ctx, world.scene, settings), settings.most_bounces > 1
    samples, apart = settings.light_samples, settings.emitters_apart
    if how in ("trace", "embree"):
        return TraceGather(
            world,
            settings.gather_size,
            capacity,
            surface=surface,
            light_samples=samples,
            emitters_apart=apart,
            embree=how == "embree",
        )
    return RasterGather(world, how, settings.gather_size, capacity, surface=surface, light_samples=samples, emitters_apart=apart)


def rasters(times: Times) -> bool:
    """Whether rasters are faster."""
    return times[0] <= times[1]


def kept(about: Mapping[str, object]) -> list[Times]:
    """The times that were kept on this machine."""
    path = _path()
    return [] if path is None else [times for name, times in _read(path).items() if name.startswith(context.machine(about) + ";")]


def race(ctx: moderngl.Context, scene: Scene, side: int, rays: str) -> Times:
    """Milliseconds a record takes in `scene` with gather size `side`, gathered and reduced: by rasters and by `rays`."""
    with ExitStack() as stack:
        world = stack.enter_context(World(ctx, scene))
        shadow, reduce = stack.enter_context(ShadowPass(ctx)), stack.enter_context(ReducePass(ctx, gradients=True))
        cache = stack.enter_context(RecordCache(ctx))
        raster = stack.enter_context(RasterGather(world, "raster", side, _SITES))
        trace = stack.enter_context(TraceGather(world, side, _SITES, embree=rays == "embree"))
        geometry = world.geometry
        light, sites = (
            HitLight(shadow(world, _SHADOWS)),
            _sites(scene, geometry.corners, geometry.counts.closed),
        )
        numbers = cache.append(sites) + np.arange(len(sites))

        def milliseconds(gather: Gather) -> float:
            """What one record takes, this once."""
            start = time.perf_counter()
            gather_records(gather, reduce, light, cache, numbers, seed=0)
            ctx.finish()
            return 1e3 * (time.perf_counter() - start) / len(sites)

        # by turns, so that what slows the machine down for a while slows both; the first turn compiles, and does not count
        times = [(milliseconds(raster), milliseconds(trace)) for _ in range(1 + _TIMES)][1:]
    return min(r for r, _ in times), min(t for _, t in times)


def _sites(scene: Scene, corners: np.ndarray, closed: int) -> Sites:
    """Points on the triangles (F, 3, 3), evenly by area; above closed meshes, and on the inner side of open ones, as it seems."""
    draw = np.random.default_rng(0)
    corners = corners.astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    which = draw.choice(len(area), _SITES, p=area / area.sum())
    share = draw.dirichlet((1.0, 1.0, 1.0), _SITES)
    position = np.einsum("nk,nki->ni", share, corners[which])
    normal = across[which] / area[which, None]
    inward = ((scene.bounds.mean(0) - position) * normal).sum(1) >= 0.0
    normal[~inward & (which >= closed)] *= -1.0
    found = [array.astype("f4") for array in (position, normal, normal)]
    return Sites(found[0], found[1], found[2], which)


# ---- the file ----------------------------------------------------------------------------------------------------------


def _path() -> Path | None:
    folder = paths.cache_folder()
    return None if folder is None else folder / _FILE


def _times(name: str, measure: Callable[[], Times]) -> Times | None:
    """The times kept under this name; measured, and kept, where there are none; None where they cannot be kept."""
    path = _path()
    if path is None:
        return None
    found = _read(path)
    if name in found:
        return found[name]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not os.access(path.parent, os.W_OK) or path.is_dir():
            return None
        times = measure()
        entries = _read(path) | {name: times}  # others may have written meanwhile
        newest = dict(list(entries.items())[-_MOST:])
        write_text(path, json.dumps({"version": _VERSION, "milliseconds": newest}, indent=1) + "\n")
    except (OSError, IrrsplatError):
        return None
    return times


def _read(path: Path) -> dict[str, Times]:
    """What the file holds; what is no pair of times is left out, and so is all of a file that is none of ours."""
    found: dict[str, Times] = {}
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        data = json.loads(path.read_bytes())
        if data["version"] == _VERSION:
            for name, pair in data["milliseconds"].items():
                if isinstance(pair, list) and len(pair) == 2 and all(type(x) is float and 0.0 < x < 1e9 for x in pair):
                    found[name] = pair[0], pair[1]
    return found
