"""Which of the tiles that need a record get one in this round: coarse to fine, on a chessboard."""

from __future__ import annotations

import math

import numpy as np

_FEW = 256  # tiles that need a record: so few are served at once, without going from coarse to fine


def spacing(step: int, reach: float, asking: int) -> tuple[int, int]:
    """The width in tiles of the chessboard's squares, and the colour to use (-1: both), for a view's step 0, 1, 2, …

    The squares shrink from the farthest reach of a record (`reach`, in tiles) to single tiles, with two steps for each width. If
    only few tiles are `asking`, as after a small move of the camera, they are small from the start.
    """
    if asking < _FEW:
        return (2, -1) if step == 0 else (1, -1)
    levels = max(int(math.log2(max(reach, 1.0))), 0)
    level = step // 2
    return (2 ** (levels - level), step % 2) if level < levels else (1, -1)


def choose(asking: np.ndarray, spacing: int, phase: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The (rows, columns) of the chosen tiles: one at random in each square of the chessboard that has any with asking > 0.

    spacing: the width of a square in tiles. phase: the colour of the squares, 0 or 1 (-1: both). The tiles come in random order,
    so that the first few are spread over the screen.
    """
    height, width = asking.shape
    rows, columns = np.nonzero(asking > 0)
    if not len(rows):
        return rows, columns
    squares = (rows // spacing) * -(-width // spacing) + columns // spacing
    if phase >= 0:
        mine = (rows // spacing + columns // spacing) % 2 == phase
        rows, columns, squares = rows[mine], columns[mine], squares[mine]
    order = np.random.default_rng((seed, spacing, phase + 1)).permutation(height * width)[rows * width + columns]
    pick = np.lexsort((order, squares))
    _, first = np.unique(squares[pick], return_index=True)
    chosen = pick[first][np.argsort(order[pick[first]])]
    return rows[chosen], columns[chosen]
