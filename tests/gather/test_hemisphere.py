"""Tables of the gather: solid angles, edges between texels, and tangent frames."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.core.glsl import NEIGHBOUR_STRIDE
from irrsplat.gather.plane import FIELD, plane_edges, plane_table
from irrsplat.gather.record_frame import tangent_frames


def share_of_plane(field: float) -> float:
    """Return the share 0..1 of the cosine-weighted hemisphere on a square plane with a field of view in degrees.

    At distance 1 it extends to t = tan(field/2). The form factor of a point to a parallel rectangle above it with a corner
    over it (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", C-11), four times:
    4/(2π)·2·t/√(1+t²)·atan(t/√(1+t²)) = 4/π·s·atan(s) with s = sin(field/2).
    """
    s = np.sin(np.radians(field) / 2.0)
    return 4.0 / np.pi * s * np.arctan(s)


@pytest.mark.parametrize("side", [4, 16, 32, 64])
def test_the_table_covers_the_plane(side: int) -> None:
    """∫ cosθ dω is π times the form factor; 8×8 points per texel have an error proportional to the texel size squared."""
    table = plane_table(side)
    assert table[..., 3].sum() == pytest.approx(np.pi * share_of_plane(FIELD), rel=0.45 / side**2)
    assert (table[..., 3] > 0.0).all()


def edges(side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return edges with neighbours, as texel numbers a and b and vectors (E, 3)."""
    table = plane_edges(side)
    height, width = table.shape[0], table.shape[1] // 2
    owner = np.arange(height * width).reshape(height, width, 1).repeat(2, 2).ravel()
    rows = table.reshape(-1, 4)
    row = np.floor(rows[:, 3] / NEIGHBOUR_STRIDE)
    other = (row * width + rows[:, 3] - NEIGHBOUR_STRIDE * row).astype(int)
    real = other != owner
    assert not rows[~real, :3].any(), "an edge without a neighbour has no weight"
    return owner[real], other[real], rows[real, :3]


def bump(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a smooth bright spot on a ceiling, next to the record's zenith."""
    return np.exp(-((x - 0.6) ** 2 + (y + 0.35) ** 2) / (2 * 0.5**2))


def irradiance_under_bump(p: np.ndarray, height: float) -> float:
    """Return E at p from a ceiling of radiance `bump`, by quadrature over the ceiling: ∫ L·h²/(d²)² dA."""
    x = np.linspace(-4.0, 5.0, 721)
    X, Y = np.meshgrid(x, x)
    h = height - p[2]
    d2 = (X - p[0]) ** 2 + (Y - p[1]) ** 2 + h * h
    return float((bump(X, Y) * h * h / d2**2).sum() * (x[1] - x[0]) ** 2)


@pytest.mark.parametrize("side", [16, 32, 64])
def test_edges_give_the_gradient_of_smooth_radiance(side: int) -> None:
    """∇E = Σ (L_b - L_a)·xyz/min(r_a, r_b) matches central differences of E = ∫ L cosθ dω under a ceiling with a bright spot.

    The record moves along the surface and off it. The limit is relative to the gradient's length. The midpoint rule's error
    is of second order in the texel size, that of min(r_a, r_b) of first order, 3 % at 32².
    """
    height, step = 1.3, 1e-3
    truth = np.array(
        [(irradiance_under_bump(d, height) - irradiance_under_bump(-d, height)) / (2 * step) for d in step * np.eye(3)]
    )
    directions = plane_table(side)[..., :3].reshape(-1, 3)
    r = height / directions[:, 2]
    L = bump(*(directions[:, :2] * r[:, None]).T)
    a, b, vector = edges(side)
    found = ((L[b] - L[a]) / np.minimum(r[a], r[b])) @ vector
    assert np.linalg.norm(found - truth) < 1.9 / side * np.linalg.norm(truth), (found, truth)


def test_frames_are_orthonormal_right_handed_and_turned() -> None:
    rng = np.random.default_rng(1)
    normal = rng.normal(size=(500, 3))
    normal[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    normal[6] = (1e-9, 0.0, -1.0)  # degenerate for a less careful basis
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = tangent_frames(normal, np.arange(500), seed=3)
    assert np.allclose(found @ found.swapaxes(1, 2), np.eye(3), atol=1e-6)
    assert np.allclose(np.linalg.det(found), 1.0, atol=1e-6)
    assert np.allclose(found[:, 2], normal, atol=1e-12)
    same = tangent_frames(np.tile(normal[:1], (64, 1)), np.arange(64), seed=3)
    angle = np.sort(np.arctan2(same[:, 0] @ same[0, 1], same[:, 0] @ same[0, 0]))
    assert np.diff(angle).max() < 2.0 * np.pi / 64 * 3, "golden turns leave no wide gap"
    assert np.array_equal(tangent_frames(normal, np.arange(500), 3), found)
    assert not np.allclose(tangent_frames(normal, np.arange(500), 4)[:, 0], found[:, 0])
    assert np.array_equal(tangent_frames(normal[100:], np.arange(100, 500), 3), found[100:]), "the number decides, not the batch"
