"""Truths that fine gathers find in bundled scenes, kept in fine.npz: `python -m tests.support.fine` makes them anew, in minutes.

Each says which scene it belongs to; run it again whenever one changes. Luminances, Rec. 709.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import moderngl
import numpy as np

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.gather.look import gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu import context
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.indirect.paper_scan import Seen, read_back
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from tests.support.truth import scene_hash
from tests.support.worlds import Lit

FILE = Path(__file__).with_suffix(".npz")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
SLOPES = ("cornell", "curved", "door", "atrium")
POINTS = 40
RAYS = 256  # a side: 65 536 of them
TURNS = 4  # of the record's frame, over which a slope is a mean
STEP = 0.02  # of R_k
SIZE = 200  # pixels a side of the picture for Bends
PIXELS = 400  # of them
ROUND = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))  # a pixel and its neighbours


@dataclass(frozen=True)
class Slopes:
    """Of N points that a scene's first camera sees: E (N,) and R (N,) by 65 536 rays, and (E(p + δ) − E(p − δ))/2δ (N, 2) along
    `tangents`, where δ is 2 % of R."""

    hash: str
    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    E: np.ndarray
    R: np.ndarray
    slope: np.ndarray

    @property
    def sites(self) -> Sites:
        """The points."""
        return Sites(self.position, self.normal, self.geometric)


@dataclass(frozen=True)
class Bends:
    """Of N smooth pixels (N, 2), row and column, of the first camera's view of `cornell`: E (5, N) at ROUND by 49 thousand
    directions."""

    hash: str
    pixels: np.ndarray
    E: np.ndarray


@dataclass(frozen=True)
class Found:
    """Of N records: luminance E (N,), R (N,) and ∇E of the luminance (N, 3)."""

    E: np.ndarray
    R: np.ndarray
    gradient: np.ndarray


class Gatherer(Owner):
    """Gathers by `how` with so many texels a `side`. A record's turn about its normal goes by its place among the sites, so that
    sites that have moved a little see by the same directions, and aliasing cancels in differences."""

    def __init__(self, ctx: moderngl.Context, world: Scene, how: str, side: int) -> None:
        self.lit = Lit(ctx, world, Settings().shadow_size)
        self.look = self.lit.look(side, how)
        self.reduce, self.cache = ReducePass(ctx, True), RecordCache(ctx)

    def owned(self) -> tuple[Resource, ...]:
        """What this frees."""
        return (self.lit, self.look, self.reduce, self.cache)

    def __call__(self, where: Sites, seed: int = 0) -> Found:
        self.cache.truncate(0)
        numbers = self.cache.append(where) + np.arange(len(where))
        gather_records(self.look, self.reduce, self.lit.light, self.cache, numbers, seed)
        E, R, gradient = self.cache.records.read("irradiance", "radius", "gradient").values()
        return Found(E @ LUMINANCE, R, np.einsum("ncx,c->nx", gradient, LUMINANCE))


def tangents(n: np.ndarray) -> np.ndarray:
    """(2, N, 3): two unit vectors across unit vectors n (N, 3) and each other."""
    one = np.cross(n, np.where(np.abs(n[:, :1]) < 0.7, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([one, np.cross(n, one)])


def seen(ctx: moderngl.Context, world: Scene, side: int) -> Seen:
    """What the first camera sees on side² pixels."""
    with irrsplat.Renderer(world, (side, side), ctx=ctx, bounces=1) as renderer:
        return read_back(renderer.frame(gather=False)[0].gbuffer)


def sites_at(view: Seen, pixels: np.ndarray) -> Sites:
    """The points at pixels (N, 2)."""
    at = tuple(pixels.T)
    return Sites(view.position[at], view.normal[at], view.geometric[at])


# ---- the file ---------------------------------------------------------------------------------------------------------

Kind = TypeVar("Kind", Slopes, Bends)


def load(kind: type[Kind], name: str, world: Scene) -> Kind:
    """The truth of this kind for the bundled scene `name`, which is `world`."""
    with np.load(FILE) as data:
        found = {field.name: data[f"{kind.__name__}/{name}/{field.name}"] for field in fields(kind)}
    found["hash"] = found["hash"].item()
    assert found["hash"] == scene_hash(world), f"{name} has changed: run `python -m tests.support.fine`"
    return kind(**found)


def make_slopes(ctx: moderngl.Context, world: Scene) -> Slopes:
    """The truth of slopes at points drawn at random."""
    view = seen(ctx, world, 160)
    where = sites_at(view, np.random.default_rng(5).permutation(np.argwhere(view.mask))[:POINTS])
    with Gatherer(ctx, world, "trace", RAYS) as fine:
        here = fine(where)
        step = STEP * here.R[:, None]
        slope = np.zeros((len(where), 2))
        for axis, t in enumerate(tangents(where.normal.astype(float))):
            for sign in (1.0, -1.0):
                moved = Sites((where.position + sign * step * t).astype("f4"), where.normal, where.geometric)
                for seed in range(TURNS):
                    slope[:, axis] += sign * fine(moved, seed).E / (2.0 * step[:, 0] * TURNS)
    return Slopes(scene_hash(world), where.position, where.normal, where.geometric, here.E, here.R, slope)


def make_bends(ctx: moderngl.Context, world: Scene) -> Bends:
    """The truth around pixels drawn at random from the smooth ones."""
    view = seen(ctx, world, SIZE)
    pixels = np.random.default_rng(2).permutation(np.argwhere(view.smooth(0.002 * world.diagonal)))[:PIXELS]
    with Gatherer(ctx, world, "raster", 128) as fine:
        return Bends(scene_hash(world), pixels, np.stack([fine(sites_at(view, pixels + step)).E for step in np.array(ROUND)]))


def main() -> None:
    """Make the file."""
    with context.shared() as ctx:
        made: list[tuple[str, Slopes | Bends]] = [(name, make_slopes(ctx, irrsplat.load(name))) for name in SLOPES]
        made.append(("cornell", make_bends(ctx, irrsplat.load("cornell"))))
    arrays: dict[str, Any] = {}
    for name, truth in made:
        arrays |= {f"{type(truth).__name__}/{name}/{key}": value for key, value in asdict(truth).items()}
    np.savez_compressed(FILE, **arrays)
    print(f"{FILE}: {FILE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
