"""Places of sites: the ray origins of a site, drawn from the hits of other sites' rays on its cluster.

A site represents its whole cluster, such as the bright and the dark side of a moulding, or a table with objects on it. With the
site as the only ray origin, a dark site in a bright cluster would lose light at each bounce. The rays of a site therefore start
from PLACES places. These are hits of other sites' rays, drawn in proportion to the light that each hit transports. The value of
the site is then the mean over the visible part of its cluster: a Galerkin projection (Zatz 1993, "Galerkin Radiosity") by the
measure of the hits, which conserves the transported light.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.core.vectors import along_a_way, triangle_normals
from irrsplat.gather.record_frame import PLACES
from irrsplat.surface_cache.transport import Transport

_NEAR = 0.3  # of a cluster's width, before halving: rays from closer emissive surfaces count by the square of the distance
_TOUCHING = 0.01  # the least of these shares that counts: a gap thinner than that is no part of the ceiling at its rim
_BOUNCES = 8  # along which the importance of sites is followed


def site_places(
    sites: Sites,
    survey: Transport,
    met: Sequence[np.ndarray],
    R: np.ndarray,
    area: np.ndarray,
    level: np.ndarray,
    corners: np.ndarray,
    emissive: np.ndarray,
    seed: int,
) -> Sites:
    """Return (S·PLACES,) the places of the `sites` (S,), site by site. A site without a hit uses its own position.

    survey: the transport along a few rays from each site. met: positions, normals and triangles of the hits, see TraceGather.met.
    R: (S,) harmonic mean distance from each site, metres. area: (S,) m² of its cluster. level: (S,) see SiteLayout. corners:
    (F, 3, 3) of the triangles. emissive: (F,) True for triangles that emit light.
    """
    assert sites.triangle is not None
    origin, ray, site, share = survey.hits()
    place, shading, face = (column[origin, ray] for column in met)
    weight = _importance(survey, R, area)[origin] * share
    # The gap between a panel and a ceiling is bright and hidden. It must not represent the ceiling around the panel.
    away = ((place - sites.position[origin]) ** 2).sum(1)
    near = np.minimum(away / np.maximum(_NEAR**2 * (area * 4.0**level)[site], 1e-30), 1.0)
    near = np.where(near < _TOUCHING, 0.0, near)
    weight *= np.where(emissive[sites.triangle[origin]], near, 1.0)
    drawn = _drawn(site, weight, place, len(sites), seed)
    hit = drawn[drawn >= 0]
    found = sites[np.repeat(np.arange(len(sites)), PLACES)]
    columns = {name: getattr(found, name) for name in ("position", "normal", "geometric", "triangle")}
    upward = triangle_normals(corners[face[hit]])[0].T
    below = ((sites.position[origin[hit]] - place[hit]) * upward).sum(1) < 0.0
    of_hits = place[hit], shading[hit], np.where(below[:, None], -upward, upward), face[hit]
    for column, values in zip(columns.values(), of_hits, strict=True):
        column[drawn >= 0] = values
    return Sites(**columns)


def _importance(survey: Transport, R: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return (S,) the importance of each site for the visible light, directly or by up to _BOUNCES bounces.

    The camera is not known. At a random place in space, a picture shows a site in proportion to its area times the mean distance
    of the surfaces in front of it. The importance does not depend on lights, so that places stay when lights change.
    """
    importance = seen = area * np.where(area > 0.0, R, 0.0)
    for _ in range(_BOUNCES):
        seen = survey.backward(seen)
        importance = importance + seen
    return importance


def _drawn(sites: np.ndarray, weight: np.ndarray, position: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return (count·PLACES,), the numbers of hits on each of `count` sites; -1 for a site without any.

    sites: (N,) the site of each hit. Hits are drawn by their `weight` (N,), at equal steps of it from a random start, along a
    space-filling curve through their `position` (N, 3). So all parts of a site's cluster are drawn by their shares.
    """
    order = np.flatnonzero(weight > 0.0)
    order = order[np.lexsort((along_a_way(position[order]), sites[order]))]
    bounds = np.searchsorted(sites[order], np.arange(count + 1))
    sums = np.append(0.0, np.cumsum(weight[order]))
    start = np.random.default_rng(seed).random(count)
    steps = (np.arange(PLACES) + start[:, None]) / PLACES
    first, after = bounds[:-1, None], bounds[1:, None]
    at = np.searchsorted(sums[1:], sums[first] + steps * (sums[after] - sums[first]), side="right")
    at = np.clip(at, first, np.maximum(after - 1, first))
    drawn = np.append(order, -1)[np.minimum(at, len(order))]
    return np.where(first < after, drawn, -1).ravel()
