"""The examination against numpy: which pixels ask, which of a tile is served worst, and how sites keep apart."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import NOTHING_SEEN, SplatBuffer
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gpu.target import float_texture
from irrsplat.indirect.examine import Examination, ExaminePass, tile_side
from irrsplat.indirect.site_selection import Chessboard, chessboard, choose
from irrsplat.settings import Settings
from tests.support.worlds import encode, error_scale, gbuffer_of

TOLERANCE = 2.5
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709


def made_up(size: tuple[int, int], seed: int) -> dict[str, np.ndarray]:
    """Random positions and normals, an eighth of the pixels seeing nothing, weights of which half are 0 and some are equal."""
    rng = np.random.default_rng(seed)
    shape = (size[1], size[0])
    normal, geometric = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in rng.normal(size=(2, *shape, 3)))
    weight = np.where(rng.random(shape) < 0.5, 0.0, np.round(rng.uniform(0.0, 6.0, shape), 1))
    sums = rng.uniform(0.0, 2.0, (*shape, 4)) * np.where(weight > 0.0, 1.0, 0.0)[..., None]
    squares = (sums[..., :3] @ LUMINANCE) ** 2 / np.maximum(sums[..., 3], 1e-20) * (1.0 + rng.uniform(0.0, 0.3, shape))
    depth = np.where(rng.random(shape) < 0.125, 0.0, rng.uniform(1.0, 2.0, shape))
    depth[: shape[0] // 3, : shape[1] // 3] = 0.0  # whole tiles that see nothing
    surface = {"position": rng.normal(size=(*shape, 3)), "normal": normal, "geometric": geometric, "depth": depth}
    return surface | {"weight": weight, "sums": sums, "squares": squares}


def counted(data: dict[str, np.ndarray], spread: float, dark: float = 0.0) -> np.ndarray:
    """(H, W) Σw, or where that is below three tolerances and the luminances deviate from their mean by more than `spread` of
    it, or of what it counts as where it is dark or bright, so much less than the tolerance."""
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
    borrow: int = 0,
    stride: int = 1,
) -> tuple[Examination, int]:
    names = ("position", "normal", "depth", "geometric")
    surface = {name: data[name].repeat(stride, axis=0).repeat(stride, axis=1) for name in names}
    gbuffer = gbuffer_of(ctx, surface["position"], surface["normal"], surface["depth"], geometric=surface["geometric"])
    weight, sums, there = float_texture(ctx, size, 2), float_texture(ctx, size, 4), data["depth"] > 0.0
    pair = np.stack([np.where(there, data["weight"], NOTHING_SEEN), np.where(there, data["squares"], 0.0)], -1)
    weight.write(pair[::-1].astype("f4").tobytes())
    sums.write(np.where(there[..., None], data["sums"], 0.0)[::-1].astype("f4").tobytes())
    examination = ExaminePass(ctx)
    settings = Settings(tolerance=TOLERANCE, spread=spread, seed=seed, borrow=borrow)
    found = examination(gbuffer, SplatBuffer(sums, weight, dark, stride), settings)
    return found, tile_side((stride * size[0], stride * size[1]), stride)


def tiles(values: np.ndarray, side: int, fill: float) -> np.ndarray:
    """(h, w, side²) the pixels of every tile; tiles are counted from the bottom left, as OpenGL does, and come back top first."""
    height, width = values.shape
    padded = np.full((-(-height // side) * side, -(-width // side) * side), fill)
    padded[:height, :width] = values[::-1]
    blocks = padded.reshape(padded.shape[0] // side, side, -1, side).swapaxes(1, 2)
    return blocks.reshape(*blocks.shape[:2], -1)[::-1]


@pytest.mark.parametrize(("spread", "dark"), [(0.0, 0.0), (0.2, 0.0), (0.2, 0.7), (0.2, 0.02), (0.5, 0.0)])
@pytest.mark.parametrize("size", [(1, 1), (7, 5), (33, 41), (200, 310), (90, 530)])
def test_examination_equals_numpy(ctx: moderngl.Context, size: tuple[int, int], spread: float, dark: float) -> None:
    data = made_up(size, seed=size[0])
    found, side = examine(ctx, size, data, spread=spread, dark=dark)
    weight, surface = counted(data, spread, dark), data["depth"] > 0.0
    asks = surface & (weight < np.float32(TOLERANCE))
    assert np.array_equal(found.asking, tiles(asks, side, 0).sum(-1))
    assert np.array_equal(found.seen, tiles(surface, side, 0).sum(-1))
    assert found.missing == pytest.approx(asks.sum() / max(surface.sum(), 1))
    if spread and asks.size > 1000:
        doubted = asks & (data["weight"] >= TOLERANCE)
        assert doubted.sum() / asks.sum() > 0.02 and (surface & ~asks).any()

    least = tiles(np.where(asks, weight, np.inf), side, np.inf).min(-1)
    names = map(tuple, data["position"].astype("f4").reshape(-1, 3))
    place = dict(zip(names, np.ndindex(size[1], size[0]), strict=True))
    index = tiles(np.arange(size[0] * size[1]).reshape(size[1], size[0]), side, -1)
    for tile in np.argwhere(found.asking > 0):
        at = tuple(tile)
        pixel = place[tuple(found.position[at])]
        assert pixel[0] * size[0] + pixel[1] in index[at], "a tile names one of its own pixels"
        assert asks[pixel] and weight[pixel] == pytest.approx(least[at], rel=1e-3), "and the one that is served worst"
        assert np.allclose(found.normal[at], data["normal"][pixel], atol=1e-6)
        site = found.at(tuple(tile[:, None]))
        assert np.array_equal(site.position[0], found.position[at]) and np.array_equal(site.normal[0], found.normal[at])
        assert np.allclose(site.geometric[0], data["geometric"][pixel], atol=1e-6)


@pytest.mark.parametrize("stride", [1, 2])
def test_small_groups_of_pixels_borrow_where_there_is_something_to_borrow(ctx: moderngl.Context, stride: int) -> None:
    """Of the 25 pixels around, or the 9 of every other pixel, so many may ask, or half as many; where records contradict each
    other badly a pixel asks all the same, and where none is near, or those that lend contradict each other."""
    size, borrow, spread = (90, 130), 9, 0.05
    data = made_up(size, 3)
    apart = np.concatenate([np.eye(3), -np.eye(3), np.ones((1, 3)), -np.ones((1, 3)), [[1.0, -1.0, 1.0]]])  # no two faces alike
    data["normal"] = np.tile((apart / np.linalg.norm(apart, axis=1)[:, None]).reshape(3, 3, 3), (50, 50, 1))[: size[1], : size[0]]
    data["weight"] = np.where(np.random.default_rng(1).random(data["weight"].shape) < 0.6, 4.0 * TOLERANCE, data["weight"])
    lent = np.random.default_rng(2).random(data["weight"].shape) < 0.5
    lent &= data["weight"] == 0.0
    data["sums"][lent] = 1e-6
    off = np.random.default_rng(4).uniform(0.0, 1.2, lent.shape)  # deviation over mean of what they say
    data["squares"] = np.where(lent, 1e-6 * (1.0 + off**2), data["squares"])
    found, side = examine(ctx, size, data, spread=spread, borrow=borrow, stride=stride)
    weight, surface = counted(data, spread), data["depth"] > 0.0
    asks = surface & (weight < np.float32(TOLERANCE))
    around = 2 if stride == 1 else 1
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(asks, around, "edge"), (2 * around + 1,) * 2)
    small = windows.sum((2, 3)) <= borrow // stride
    mild = np.where(data["weight"] > 0.0, weight >= TOLERANCE * spread / 0.15, lent & (off <= 0.6))
    reached = data["weight"] > 0.0
    for cause in (small & ~mild, small & lent & ~mild, ~small & mild, small & mild & reached, small & mild & ~reached):
        assert (asks & cause).sum() > 5
    assert np.array_equal(found.asking, tiles(asks & ~(small & mild), side, 0).sum(-1))


def test_what_does_not_fit_to_the_pixels_beside_is_not_borrowed(ctx: moderngl.Context) -> None:
    """Lone pixels in a plane, amid others of 2 and 3 W/m², of a quarter of that and of a hundredth. They borrow what is at least
    an eighth of the darkest of these, and at most eight times the brightest or what is dark; and what differs from each by no
    more than half of what errors are judged by there, or where it begins to be bright. Beside surfaces that face elsewhere
    they do."""
    size, borrow, dark = (120, 60), 9, 0.05
    data = made_up(size, 5)
    data["normal"][:], data["depth"][:], data["weight"][:] = (0.0, 1.0, 0.0), 1.0, 4.0 * TOLERANCE
    light = np.repeat([1.0, 0.25, 0.01], 40)
    darkest, brightest = np.broadcast_to(2.0 * light, data["weight"].shape), np.broadcast_to(3.0 * light, data["weight"].shape)
    data["sums"][:] = 1.0
    data["sums"][..., :3] = np.where(np.arange(size[0]) % 2 == 0, brightest, darkest)[..., None]
    lone = np.zeros(data["weight"].shape, bool)
    lone[2:-2:4, 2:-2:4] = True
    rng = np.random.default_rng(6)
    lent = np.where(lone, rng.choice([0.0, 0.05, 0.07, 0.35, 0.5, 1.2, 1.8, 2.0, 2.9, 3.1, 3.5], lone.shape), 0.0)
    turned = lone & (rng.random(lone.shape) < 0.2)
    data["normal"][turned] = (1.0, 0.0, 0.0)
    data["weight"][lone] = 0.0
    data["sums"][lone] = 1e-6 * np.concatenate([np.repeat(lent[lone][:, None], 3, 1), np.ones((lone.sum(), 1))], axis=1)
    mean = data["sums"][..., :3] @ LUMINANCE / data["sums"][..., 3]
    data["squares"] = data["sums"][..., 3] * mean**2
    found, side = examine(ctx, size, data, dark=dark, borrow=borrow)
    unlike = (8.0 * np.maximum(lent, dark) < darkest) | (lent > 8.0 * np.maximum(brightest, dark))
    far = np.maximum(lent - darkest, brightest - lent) > 0.5 * error_scale(np.maximum(brightest, 32.0 * dark), dark)
    flush = lone & ~turned
    for kind in (flush & unlike & ~far, flush & far & ~unlike, flush & ~far & ~unlike, turned & (far | unlike)):
        assert kind.sum() > 5
    assert np.array_equal(found.asking, tiles(flush & (far | unlike), side, 0).sum(-1))


def test_equal_pixels_of_a_tile_are_chosen_at_random(ctx: moderngl.Context) -> None:
    """Where all weights are 0, every place in a tile is chosen about equally often, and another seed chooses otherwise."""
    size = (300, 300)
    data = made_up(size, 1)
    data["depth"][:], data["weight"][:] = 1.0, 0.0
    y, x = np.indices((size[1], size[0]))
    data["position"] = np.stack([x, y, 0 * x], -1).astype(float)
    (one, side), (other, _) = examine(ctx, size, data), examine(ctx, size, data, seed=1)
    assert not np.array_equal(one.position, other.position)
    assert np.array_equal(one.position, examine(ctx, size, data)[0].position), "the same seed, the same bits"
    inside = one.position[..., :2].astype(int) % side
    times = np.bincount((inside[..., 1] * side + inside[..., 0]).ravel(), minlength=side**2)
    expected = one.asking.size / side**2
    assert times.min() > 0.7 * expected and times.max() < 1.3 * expected, times


def test_no_pixel_needs_a_record_where_all_have_enough_weight(ctx: moderngl.Context) -> None:
    data = made_up((20, 20), 2)
    data["weight"][:] = TOLERANCE  # not below it
    found, _ = examine(ctx, (20, 20), data)
    assert not found.asking.any() and found.missing == 0.0


@pytest.mark.parametrize(("other", "weight", "asks"), [(1.3, 1.2, False), (2.0, 1.2, True), (2.0, 3.1, False), (0.0, 1.2, True)])
def test_a_pixel_needs_a_record_where_its_records_contradict_each_other(
    ctx: moderngl.Context, other: float, weight: float, asks: bool
) -> None:
    """Two records of like weight say 1 and `other`: deviation over mean is |1 - other|/(1 + other), allowed is 0.3. Near a
    record, by three tolerances of weight, that does not count."""
    data = made_up((20, 20), 2)
    data["depth"][:], data["weight"][:] = 1.0, weight * TOLERANCE
    data["sums"][:] = [0.7 * (1.0 + other)] * 3 + [1.4]
    data["squares"][:] = 0.7 * (1.0 + other**2)
    found, _ = examine(ctx, (20, 20), data, spread=0.3)
    assert found.missing == float(asks)


@pytest.mark.parametrize("light", [0.0, 1e-30, 3.0, 1e8])
def test_a_pixel_of_one_record_or_of_records_that_agree_needs_no_other(ctx: moderngl.Context, light: float) -> None:
    """Black and the very bright too: Σ k·Y² / Σ k - Y² is nothing but rounding then."""
    data = made_up((40, 40), 2)
    k = np.random.default_rng(1).uniform(0.01, 9.0, (40, 40))
    data["weight"][:] = TOLERANCE * 1.1
    data["sums"] = np.stack([light * k] * 3 + [k], -1).astype("f4")
    data["squares"] = (k * np.float32(light) ** 2).astype("f4")
    found, _ = examine(ctx, (40, 40), data, spread=0.05)
    assert not found.asking.any()


def test_octahedral_map_is_a_round_trip() -> None:
    v = np.random.default_rng(0).normal(size=(1000, 3))
    v[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    assert np.allclose(octahedral_decode(*encode(v).T), v, atol=1e-12)


@pytest.mark.parametrize("spacing", [1, 2, 4, 8])
@pytest.mark.parametrize("colour", [-1, 0, 1])
def test_sites_of_a_round_lie_apart(spacing: int, colour: int) -> None:
    """One asking tile of each square of `spacing` tiles, the squares of one colour of the chess board, or all."""
    asking = np.random.default_rng(3).integers(0, 3, (23, 31))
    rows, columns = choose(asking, Chessboard(spacing, colour, False), seed=0)
    assert (asking[rows, columns] > 0).all()
    squares = list(zip((rows // spacing).tolist(), (columns // spacing).tolist(), strict=True))
    assert len(set(squares)) == len(squares)
    wanted = {
        (r // spacing, c // spacing)
        for r, c in np.argwhere(asking > 0).tolist()
        if colour < 0 or (r // spacing + c // spacing) % 2 == colour
    }
    assert set(squares) == wanted, "no square that asks is left out"
    again = choose(asking, Chessboard(spacing, colour, False), seed=0)
    assert np.array_equal(rows, again[0]) and np.array_equal(columns, again[1])


def test_every_tile_of_a_square_can_be_chosen() -> None:
    chosen = {tuple(np.concatenate(choose(np.ones((4, 4)), Chessboard(4, -1, True), seed)).tolist()) for seed in range(200)}
    assert len(chosen) == 16


def test_no_tile_in_need_gives_no_site() -> None:
    rows, columns = choose(np.zeros((5, 5)), Chessboard(2, 0, False), 0)
    assert len(rows) == len(columns) == 0


def test_squares_shrink_to_two_tiles_and_to_one_where_few_ask() -> None:
    """From the reach of 9 tiles down by halves, each width with one colour and then the other; few tiles are served at once."""
    boards = [chessboard(step, 9.0, 1000) for step in range(9)]
    widths = [8, 8, 4, 4, 2, 2]
    assert boards[:6] == [Chessboard(width, step % 2, False) for step, width in enumerate(widths)]
    assert boards[6:] == [Chessboard(2, -1, True)] * 3
    assert chessboard(8, 9.0, 200) == Chessboard(2, -1, True) and chessboard(8, 9.0, 63) == Chessboard(1, -1, True)
    assert [chessboard(step, 9.0, 200) for step in (0, 1)] == [Chessboard(2, -1, False), Chessboard(2, -1, True)]
    assert [chessboard(step, 9.0, 20) for step in (0, 1)] == [Chessboard(2, -1, False), Chessboard(1, -1, True)]
    assert chessboard(0, 0.5, 1000) == Chessboard(2, -1, True), "where no record reaches a tile far, there is nothing to shrink"
