"""Adaptive radii against plain numpy, whatever the order in which records come; and that they pay."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.cache import RecordCache
from irrsplat.passes.adapt import AdaptPass
from irrsplat.settings import Settings
from tests.test_renderer import FAST, SIZE, room
from tests.truth import SIZE as FULL
from tests.truth import compare, load_reference
from tests.worlds import sites

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


class Made:
    """A cache of records on a wavy floor, their vectors and gradients at random."""

    def __init__(self, ctx: moderngl.Context, count: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.p = rng.uniform(-1, 1, (count, 3)) * (1.0, 0.02, 1.0)
        self.n = np.array([0.0, 1.0, 0.0]) + rng.normal(size=(count, 3)) * 0.25
        self.n /= np.linalg.norm(self.n, axis=1, keepdims=True)
        self.E = 10.0 ** rng.uniform(-1, 1, (count, 3))
        self.R = rng.uniform(0.2, 2.0, count)
        self.M = self.n[:, None, :] * self.E[..., None] * rng.uniform(0.8, 1.2, (count, 3, 3))
        self.gradient = rng.normal(size=(count, 3, 3)) * self.E[..., None]
        self.cache = RecordCache(ctx)
        where = sites(self.p, self.n)
        self.cache.append(where, np.column_stack([self.E, self.R]))
        for i, values in enumerate([*np.moveaxis(self.M, 1, 0), *np.moveaxis(self.gradient, 1, 0)]):
            self.cache._put(3 + i, 0, np.pad(values, ((0, 0), (0, 1))))

    def limits(self, settings: Settings, *parts: int) -> np.ndarray:
        """What the pass leaves, the records coming in parts that end at the given counts, and at last all."""
        self.cache.unlimit()
        one, first = AdaptPass(self.cache.ctx, settings.gradients), 0
        for count in (*parts, self.cache.count):
            one(replace(self.cache.records, count=count), first, settings)
            first = count
        one.release()
        self.cache.ctx.detect_framebuffer(0).use()
        return np.frombuffer(self.cache.records.limit.read(), "f4").copy()


def truth(made: Made, settings: Settings) -> np.ndarray:
    """(N,) the least of the limits that the others set."""
    Y = made.E @ LUMINANCE
    R, M, gradient = made.R.copy(), made.n * Y[:, None], np.zeros((len(Y), 3))
    if settings.gradients:
        M, gradient = (np.einsum("ncx,c->nx", v, LUMINANCE) for v in (made.M, made.gradient))
        R = np.minimum(R, Y / np.linalg.norm(gradient, axis=1))
    apart = made.p[None] - made.p[:, None]
    d = np.linalg.norm(apart, axis=2)
    front = np.abs(np.einsum("ijx,ijx->ij", apart, made.n[None] + made.n[:, None])) / 2.0
    witness = (d > 0.0) & (d < settings.a * R[:, None]) & (made.n @ made.n.T >= 0.7) & (front <= 0.05 * R[:, None])
    said = np.maximum(M @ made.n.T + np.einsum("ix,ijx->ij", gradient, apart), 0.0)
    off = np.abs(said - Y[None]) / np.maximum(Y[None], Y[:, None])
    return np.where(witness, d / settings.a * np.sqrt(settings.adapt / np.maximum(off, 1e-30)), 1e30).min(1)


@pytest.mark.parametrize("gradients", [True, False])
@pytest.mark.parametrize("parts", [(), (1,), (700,), (3, 1024, 1025)])
def test_limits_equal_numpy_in_any_order(ctx: moderngl.Context, gradients: bool, parts: tuple[int, ...]) -> None:
    """The least of many limits is the same in whatever order they come; a witness at the very rim may fall to either side."""
    made, settings = Made(ctx, 1300), Settings(a=0.4, adapt=0.3, gradients=gradients)
    found, expected = made.limits(settings, *parts), truth(made, settings)
    assert (found[1300:] == np.float32(1e30)).all(), "beyond the last record nothing is written"
    limited = expected < 1e29
    assert 0.05 < limited.mean() <= 1.0
    agree = np.isclose(found[:1300], expected, rtol=1e-3)
    assert agree.mean() > 0.99
    assert np.array_equal(found, made.limits(settings)), "bit for bit, in parts as at once"


def test_a_record_that_is_right_about_others_reaches_as_far_as_it_did(ctx: moderngl.Context) -> None:
    """On a plane where E is linear, with true gradients, every record says what every other one found."""
    made = Made(ctx, 200)
    made.p[:, 1], made.n[:] = 0.0, (0.0, 1.0, 0.0)
    slope = np.array([0.5, 0.0, 0.3])
    made.E = np.repeat(5.0 + (made.p @ slope)[:, None], 3, axis=1)
    cache = RecordCache(ctx)
    cache.append(sites(made.p, made.n), np.column_stack([made.E, made.R]))
    for i in range(3):
        cache._put(6 + i, 0, np.pad(np.repeat(slope[None], 200, 0), ((0, 0), (0, 1))))
    made.cache = cache
    assert (made.limits(Settings(adapt=0.1))[:200] > 10.0 * made.R).all()


@pytest.mark.parametrize(("name", "gain"), [("door", 0.85), ("curved", 0.9)])
def test_records_that_may_not_contradict_each_other_are_nearer_to_the_truth(name: str, gain: float) -> None:
    """At about equal counts of records: without adapting, `a` is lowered until there are as many."""
    scene, reference = irrsplat.load(name), load_reference(name)
    adapted = irrsplat.render(scene, (FULL, FULL), bounces=1)
    plain = irrsplat.render(scene, (FULL, FULL), bounces=1, adapt=0.0, radius_max=5.0, a=0.42)
    assert plain.stats["records"] > 0.95 * adapted.stats["records"]
    assert compare(adapted, reference)["rmse"] < gain * compare(plain, reference)["rmse"]


def test_turned_off_and_on_again() -> None:
    with irrsplat.Renderer(room(), SIZE, **FAST, adapt=0.0) as plain, irrsplat.Renderer(room(), SIZE, **FAST) as renderer:
        before = plain.render()
        renderer.render()
        limits = np.frombuffer(renderer.cache.records.limit.read(), "f4")
        assert (limits < 1e29).any()
        renderer.change(replace(renderer.settings, adapt=0.0))
        renderer.forget()
        after = renderer.render()
    assert np.array_equal(after.records_position, before.records_position)
    assert np.array_equal(after.weight, before.weight)
