"""Which of the tiles that ask get a record in this round: coarse to fine, on a chessboard."""

from __future__ import annotations

import math

import numpy as np

_FEW = 256  # tiles; so few are asked for in one round


def spacing(step: int, reach: float, asking: int) -> tuple[int, int]:
    """The spacing in tiles, and the colour of the chess board (-1: both), for a view's step 0, 1, 2, …

    From squares as wide as the farthest reach of a record (`reach`, in tiles) down to single tiles, two steps each; where
    few tiles are `asking`, as after a small move of the camera, at once.
    """
    if asking < _FEW:
        return (2, -1) if step == 0 else (1, -1)
    levels = max(int(math.log2(max(reach, 1.0))), 0)
    level = step // 2
    return (2 ** (levels - level), step % 2) if level < levels else (1, -1)


def choose(asking: np.ndarray, spacing: int, phase: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """At most one asking tile in every other square of `spacing` tiles: (rows, columns).

    The squares are taken like the fields of a chess board, `phase` 0 or 1 the colour (-1: both); of a square, a tile
    drawn at random asks. They come in random order, so that the first few are spread over the screen.
    """
    height, width = asking.shape
    rows, columns = np.nonzero(asking > 0)
    squares = (rows // spacing) * -(-width // spacing) + columns // spacing
    if phase >= 0:
        mine = (rows // spacing + columns // spacing) % 2 == phase
        rows, columns, squares = rows[mine], columns[mine], squares[mine]
    order = np.random.default_rng((seed, spacing, phase + 1)).permutation(height * width)[rows * width + columns]
    pick = np.lexsort((order, squares))
    _, first = np.unique(squares[pick], return_index=True)
    chosen = pick[first][np.argsort(order[pick[first]])]
    return rows[chosen], columns[chosen]
