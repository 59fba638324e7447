"""The seed paper's algorithm: warm-up, traversal in scan order, weights on the CPU as on the GPU, and its coverage in light."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.core.buffers import Sites
from irrsplat.indirect import paper_scan
from irrsplat.indirect.splat import SplatPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings, preset
from tests.gather.test_hemisphere import share_of_plane
from tests.support.worlds import assert_pictures, box, gbuffer_of, lamp, material, quad, rays, scene

SIZE = (41, 33)
CAMERA = Camera((0.2, 0.5, 3.0), (0.0, 0.0, 0.0), fov=50.0)


def view(seed: int = 0) -> tuple[paper_scan.Seen, np.ndarray]:
    """A wavy surface with holes, as the algorithm reads it back, and its depth (0 in the holes)."""
    rng = np.random.default_rng(seed)
    d = rays(CAMERA, SIZE)
    y, x = np.indices(d.shape[:2])
    depth = 3.0 + 0.4 * np.sin(x / 6.0) * np.cos(y / 8.0)
    normal = np.array([0.0, 0.0, 1.0]) + 0.1 * rng.normal(size=d.shape)
    normal = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype("f4")
    position = (np.asarray(CAMERA.eye) + depth[..., None] * d).astype("f4")
    depth[rng.random(depth.shape) < 0.1] = 0.0
    return paper_scan.Seen(position, normal, normal, depth > 0.0), depth


class Teller:
    """Stands in for the Recorder: E = 1, a radius that it is told, and it remembers where it was asked."""

    stopped = False

    def __init__(self, radius: Any) -> None:
        self.radius, self.asked = radius, []  # type: ignore[var-annotated]

    def __call__(self, site: Sites) -> np.ndarray:
        self.asked.append(site.position[0])
        return np.array([1.0, 1.0, 1.0, self.radius(len(self.asked))], "f4")


@pytest.mark.parametrize(
    "settings",
    [
        preset("paper", a=0.3),
        preset("paper", a=0.7),
        preset("paper", a=1.0, in_front=True),
        preset("paper", a=0.5, radius_min=3.0, radius_max=10.0),
    ],
)
def test_weights_on_the_cpu_are_those_of_the_gpu(ctx: moderngl.Context, settings: Settings) -> None:
    """Section 3.5.2 splats a new record's weight on the CPU's copy: the buffer must be what the GPU would have drawn.

    Records lie on the surface, beside it, behind the eye, and around it. Rounding may decide a pixel at the very rim.
    """
    seen, depth = view()
    rng = np.random.default_rng(3)
    rows, columns = rng.integers(0, SIZE[1], 40), rng.integers(0, SIZE[0], 40)
    p = seen.position[rows, columns] + rng.normal(size=(40, 3)).astype("f4") * 0.02
    p[:3] = (3.0, 0.5, 0.0), (0.2, 0.4, 4.0), (0.1, 0.6, 2.9)
    where = Sites(p.astype("f4"), seen.normal[rows, columns], seen.normal[rows, columns])
    R = np.r_[4.0, 9.0, 7.0, rng.uniform(0.05, 1.5, 37)].astype("f4")

    weight = np.zeros(depth.shape, "f4")
    for i in range(40):
        paper_scan.splat_weight(weight, seen, where[i : i + 1], float(R[i]), CAMERA, settings)
    cache, splats = RecordCache(ctx), SplatPass(ctx, SIZE, False)
    cache.append(where, np.concatenate([np.ones((40, 3), "f4"), R[:, None]], 1))
    gbuffer = gbuffer_of(ctx, seen.position, seen.normal, depth)
    splats.clear(gbuffer)
    splats(cache.records, np.arange(cache.count), gbuffer, CAMERA, settings)
    found = splats.target.read(1)[..., 0]
    assert (weight[seen.mask] > 0.0).mean() > 0.2
    # √(1 - n·n_k) of two equal normals is up to √(2⁻²³) = 3.5e-4 by rounding, and w = 1/e
    off = (np.abs(found - weight) > 1e-4 * weight + 5e-4 * weight**2) & seen.mask
    assert off.mean() < 2e-3 and not weight[~seen.mask].any()
    if off.any():  # then by one record's least weight, 1/a
        assert_pictures("paper_weight", found, weight, 1.01 / settings.a, seen.mask)


def test_traversal_goes_row_by_row() -> None:
    """From the top, from left to right: the first site is the first pixel that asks, the next one the first still unserved."""
    seen, _ = view()
    settings = preset("paper", a=0.5)
    teller = Teller(lambda _: 1e-6)  # serves nobody but the pixel itself
    weight = np.where(np.random.default_rng(5).random(seen.mask.shape) < 0.7, 5.0, 0.0).astype("f4")
    before = weight.copy()
    sites, values, missing = paper_scan.traverse(seen, weight, teller, CAMERA, settings)  # type: ignore[arg-type]
    asks = seen.mask & (weight < settings.threshold)
    assert np.array_equal(sites.position, seen.position[asks]), "in numpy's own order, row by row"
    assert np.array_equal(np.array(teller.asked), sites.position) and values.shape == (asks.sum(), 4)
    assert missing == pytest.approx(asks.sum() / seen.mask.sum())
    assert np.array_equal(weight, before), "the copy that is splatted on is its own"


def test_a_record_serves_its_neighbours_at_once() -> None:
    """With one large radius the traversal is the greedy one: pixel by pixel in scan order against a plain loop."""
    seen, _ = view()
    settings = preset("paper", a=0.6)
    sites, *_ = paper_scan.traverse(seen, np.zeros(seen.mask.shape, "f4"), Teller(lambda _: 0.8), CAMERA, settings)  # type: ignore[arg-type]
    weight, expected = np.zeros(seen.mask.shape), []
    for row, column in np.argwhere(seen.mask):
        if weight[row, column] >= settings.threshold:
            continue
        p_k, n_k = seen.position[row, column].astype(float), seen.normal[row, column].astype(float)
        expected.append(p_k)
        e = np.linalg.norm(seen.position - p_k, axis=-1) / 0.8 + np.sqrt(np.maximum(0.0, 1.0 - seen.normal @ n_k))
        w = 1.0 / np.maximum(e, 1e-3)
        weight += np.where(seen.mask & (w > 1.0 / settings.a), w, 0.0)
    assert 3 < len(sites) < 0.2 * seen.mask.sum()
    assert np.array_equal(sites.position, np.array(expected, "f4"))


def test_warm_up_draws_that_many_pixels_once_each() -> None:
    seen, _ = view()
    for wanted in (1, 100, 10**5):
        sites, values = paper_scan.warm_up(seen, Teller(lambda n: n), preset("paper", warmup=wanted))  # type: ignore[arg-type]
        assert len(sites) == len(values) == min(wanted, seen.mask.sum())
        assert len(np.unique(sites.position, axis=0)) == len(sites)
        assert np.array_equal(values[:, 3], np.arange(1, len(sites) + 1)), "each with its own record's values"
    one, other, again = (
        paper_scan.warm_up(seen, Teller(lambda _: 1.0), preset("paper", warmup=50, seed=s))[0].position  # type: ignore[arg-type]
        for s in (0, 1, 0)
    )
    assert np.array_equal(one, again) and not np.array_equal(one, other)


def test_nothing_seen_is_no_record() -> None:
    seen, _ = view()
    nothing = paper_scan.Seen(seen.position, seen.normal, seen.geometric, np.zeros_like(seen.mask))
    teller, settings = Teller(lambda _: 1.0), preset("paper")
    assert len(paper_scan.warm_up(nothing, teller, settings)[0]) == 0  # type: ignore[arg-type]
    sites, values, missing = paper_scan.traverse(nothing, np.zeros(seen.mask.shape, "f4"), teller, CAMERA, settings)  # type: ignore[arg-type]
    assert len(sites) == 0 and values.shape == (0, 4) and missing == 0.0 and not teller.asked


# ---- whole renders ----------------------------------------------------------------------------------------------------

INSIDE = Camera((0.0, 0.0, 0.9), (0.0, -0.1, -1.0), fov=60.0)


def test_the_paper_renders_in_few_rounds() -> None:
    """Warm-up, one traversal (or few, should rounding reopen a pixel), and one look that finds nothing."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.6), outward=False), lights=(lamp((0.3, 0.6, 0.2)),), camera=INSIDE)
    with Renderer(world, (40, 40), "paper", warmup=60, shadow_size=64, gather_size=16) as renderer:
        told: list[Any] = []
        frame = renderer.render(progress=told.append)
        again = renderer.render()
    assert told[0].new == 60
    assert frame.stats["converged"] and frame.stats["rounds"] <= 4
    assert (frame.weight >= 1.0 / frame.stats["settings"]["a"] * (1 - 1e-4)).all()
    assert again.stats["records"] == frame.stats["records"] and np.array_equal(again.irradiance, frame.irradiance)


