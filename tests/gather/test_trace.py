"""Gather by rays: tables, analytic scenes, and Ward and Heckbert's gradient."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.glsl import NEIGHBOUR_STRIDE
from irrsplat.gather.stratified import shape, site_directions, stratum_edges, stratum_table
from tests.gather.test_analytic import room
from tests.support.worlds import Lit, sites


@pytest.mark.parametrize("side", [4, 16, 64])
def test_strata_share_the_hemisphere_equally(side: int) -> None:
    """Σ cosθ·dω = π, ∫ω dω = (0, 0, π), ∫dω = 2π: a stratum's own dω is w/z, up to its angular extent."""
    table = stratum_table(side)
    assert table.shape == (*shape(side), 4) and table[..., 0].size == side * side
    assert np.allclose(table[..., 3], np.pi / side**2, rtol=1e-12)
    assert np.allclose(np.linalg.norm(table[..., :3], axis=-1), 1.0)
    vector = table[..., :3] * (table[..., 3] / table[..., 2])[..., None]
    assert np.allclose(vector.sum((0, 1)), [0.0, 0.0, np.pi], atol=1e-12)
    assert np.linalg.norm(vector, axis=-1).sum() == pytest.approx(2.0 * np.pi, rel=1.0 / side)


def test_rays_of_a_site_reach_far_along_a_corridor() -> None:
    """A cosine-weighted share z² of the rays is below the height z. Such rays pass 1/z widths of a corridor before they hit."""
    heights = np.sort(site_directions(20)[:, 2] ** 2)
    few = np.arange(1, 20)  # of 400 rays, within half of the last stratum
    assert np.allclose(heights[few - 1], (few - 0.5) / 400, atol=1.0 / 400)


def test_a_stratum_s_vector_is_its_integral() -> None:
    """∫ω·dω over a stratum (sin²θ from 3/8 to 4/8, φ from 5/32 to 6/32 turns) by quadrature, the base of Σ L·ω·dω."""
    table = stratum_table(16)
    theta = np.linspace(np.arcsin(np.sqrt(3 / 8)), np.arcsin(np.sqrt(4 / 8)), 401)
    phi = np.linspace(2 * np.pi * 5 / 32, 2 * np.pi * 6 / 32, 401)
    theta, phi = np.meshgrid(0.5 * (theta[1:] + theta[:-1]), 0.5 * (phi[1:] + phi[:-1]))
    solid = np.sin(theta) * np.ptp(theta) / 399 * np.ptp(phi) / 399
    omega = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    truth = (omega * solid[..., None]).sum((0, 1))
    found = table[3, 5, :3] * table[3, 5, 3] / table[3, 5, 2]
    assert np.allclose(found, truth, rtol=1e-5)


def test_edges_are_ward_and_heckbert_s_sum() -> None:
    """∇E along the surface for random L and r equals the published formula (Ward and Heckbert 1992, translation gradient):

    Σ_k û_k·(2π/N)·Σ_{j≥1} sinθ_j-·cos²θ_j-·(L_jk - L_j-1,k)/min(r_jk, r_j-1,k)
    + Σ_k v̂_k-·Σ_j (sinθ_j+ - sinθ_j-)·(L_jk - L_j,k-1)/min(r_jk, r_j,k-1), the azimuth closed into a ring.
    """
    side = 16
    m, n = shape(side)
    rng = np.random.default_rng(0)
    L, r = rng.random((m, n)), rng.uniform(0.5, 2.0, (m, n))
    truth = np.zeros(2)
    for k in range(n):
        middle, before = 2 * np.pi * (k + 0.5) / n, 2 * np.pi * k / n
        for j in range(m):
            sine, more = np.sqrt(j / m), np.sqrt((j + 1) / m)
            if j:
                u = sine * (1 - sine**2) * (L[j, k] - L[j - 1, k]) / min(r[j, k], r[j - 1, k])
                truth += 2 * np.pi / n * u * np.array([np.cos(middle), np.sin(middle)])
            v = (more - sine) * (L[j, k] - L[j, k - 1]) / min(r[j, k], r[j, k - 1])
            truth += v * np.array([-np.sin(before), np.cos(before)])
    table = stratum_edges(side).reshape(m, n, 2, 4)
    row = np.floor(table[..., 3] / NEIGHBOUR_STRIDE).astype(int)
    column = (table[..., 3] - NEIGHBOUR_STRIDE * row).astype(int)
    change = (L[row, column] - L[..., None]) / np.minimum(r[row, column], r[..., None])
    assert np.allclose((change[..., None] * table[..., :2]).sum((0, 1, 2)), truth, rtol=1e-12)


def test_edges_give_the_gradient_along_the_normal_too() -> None:
    """Under a ceiling with radiance exp(-s²) around the zenith, the gradient along the normal matches quadrature for a rise by
    h.
    """
    side, height, step = 64, 1.3, 1e-3

    def E(h: float) -> float:
        s = (np.arange(40_000) + 0.5) / 40_000 * 8.0
        return float((np.exp(-(s**2)) * h * h / (h * h + s * s) ** 2 * 2 * np.pi * s * 8.0 / 40_000).sum())

    truth = (E(height - step) - E(height + step)) / (2 * step)
    m, n = shape(side)
    square = np.broadcast_to(((np.arange(m) + 0.5) / m)[:, None], (m, n))
    r, L = height / np.sqrt(1 - square), np.exp(-(height**2) * square / (1 - square))
    table = stratum_edges(side).reshape(m, n, 2, 4)
    row = np.floor(table[..., 3] / NEIGHBOUR_STRIDE).astype(int)
    column = (table[..., 3] - NEIGHBOUR_STRIDE * row).astype(int)
    change = (L[row, column] - L[..., None]) / np.minimum(r[row, column], r[..., None])
    found = (change[..., None] * table[..., :3]).sum((0, 1, 2))
    assert found[2] == pytest.approx(truth, rel=0.03)
    assert np.allclose(found[:2], 0.0, atol=1e-9)


def test_many_records_at_once_equal_each_alone(ctx: moderngl.Context) -> None:
    """Results do not depend on the atlas cell or the batch: equal rays give equal light, to the last bit."""
    rng, lit = np.random.default_rng(7), Lit(ctx, room())
    where = sites(rng.uniform(-0.9, 0.9, (23, 3)), rng.normal(size=(23, 3)))
    together, alone = lit.gather(where, 16), lit.gather(where, 16, capacity=1)
    assert np.array_equal(together.E, alone.E) and np.array_equal(together.gradient, alone.gradient)
    assert together.E.std() > 0.1, "there is something to see"
