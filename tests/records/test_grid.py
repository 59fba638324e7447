"""Points sorted into cells: none is lost, and a box's cells hold all that lies in the box, wherever the points are."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.records import point_grid

RNG = np.random.default_rng(0)
CLOUDS = {
    "one": np.zeros((1, 3)),
    "all in one place": np.full((5000, 3), 0.7),
    "a floor": RNG.uniform(-3, 3, (5000, 3)) * (1.0, 0.0, 1.0),
    "a house on a wide plain": np.concatenate([RNG.normal(size=(9000, 3)), RNG.normal(size=(1000, 3)) * 1e4]),
    "coordinates that repeat": RNG.integers(0, 5, (5000, 3)),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_the_cells_of_a_box_hold_what_lies_in_it(name: str) -> None:
    points = CLOUDS[name].astype("f4")
    made = point_grid.build(points)
    assert np.array_equal(np.sort(made.order), np.arange(len(points)))
    assert made.starts[0] == 0 and made.starts[-1] == len(points) and (np.diff(made.starts) >= 0).all()
    cell = np.repeat(np.arange(made.cells**3), np.diff(made.starts))
    assert np.array_equal(made.find(points)[made.order], cell), "a cell's points lie between its start and the next one's"
    x, y, z = cell % made.cells, cell // made.cells % made.cells, cell // made.cells**2
    for low, high in np.sort(RNG.choice(points, (20, 2)) + RNG.normal(size=(20, 2, 3)).astype("f4"), axis=1):
        corners = made.find(np.stack([low, high]))
        first, last = (np.array([c % made.cells, c // made.cells % made.cells, c // made.cells**2]) for c in corners)
        near = ((np.stack([x, y, z], 1) >= first) & (np.stack([x, y, z], 1) <= last)).all(1)
        inside = ((points >= low) & (points <= high)).all(1)
        assert near[inside[made.order]].all()


def test_cells_follow_the_points() -> None:
    """Nine in ten lie within a few metres, the rest within kilometres: no cell holds more than one in forty."""
    made = point_grid.build(CLOUDS["a house on a wide plain"].astype("f4"))
    assert made.cells > 8 and np.diff(made.starts).max() < 250


def test_cells_are_numbered_along_x_first_and_a_point_on_a_plane_is_above_it() -> None:
    made = point_grid.build(RNG.normal(size=(5000, 3)).astype("f4"))
    K = made.cells
    corner = np.stack([made.edges[1:K, 0], np.full(K - 1, made.edges[0, 1]), np.full(K - 1, made.edges[K, 2])], axis=1)
    assert K > 2 and made.find(corner).tolist() == [(K - 1) * K * K + x for x in range(1, K)]
