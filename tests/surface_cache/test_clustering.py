"""Sites for members without one of their own cluster."""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.surface_cache.clustering import near_sites


def scattered(count: int, side: float) -> Sites:
    """Return members at random places of a cube of this side that face anywhere."""
    random = np.random.default_rng(0)
    normal = random.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    position = random.uniform(0.0, side, (count, 3))
    return Sites(position, normal, normal)


def test_the_nearest_sites_that_face_alike_come_in_their_order() -> None:
    """All members lie in one block of the smallest kind: a comparison of all pairs is the oracle."""
    members, size = scattered(300, 3.0), 12.0
    requesting, sites = np.arange(100), np.arange(100, 300)
    found = near_sites(members, requesting, sites, size, 5)
    for member, nearest in zip(requesting, found, strict=True):
        apart = ((members.position[sites] - members.position[member]) / size) ** 2
        distance = (apart + (members.normal[sites] - members.normal[member]) ** 2).sum(1)
        distance[members.normal[sites] @ members.normal[member] <= 0.3] = np.inf
        order = np.argsort(distance)[:5]
        np.testing.assert_array_equal(nearest, np.where(np.isfinite(distance[order]), order, -1))


def test_a_far_site_contributes_where_none_is_near() -> None:
    """A site at five steps is in the wide block of the member alone; one that faces the other way is never taken."""
    up = np.array([[0.0, 0.0, 1.0]] * 3)
    position = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    members = Sites(position, up * np.array([[1.0], [1.0], [-1.0]]), up)
    np.testing.assert_array_equal(near_sites(members, np.array([0]), np.array([1, 2]), 1.0, 2), [[0, -1]])


def test_members_without_any_site_have_none() -> None:
    """Without sites there is nothing to find, and without members nothing to request."""
    members = scattered(4, 1.0)
    none = np.zeros(0, np.intp)
    np.testing.assert_array_equal(near_sites(members, np.arange(4), none, 1.0, 3), np.full((4, 3), -1))
    assert near_sites(members, none, np.arange(4), 1.0, 3).shape == (0, 3)
