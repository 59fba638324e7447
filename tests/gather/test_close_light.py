"""Hits that are origins of the second gather at close hits."""

from __future__ import annotations

import numpy as np

from irrsplat.gather.close_light import drawn
from irrsplat.gather.record_frame import PLACES, places_of_texels
from irrsplat.gather.stratified import LEAST_SIDE, shape


def test_places_have_equally_many_rays() -> None:
    """Each of the hits that share a gather has the same weight: a table of first hits has as many rays of each place."""
    counts = np.bincount(places_of_texels(shape(LEAST_SIDE)[::-1], PLACES), minlength=PLACES)
    assert (counts == LEAST_SIDE**2 // PLACES).all()


def test_hits_are_drawn_in_proportion_to_their_weights() -> None:
    """Systematic sampling draws a hit as often as its share of the draws, rounded up or down; hits without weight never."""
    weights = np.random.default_rng(1).random((3, 64)) * (np.arange(64) % 3 > 0)
    gathers = np.array([1, 5, 40])
    record, texel, rank = drawn(weights, gathers)
    counts = np.zeros(weights.shape)
    np.add.at(counts, (record, texel), 1)
    expected = PLACES * gathers[:, None] * weights / weights.sum(1, keepdims=True)
    assert (np.abs(counts - expected) < 1.0 + 1e-9).all() and not counts[weights == 0.0].any()
    assert (np.bincount(record) == PLACES * gathers).all() and (rank[record == 2] == np.arange(PLACES * 40)).all()


def test_a_gather_has_hits_of_all_parts_of_the_hemisphere() -> None:
    """A gather has one hit in each of PLACES equal parts of the weights, in places that differ from gather to gather."""
    _, texel, rank = drawn(np.ones((1, 64)), np.array([4]))
    part = (texel * PLACES // 64).reshape(-1, PLACES)
    assert (np.sort(part, axis=1) == np.arange(PLACES)).all()
    assert (np.sort(part[:, 0]) == np.arange(4)).all() and len(rank) == 4 * PLACES
