"""Selection of the tiles that get a record in a round: coarse to fine, on a chessboard."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

_FEW = 64  # tiles that request a record: so few get one each at once, without going from coarse to fine


class Chessboard(NamedTuple):
    """Squares of the screen that get one record each in a round.

    width: of a square, in tiles. colour: of the squares in use, 0 or 1; -1 for both, in the last rounds, when each site has
    records around it.
    """

    width: int
    colour: int


def chessboard(step: int, reach: float, requests: int) -> Chessboard:
    """Return the chessboard for step 0, 1, 2, … of a view with so many tiles that request a record (`requests`).

    The squares shrink from the farthest reach of a record (`reach`, in tiles) to two tiles, with two steps for each width; then
    come those of two tiles of both colours, or single tiles where few request a record. A view with few requests from the start,
    for example after a small move of the camera, begins with these.
    """
    levels = 0 if requests < _FEW else max(int(math.log2(max(reach, 1.0))), 0)
    if step < 2 * levels:
        return Chessboard(2 ** (levels - step // 2), step % 2)
    return Chessboard(1 if requests < _FEW else 2, -1)


def choose(requests: np.ndarray, board: Chessboard, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the (rows, columns) of the chosen tiles: a random tile with requests > 0 in each used square of the board.

    The tiles come in random order, so that the first few are spread over the screen.
    """
    height, width = requests.shape
    rows, columns = np.nonzero(requests > 0)
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
