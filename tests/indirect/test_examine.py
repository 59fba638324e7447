"""Examination against numpy: requesting pixels, the least covered pixel of a tile, and the distance of sites."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import NOTHING_SEEN, SplatBuffer
from irrsplat.gpu.target import float_texture
from irrsplat.indirect.examine import Examination, ExaminePass, choose, tile_side
from irrsplat.settings import Settings
from tests.support.worlds import error_scale, gbuffer_of

TOLERANCE = 2.5
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709


def made_up(size: tuple[int, int], seed: int) -> dict[str, np.ndarray]:
    """Return random positions and normals, an eighth of the pixels empty, weights half 0 and some equal."""
    rng = np.random.default_rng(seed)
    shape = (size[1], size[0])
    normal, geometric = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in rng.normal(size=(2, *shape, 3)))
    weight = np.where(rng.random(shape) < 0.5, 0.0, np.round(rng.uniform(0.0, 6.0, shape), 1))
    sums = rng.uniform(0.0, 2.0, (*shape, 4)) * np.where(weight > 0.0, 1.0, 0.0)[..., None]
    squares = (sums[..., :3] @ LUMINANCE) ** 2 / np.maximum(sums[..., 3], 1e-20) * (1.0 + rng.uniform(0.0, 0.3, shape))
    depth = np.where(rng.random(shape) < 0.125, 0.0, rng.uniform(1.0, 2.0, shape))
    depth[: shape[0] // 3, : shape[1] // 3] = 0.0  # whole empty tiles
    surface = {"position": rng.normal(size=(*shape, 3)), "normal": normal, "geometric": geometric, "depth": depth}
    return surface | {"weight": weight, "sums": sums, "squares": squares}


def counted(data: dict[str, np.ndarray], spread: float, dark: float = 0.0) -> np.ndarray:
    """Return Σw (H, W), reduced where inter-record variance is high.

    Below three tolerances, a standard deviation of luminance above `spread` of the mean (or of the error scale of dark and
    bright pixels) limits Σw in proportion.
    """
    weight, sums, squares = (data[name].astype("f4").astype(float) for name in ("weight", "sums", "squares"))
    k = np.maximum(sums[..., 3], 1e-20)
    mean = sums[..., :3] @ LUMINANCE / k
    off = np.sqrt(np.maximum(squares / k - mean**2, 0.0))
    doubted = (weight < 3.0 * TOLERANCE) & (off > 0.0) & (spread > 0.0)
    return np.where(doubted, np.minimum(weight, TOLERANCE * spread * error_scale(mean, dark) / np.maximum(off, 1e-20)), weight)


def examine(
    ctx: moderngl.Context,
    size: tuple[int, int],
    data: dict[str, np.ndarray],
    seed: int = 0,
    spread: float = 0.0,
    dark: float = 0.0,
) -> tuple[Examination, int]:
    gbuffer = gbuffer_of(ctx, data["position"], data["normal"], data["depth"], geometric=data["geometric"])
    weight, sums, there = float_texture(ctx, size, 2), float_texture(ctx, size, 4), data["depth"] > 0.0
    pair = np.stack([np.where(there, data["weight"], NOTHING_SEEN), np.where(there, data["squares"], 0.0)], -1)
    weight.write(pair[::-1].astype("f4").tobytes())
    sums.write(np.where(there[..., None], data["sums"], 0.0)[::-1].astype("f4").tobytes())
    examination = ExaminePass(ctx)
    settings = Settings(tolerance=TOLERANCE, spread=spread, seed=seed)
    found = examination(gbuffer, SplatBuffer(sums, weight, dark, 1), settings)
    return found, tile_side(size, 1)


def tiles(values: np.ndarray, side: int, fill: float) -> np.ndarray:
    """Return the pixels (h, w, side²) of every tile, top row first; tiles start at the bottom left, as in OpenGL."""
    height, width = values.shape
    padded = np.full((-(-height // side) * side, -(-width // side) * side), fill)
    padded[:height, :width] = values[::-1]
    blocks = padded.reshape(padded.shape[0] // side, side, -1, side).swapaxes(1, 2)
    return blocks.reshape(*blocks.shape[:2], -1)[::-1]


@pytest.mark.parametrize(
    ("size", "spread", "dark"), [((1, 1), 0.0, 0.0), ((33, 41), 0.0, 0.0), ((33, 41), 0.2, 0.7), ((40, 530), 0.2, 0.7)]
)
def test_examination_equals_numpy(ctx: moderngl.Context, size: tuple[int, int], spread: float, dark: float) -> None:
    data = made_up(size, seed=size[0])
    found, side = examine(ctx, size, data, spread=spread, dark=dark)
    weight, surface = counted(data, spread, dark), data["depth"] > 0.0
    asks = surface & (weight < np.float32(TOLERANCE))
    assert np.array_equal(found.requests, tiles(asks, side, 0).sum(-1))
    assert np.array_equal(found.seen, tiles(surface, side, 0).sum(-1))
    assert found.missing == pytest.approx(asks.sum() / max(surface.sum(), 1))
    if spread and asks.size > 1000:
        doubted = asks & (data["weight"] >= TOLERANCE)
        assert doubted.sum() / asks.sum() > 0.02 and (surface & ~asks).any()

    least = tiles(np.where(asks, weight, np.inf), side, np.inf).min(-1)
    names = map(tuple, data["position"].astype("f4").reshape(-1, 3))
    place = dict(zip(names, np.ndindex(size[1], size[0]), strict=True))
    index = tiles(np.arange(size[0] * size[1]).reshape(size[1], size[0]), side, -1)
    for tile in np.argwhere(found.requests > 0):
        at = tuple(tile)
        pixel = place[tuple(found.position[at])]
        assert pixel[0] * size[0] + pixel[1] in index[at], "a tile names one of its own pixels"
        assert asks[pixel] and weight[pixel] == pytest.approx(least[at], rel=1e-3), "and the one that is served worst"
        assert np.allclose(found.normal[at], data["normal"][pixel], atol=1e-6)
        site = found.at(tuple(tile[:, None]))
        assert np.array_equal(site.position[0], found.position[at]) and np.array_equal(site.normal[0], found.normal[at])
        assert np.allclose(site.geometric[0], data["geometric"][pixel], atol=1e-6)


@pytest.mark.parametrize(("spacing", "colour"), [(1, -1), (2, 1), (8, 0)])
def test_sites_of_a_round_lie_apart(spacing: int, colour: int) -> None:
    """One requesting tile is chosen in each square of `spacing` tiles, of one colour of the chess board or of all squares."""
    requests = np.random.default_rng(3).integers(0, 3, (23, 31))
    rows, columns = choose(requests, spacing, colour, seed=0)
    assert (requests[rows, columns] > 0).all()
    squares = list(zip((rows // spacing).tolist(), (columns // spacing).tolist(), strict=True))
    assert len(set(squares)) == len(squares)
    requested = {
        (r // spacing, c // spacing)
        for r, c in np.argwhere(requests > 0).tolist()
        if colour < 0 or (r // spacing + c // spacing) % 2 == colour
    }
    assert set(squares) == requested, "no square that asks is left out"
    again = choose(requests, spacing, colour, seed=0)
    assert np.array_equal(rows, again[0]) and np.array_equal(columns, again[1])
