"""Selection of the tiles that get a record in this round: coarse to fine, on a chessboard."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

_FEW = 256  # tiles that need a record: so few are served at once, without going from coarse to fine
FEWER = 64  # tiles that need a record: so few get one each; of more, neighbours would do with one together


class Chessboard(NamedTuple):
    """Squares of the screen that get a record each in a round.

    width: of a square, in tiles. colour: of the squares that are used, 0 or 1 (-1: both). last: whether none but such rounds
    follow, so that there are records about each site already.
    """

    width: int
    colour: int
    last: bool


def chessboard(step: int, reach: float, asking: int) -> Chessboard:
    """Return the chessboard for step 0, 1, 2, … of a view in which so many tiles are `asking`.

    The squares shrink from the farthest reach of a record (`reach`, in tiles) to two tiles, with two steps for each width; then
    come those of two tiles of both colours, and single tiles where few are asking. If only few are from the start, as after a
    small move of the camera, it is these at once.
    """
    levels = 0 if asking < _FEW else max(int(math.log2(max(reach, 1.0))), 0)
    if step < 2 * levels:
        return Chessboard(2 ** (levels - step // 2), step % 2, False)
    if asking < _FEW and step == 0:
        return Chessboard(2, -1, False)
    return Chessboard(1 if asking < FEWER else 2, -1, True)


def choose(asking: np.ndarray, board: Chessboard, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The (rows, columns) of the chosen tiles: one at random in each used square of the board that has any with asking > 0.

    The tiles come in random order, so that the first few are spread over the screen.
    """
    height, width = asking.shape
    rows, columns = np.nonzero(asking > 0)
    if not len(rows):
        return rows, columns
    side, colour = board.width, board.colour
    squares = (rows // side) * -(-width // side) + columns // side
    if colour >= 0:
        mine = (rows // side + columns // side) % 2 == colour
        rows, columns, squares = rows[mine], columns[mine], squares[mine]
    order = np.random.default_rng((seed, side, colour + 1)).permutation(height * width)[rows * width + columns]
    pick = np.lexsort((order, squares))
    _, first = np.unique(squares[pick], return_index=True)
    chosen = pick[first][np.argsort(order[pick[first]])]
    return rows[chosen], columns[chosen]
