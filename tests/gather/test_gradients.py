"""Irradiance vector and translation gradient of records against an exact occluder scene."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.scene.model import Scene
from tests.support.worlds import Gathered, gather, material, polygon_vector, quad, scene, sites

# A square light of 2 m overhead, and a black board below it that hides part of it: far and near edges, as at a table's rim
EMITTER_HALF, EMITTER_HEIGHT = 1.0, 2.0
BOARD = np.array([[-0.2, 1.0, -0.5], [0.6, 1.0, -0.5], [0.6, 1.0, 0.4], [-0.2, 1.0, 0.4]])


def world() -> Scene:
    """Return the light (L = 1) and the board."""
    point_light = quad((-EMITTER_HALF, EMITTER_HEIGHT, -EMITTER_HALF), (2, 0, 0), (0, 0, 2), material(0.0, 1.0))
    board = quad(BOARD[0], BOARD[1] - BOARD[0], BOARD[3] - BOARD[0], material(0.0))
    return scene(point_light, board)


def vector(p: np.ndarray) -> np.ndarray:
    """Return the exact M = ∫ L·ω·dω (..., 3) at points p (..., 3) below the board, by Lambert's formula for the visible part.

    Seen from p, the board's shadow on the light's plane is its picture scaled about p by (2 - p_y)/(1 - p_y), an
    axis-aligned rectangle. Its intersection with the light is one too.
    """
    grow = (EMITTER_HEIGHT - p[..., 1]) / (1.0 - p[..., 1])

    def rectangle(x0: np.ndarray, x1: np.ndarray, z0: np.ndarray, z1: np.ndarray) -> np.ndarray:
        around = ((x0, z0), (x1, z0), (x1, z1), (x0, z1))
        return polygon_vector(np.stack([np.stack([x, np.full_like(x, EMITTER_HEIGHT), z], -1) for x, z in around], -2), p)

    one = np.full(p.shape[:-1], EMITTER_HALF)
    low = np.maximum(p[..., [0, 2]] + (BOARD[0, [0, 2]] - p[..., [0, 2]]) * grow[..., None], -EMITTER_HALF)
    high = np.minimum(p[..., [0, 2]] + (BOARD[2, [0, 2]] - p[..., [0, 2]]) * grow[..., None], EMITTER_HALF)
    overlap = (high > low).all(-1)
    high = np.maximum(high, low + 1e-9)
    hidden = rectangle(low[..., 0], high[..., 0], low[..., 1], high[..., 1])
    return rectangle(-one, one, -one, one) - np.where(overlap[..., None], hidden, 0.0)


def places(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Return points below the board with a partial view of the light, and normals with the light above their horizon."""
    rng = np.random.default_rng(4)
    p = rng.uniform((-0.9, 0.0, -0.9), (0.9, 0.4, 0.9), (3 * count, 3))
    p = p[np.linalg.norm(vector(p), axis=1) > 0.1][:count]
    n = np.array([0.0, 1.0, 0.0]) + 0.35 * rng.uniform(-1.0, 1.0, (count, 3)) * (1, 0, 1)
    return p, n / np.linalg.norm(n, axis=1, keepdims=True)


def gradient(p: np.ndarray, n: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Return ∇E (N, 3) of E = n·M by central differences."""
    return np.stack([((vector(p + d) - vector(p - d)) * n).sum(-1) / (2 * step) for d in step * np.eye(3)], -1)


def relative(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the median of |found - truth|/|truth| over rows."""
    return float(np.median(np.linalg.norm(found - truth, axis=1) / np.linalg.norm(truth, axis=1)))


@pytest.fixture(scope="module")
def gathered() -> dict[int, Gathered]:
    """Cache of gathers at `places`, by their side; each test adds missing ones."""
    return {}


def at_side(ctx: moderngl.Context, cache: dict[int, Gathered], side: int) -> Gathered:
    if side not in cache:
        cache[side] = gather(ctx, world(), sites(*places()), side)
    return cache[side]


def test_the_exact_scene_is_what_is_gathered(ctx: moderngl.Context) -> None:
    """E of 128² rays equals Lambert's formula: the following tests compare equal scenes."""
    p, n = places(8)
    found = gather(ctx, world(), sites(p, n), 128)
    assert np.allclose(found.E[:, 0], (vector(p) * n).sum(1), rtol=0.01)


def test_irradiance_vector(ctx: moderngl.Context, gathered: dict[int, Gathered], limit: float = 0.03) -> None:
    """M of the part above the record's horizon matches, and E = n_k·M exactly; n·M is E for normals up to 15° off."""
    p, n = places()
    found = at_side(ctx, gathered, 64)
    assert relative(found.M[:, 0], vector(p)) < limit
    assert np.allclose((found.M * n[:, None, :]).sum(-1), found.E, rtol=2e-3, atol=1e-3)
    other = n + 0.26 * np.cross(n, (0.3, 0.1, 0.9))
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    assert np.median(np.abs((found.M[:, 0] * other).sum(1) / (vector(p) * other).sum(1) - 1.0)) < limit


def test_translation_gradient(ctx: moderngl.Context, gathered: dict[int, Gathered]) -> None:
    """∇E matches central differences of the exact E, with less error for finer gathers.

    Over many places and directions, no part of the gradient is missing or counted twice.
    """
    limits = {32: 0.054, 64: 0.025, 128: 0.011}
    p, n = places()
    truth = gradient(p, n)
    error = {side: relative(at_side(ctx, gathered, side).gradient[:, 0], truth) for side in limits}
    assert all(error[side] < limit for side, limit in limits.items()), error
    assert list(error.values()) == sorted(error.values(), reverse=True), error
    found = at_side(ctx, gathered, 128).gradient[:, 0]
    assert (found * truth).sum() / (truth * truth).sum() == pytest.approx(1.0, abs=0.01)
    tangential = [v - (v * n).sum(1, keepdims=True) * n for v in (found, truth)]
    assert (tangential[0] * tangential[1]).sum() / (tangential[1] ** 2).sum() == pytest.approx(1.0, abs=0.01)
