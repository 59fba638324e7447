"""References from fine gathers in bundled scenes, in fine.npz; `python -m tests.support.fine` writes the file in minutes.

Each reference stores its scene's hash; write the file again after a change of a scene. Luminances, Rec. 709.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path

import moderngl
import numpy as np

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.indirect.paper_scan import Seen, read_back
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from tests.support.truth import scene_hash
from tests.support.worlds import Lit, shared

FILE = Path(__file__).with_suffix(".npz")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
SIZE = 200  # pixels per side of the picture for Bends
PIXELS = 400  # chosen pixels
ROUND = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))  # a pixel and its neighbours


@dataclass(frozen=True)
class Bends:
    """E (5, N) at ROUND of N smooth pixels (N, 2), row and column, in the first view of `cornell`, by 49 thousand directions."""

    hash: str
    pixels: np.ndarray
    E: np.ndarray


def seen(ctx: moderngl.Context, world: Scene, side: int) -> Seen:
    """Return the first camera's visible surfaces at side² pixels."""
    with irrsplat.Renderer(world, (side, side), ctx=ctx, bounces=1) as renderer:
        return read_back(renderer.frame(gather=False)[0].gbuffer)


def sites_at(view: Seen, pixels: np.ndarray) -> Sites:
    """Return the points at pixels (N, 2)."""
    at = tuple(pixels.T)
    return Sites(view.position[at], view.normal[at], view.geometric[at])


# ---- the file ---------------------------------------------------------------------------------------------------------


def load(name: str, world: Scene) -> Bends:
    """Return the reference for the bundled scene `name`, which is `world`."""
    with np.load(FILE) as data:
        found = {field.name: data[f"Bends/{name}/{field.name}"] for field in fields(Bends)}
    found["hash"] = found["hash"].item()
    assert found["hash"] == scene_hash(world), f"{name} has changed: run `python -m tests.support.fine`"
    return Bends(**found)


def main() -> None:
    """Write the file: the reference around random smooth pixels."""
    world = irrsplat.load("cornell")
    with shared() as ctx, Lit(ctx, world, Settings().shadow_size) as lit:
        view = seen(ctx, world, SIZE)
        pixels = np.random.default_rng(2).permutation(np.argwhere(view.smooth(0.002 * world.diagonal)))[:PIXELS]
        E = [lit.gather(sites_at(view, pixels + step), 222).E @ LUMINANCE for step in np.array(ROUND)]
    arrays = asdict(Bends(scene_hash(world), pixels, np.stack(E)))
    np.savez_compressed(FILE, **{f"Bends/cornell/{key}": value for key, value in arrays.items()})
    print(f"{FILE}: {FILE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
