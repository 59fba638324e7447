"""Record cache: stored values are read back, also after growth, truncation and refilling."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.record_layout import COLUMNS, GATHERED, TEXTURES
from irrsplat.indirect.gathering.change_probe import apply_probes, columns_of, scale_by_surface
from irrsplat.records.record_cache import RecordCache
from tests.support.worlds import sites, write_columns


def made_up(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, unit normals and (N, 4) values."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return rng.normal(size=(count, 3)), normal, rng.uniform(0, 9, (count, 4)).astype("f4")


def texels(texture: moderngl.Texture, count: int) -> np.ndarray:
    return np.frombuffer(texture.read(), "f4").reshape(-1, texture.components)[:count]


@pytest.mark.parametrize("parts", [(5, 1, 1019, 3), (4096, 1), (3000, 3000, 9000)])
def test_records_come_back_in_their_order(ctx: moderngl.Context, parts: tuple[int, ...]) -> None:
    """Records keep their order across rows of 1024 and texture growth beyond 4096, equal on the GPU and the CPU."""
    cache = RecordCache(ctx)
    p, n, values = made_up(sum(parts))
    start = 0
    for count in parts:
        part = slice(start, start + count)
        assert cache.append(sites(p[part], n[part]), values[part]) == start
        start += count
    found, records = cache.read(), cache.records
    assert cache.count == records.count == start
    assert np.array_equal(found["position"], p.astype("f4")) and np.array_equal(found["normal"], sites(p, n).normal)
    assert np.array_equal(found["irradiance"], values[:, :3]) and np.array_equal(found["radius"], values[:, 3])
    on_gpu = records.read(*(name for name in COLUMNS if name != "limit"))
    # E = n_k·M without directions: M = E·n_k, and no derivatives
    found["vectors"], found["max_radius"] = found["normal"][:, None] * values[:, :3, None], values[:, 3]
    for name, column in on_gpu.items():
        assert np.allclose(column, found.get(name, 0.0), rtol=1e-6), name
    assert np.array_equal(on_gpu["position"], p.astype("f4"))
    cache.release()


@pytest.mark.parametrize("in_block", [False, True])
def test_an_interruption_leaves_no_records_with_empty_columns(
    ctx: moderngl.Context, in_block: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C comes during the block that fills the columns, or between the addition and the block."""
    p, n, values = made_up(3)

    def interrupted(*_: object) -> int:
        append(sites(p, n))
        raise KeyboardInterrupt

    with RecordCache(ctx) as cache:
        cache.append(sites(p, n), values)
        append = cache.append
        if not in_block:
            monkeypatch.setattr(cache, "append", interrupted)
        with pytest.raises(KeyboardInterrupt), cache.adding(sites(p, n)):
            raise KeyboardInterrupt
        assert np.array_equal(cache.read()["irradiance"], values[:, :3])


def test_growth_keeps_what_the_gpu_wrote(ctx: moderngl.Context) -> None:
    """The reduction writes E and R directly into the textures: growth copies these values."""
    cache = RecordCache(ctx)
    p, n, values = made_up(4096)
    cache.append(sites(p, n))
    for i, name in enumerate(GATHERED):
        cache.records.textures[name].write((values + i)[:, : TEXTURES[name]].tobytes())
    cache.append(sites(*made_up(1)[:2]))
    assert np.array_equal(cache.read()["irradiance"][:4096], values[:, :3])
    for i, name in enumerate(GATHERED):
        assert np.array_equal(texels(cache.records.textures[name], 4096), (values + i)[:, : TEXTURES[name]])
    cache.release()


def test_corrected_records_within_closed_meshes_cover_only_their_own_pixels(ctx: moderngl.Context) -> None:
    """A greatest radius of 0 marks them. Neither a probe nor the surface cache removes the mark."""
    with RecordCache(ctx) as cache:
        p, n, values = made_up(8)
        numbers = cache.append(sites(p, n), values) + np.arange(8)
        enclosed = numbers % 2 == 0
        write_columns(cache.records, 0, max_radius=np.where(enclosed, 0.0, 1.0))
        before = columns_of(cache, numbers)
        cache.column("probe")[:] = before
        apply_probes(cache, numbers, 0.5 * before, (0.01, 5.0))
        assert np.array_equal(cache.records.read("max_radius")["max_radius"] == 0.0, enclosed)
        scale_by_surface(cache, before[:, :3], 0.5 * before[:, :3], (0.01, 5.0))
        assert np.array_equal(cache.records.read("max_radius")["max_radius"] == 0.0, enclosed)


def test_records_take_the_mean_change_of_the_surface_cache_around_them(ctx: moderngl.Context) -> None:
    """Values that follow a light are off from site to site, here evenly by up to a half each, while the light halves.

    The standard deviation is 0.29 of each value, and about √2·0.29/√8 = 0.14 of a ratio of means over eight.
    """
    random, count = np.random.default_rng(1), 256
    places = np.column_stack([random.random(count), np.zeros(count), random.random(count)])
    with RecordCache(ctx) as cache:
        cache.append(sites(places, np.tile([0.0, 1.0, 0.0], (count, 1))), np.ones((count, 4)))
        before, after = random.uniform(0.5, 1.5, (2, count, 1)) * np.ones(3)
        scale_by_surface(cache, before, 0.5 * after, (0.01, 5.0))
        found = 2.0 * cache.values[:, 0]
        assert found.mean() == pytest.approx(1.0, abs=0.05) and found.std() < 0.2
