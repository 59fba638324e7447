"""Algorithm of the seed paper: traversal in scan order, weights on CPU and GPU, and the covered share of light."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect import paper_scan
from irrsplat.indirect.splat import SplatPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings, preset
from tests.gather.test_hemisphere import share_of_plane
from tests.support.worlds import assert_pictures, box, floor, gbuffer_of, material, rays, scene

SIZE = (41, 33)
CAMERA = Camera((0.2, 0.5, 3.0), (0.0, 0.0, 0.0), fov=50.0)


def view(seed: int = 0) -> tuple[paper_scan.Seen, np.ndarray]:
    """Return a wavy surface with holes, as the algorithm reads it back, and its depth (0 in the holes)."""
    rng = np.random.default_rng(seed)
    d = rays(CAMERA, SIZE)
    y, x = np.indices(d.shape[:2])
    depth = 3.0 + 0.4 * np.sin(x / 6.0) * np.cos(y / 8.0)
    normal = np.array([0.0, 0.0, 1.0]) + 0.1 * rng.normal(size=d.shape)
    normal = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype("f4")
    position = (np.asarray(CAMERA.eye) + depth[..., None] * d).astype("f4")
    depth[rng.random(depth.shape) < 0.1] = 0.0
    return paper_scan.Seen(position, normal, normal, normal, depth > 0.0), depth


@pytest.mark.parametrize(
    "settings",
    [preset("paper", a=0.5), preset("paper", a=1.0, weights="hessian"), preset("paper", a=0.5, radius_min=3.0, radius_max=10.0)],
)
def test_weights_on_the_cpu_are_those_of_the_gpu(ctx: moderngl.Context, settings: Settings) -> None:
    """Section 3.5.2 splats a new record's weight on the CPU's copy: the buffer must equal the GPU's.

    Records lie on the surface, next to it, behind the eye, and around it. Rounding may decide a pixel at the very rim.
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
    cache, splats = RecordCache(ctx), SplatPass(ctx, SIZE)
    cache.append(where, np.concatenate([np.ones((40, 3), "f4"), R[:, None]], 1))
    gbuffer = gbuffer_of(ctx, seen.position, seen.normal, depth)
    splats.clear(gbuffer)
    splats(cache.records, np.arange(cache.count), gbuffer, CAMERA, settings)
    found = splats.target(1).read(1)[..., 0]
    assert (weight[seen.mask] > 0.0).mean() > 0.2
    # √(1 - n·n_k) of two equal normals is up to √(2⁻²³) = 3.5e-4 by rounding, and w = 1/e
    off = (np.abs(found - weight) > 1e-4 * weight + 5e-4 * weight**2) & seen.mask
    assert off.mean() < 2e-3 and not weight[~seen.mask].any()
    if off.any():  # then by one record's least weight, 1/a
        assert_pictures("paper_weight", found, weight, 1.01 / settings.a, seen.mask)


def test_a_record_covers_its_neighbours_at_once() -> None:
    """With one large radius the traversal is greedy: it equals a plain loop over pixels in scan order."""
    seen, _ = view()
    settings = preset("paper", a=0.6)
    scan, record = paper_scan.Scan(seen, settings.warmup), np.array([1.0, 1.0, 1.0, 0.8], "f4")
    sites, *_ = scan.advance(np.zeros(seen.mask.shape, "f4"), lambda _: record, 10_000, Budget(None), CAMERA, settings)
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


# ---- whole renders ----------------------------------------------------------------------------------------------------

INSIDE = Camera((0.0, 0.0, 0.9), (0.0, -0.1, -1.0), fov=60.0)


def test_in_a_furnace_the_paper_sees_945_thousandths() -> None:
    """E = 0.945·π·L_e by a single plane of 150°, for every record and at every pixel; the picture is E·ρ/π + L_e."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, 3.0), outward=False), camera=INSIDE)
    frame = irrsplat.render(world, (24, 24), preset="paper", warmup=10)
    truth = share_of_plane(150.0) * np.pi * 3.0
    assert np.allclose(frame.records_irradiance, truth, rtol=1e-3)
    assert_pictures("paper_furnace", frame.irradiance, np.asarray(truth), 2e-3 * truth)
    assert np.allclose(frame.image, 3.0 + 0.5 * share_of_plane(150.0) * 3.0, rtol=1e-3)


@pytest.mark.parametrize("gather", ["trace", "embree"])
def test_the_scan_by_rays_has_all_light_of_emitters_and_sky(gather: Any) -> None:
    """In the furnace every ray hits a radiance of 1, so that each record has E = π; an open floor has the E of its sky.

    The paper sums a record's own rays, and has no next-event samples: with them, each ray would count by its share of both.
    """
    open_floor = irrsplat.make_scene([floor()], cameras=[Camera((0.0, 2.0, 1.0), (0.0, 0.0, 0.0))], sky="cie overcast lux 1790")
    for world, E in ((irrsplat.load("furnace"), np.pi), (open_floor, 1790.0 / 179.0)):
        frame = irrsplat.render(world, (24, 24), placement="scan", gather=gather, bounces=1, gradients=False, warmup=10, a=1.0)
        assert np.allclose(frame.records_irradiance, E, rtol=5e-3)


def test_records_of_the_scan_cover_their_neighbours_with_the_setting_gradients() -> None:
    """The scan gathers no derivatives. A greatest radius of 0 would mark its records as enclosed, for their own pixels alone."""
    cornell = irrsplat.load("cornell")
    one, other = (irrsplat.render(cornell, (24, 24), preset="paper", warmup=10, gradients=on) for on in (False, True))
    assert np.array_equal(one.records_position, other.records_position)
    assert np.allclose(one.irradiance, other.irradiance, rtol=1e-4)