def test_in_a_furnace_the_paper_sees_945_thousandths() -> None:
    """E = 0.945·π·L_e by a single plane of 150°, for every record and at every pixel; E·ρ/π and L_e make the picture."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, 3.0), outward=False), camera=INSIDE)
    frame = irrsplat.render(world, (24, 24), preset="paper", warmup=10)
    truth = share_of_plane(150.0) * np.pi * 3.0
    assert np.allclose(frame.records_irradiance, truth, rtol=1e-3)
    assert_pictures("paper_furnace", frame.irradiance, np.asarray(truth), 2e-3 * truth)
    assert np.allclose(frame.image, 3.0 + 0.5 * share_of_plane(150.0) * 3.0, rtol=1e-3)


def test_the_radius_on_the_cpu_is_the_gpu_s() -> None:
    """The same plane reduced by the paper's loop and by the GPU's passes: E and R of every record agree."""
    things = quad((-0.5, -0.4, -0.5), (0.8, 0.1, 0), (0, 0.2, 0.9), material((0.9, 0.2, 0.1), 0.2))
    room = box((-1, -1, -1), (1, 1, 1), material(0.6, 0.1), outward=False)
    world = scene(room, things, lights=(lamp((0.3, 0.6, 0.2)),), camera=INSIDE)
    with Renderer(world, (20, 20), "paper", warmup=30, gather_size=16, shadow_size=64) as renderer:
        frame = renderer.render()
        count = len(frame.records_radius)
        with renderer.ctx:
            seen = paper_scan.Seen(frame.position, frame.normal, frame.normal, np.isfinite(frame.depth))
            assert seen.mask.all() and count >= 30
    with Renderer(world, (20, 20), "paper", placement="tiles", gather_size=16, shadow_size=64) as tiles:
        other = tiles.render()
    at = {tuple(p): i for i, p in enumerate(frame.records_position)}
    both = [(at[tuple(p)], j) for j, p in enumerate(other.records_position) if tuple(p) in at]
    assert len(both) >= 5
    i, j = np.array(both).T
    # a frame is turned by its record's number, so that a texel's worth of difference remains
    assert np.median(np.abs(frame.records_radius[i] / other.records_radius[j] - 1.0)) < 0.02
    assert np.median(np.abs(frame.records_irradiance[i] / other.records_irradiance[j] - 1.0)) < 0.02


def test_its_traversal_sees_every_pixel_of_a_high_picture() -> None:
    """By tiles, pictures of 400 pixels and more begin with every other one; the scan goes from pixel to pixel."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, 3.0), outward=False), camera=INSIDE)
    frame = irrsplat.render(world, (8, 400), placement="scan", bounces=1, warmup=20, gather_size=8)
    assert frame.stats["coverage"] == 1.0 and np.allclose(frame.irradiance, np.pi * 3.0, rtol=0.02)
