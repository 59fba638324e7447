"""Adaptive radii against plain numpy, for any order of records; and their benefit."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.gpu.timers import Timers
from irrsplat.records import adaptive_radius
from irrsplat.records.adaptive_radius import AdaptiveRadius, _strips
from irrsplat.records.record_cache import RecordCache
from irrsplat.settings import Settings
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.worlds import error_scale, sites, write_columns

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


class Made:
    """Cache of records on a wavy floor with random vectors, gradients and bends; one bend in five is unknown."""

    def __init__(self, ctx: moderngl.Context, count: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.p = rng.uniform(-1, 1, (count, 3)) * (1.0, 0.02, 1.0)
        self.n = np.array([0.0, 1.0, 0.0]) + rng.normal(size=(count, 3)) * 0.25
        self.n /= np.linalg.norm(self.n, axis=1, keepdims=True)
        self.E = 10.0 ** rng.uniform(-1, 1, (count, 3))
        self.R = 10.0 ** rng.uniform(-1.0, 0.4, count)
        self.M = self.n[:, None, :] * self.E[..., None] * rng.uniform(0.8, 1.2, (count, 3, 3))
        self.gradient = rng.normal(size=(count, 3, 3)) * self.E[..., None]
        aside = np.cross(self.n, rng.normal(size=(count, 3)))
        self.axis = np.where(rng.random(count) < 0.2, 0.0, 1.0)[:, None] * aside / np.linalg.norm(aside, axis=1, keepdims=True)
        radii = rng.uniform(0.1, 1.0, count)[:, None] * np.stack([rng.uniform(1.0, 5.0, count), np.ones(count)], 1)
        self.bend = rng.choice([-1.0, 1.0], (count, 2)) * 2.0 / radii**2 * self.axis.any(1)[:, None]
        self.farthest = np.minimum(rng.uniform(0.3, 3.0, count), 3.0 * self.R)
        self.noise = rng.uniform(0.0, 0.2, count)
        self.dark = 0.5
        self.ctx = ctx

    def append(self, cache: RecordCache, count: int) -> None:
        """Append the missing records of the first `count`."""
        new = slice(cache.count, count)
        columns = {
            "vectors": self.M,
            "gradient": self.gradient,
            "axis": self.axis,
            "curvature": self.bend,
            "max_radius": self.farthest,
            "noise": self.noise,
        }
        cache.append(sites(self.p[new], self.n[new]), np.column_stack([self.E, self.R])[new])
        write_columns(cache.records, new.start, **{name: values[new] for name, values in columns.items()})

    def limits(self, settings: Settings, *parts: int) -> np.ndarray:
        """Return the limits of the pass for records that arrive in parts with the given end counts, and finally all.

        A negative count -n removes the last n records.
        """
        cache = RecordCache(self.ctx)
        adaptation, first = AdaptiveRadius(self.ctx, cache, Timers(self.ctx, software=True)), 0
        for count in (*parts, len(self.p)):
            if count < 0:
                cache.truncate(first := first + count)
                continue
            self.append(cache, count)
            cache.luminance_floor = self.dark
            cache.set_limits(adaptation.limits(first, settings, True))
            first = count
        found = np.frombuffer(cache.records.textures["limit"].read(), "f4").copy()
        adaptation.release()
        cache.release()
        self.ctx.detect_framebuffer(0).use()
        return found


def truth(made: Made, settings: Settings) -> np.ndarray:
    """Return (N,) the least limit from all other records, as a share of a record's radii.

    A witness lies within two radii on the same surface. off_ij is the error of record i's Taylor expansion at j, relative
    to the brighter value, without the part that two standard errors of both records explain. The allowed share a fulfils
    off·(a/x)² = adapt, with x = |p_j - p_i| in radii.
    """
    Y, known = made.E @ LUMINANCE, made.axis.any(1)
    radii, M, gradient, bend = np.stack([made.R, made.R], 1), made.n * Y[:, None], np.zeros((len(Y), 3)), 0.0 * made.bend
    if settings.gradients:
        M, gradient = (np.einsum("ncx,c->nx", v, LUMINANCE) for v in (made.M, made.gradient))
        E = error_scale(Y, made.dark)
        radii = np.minimum(radii, (E / np.linalg.norm(gradient, axis=1))[:, None])
        if settings.hessian:
            bends = np.abs(made.bend[known]) * (Y / E)[known, None]
            radii[known] = np.minimum(np.sqrt(2.0 / bends), made.farthest[known, None])
        if settings.hessian:
            bend = made.bend
    apart = made.p[None] - made.p[:, None]
    d = np.linalg.norm(apart, axis=2)
    along = np.einsum("ijx,ix->ij", apart, made.axis)
    x = np.sqrt((along / radii[:, :1]) ** 2 + (d**2 - along**2) / radii[:, 1:] ** 2)
    front = np.abs(np.einsum("ijx,ijx->ij", apart, made.n[None] + made.n[:, None])) / 2.0
    alike = made.n @ made.n.T >= 0.7
    witness = (d > 0.0) & (x < 2.0 * settings.a) & alike & (front <= 0.05 * radii[:, 1:])
    here = M @ made.n.T + 0.75 * (1.0 - made.n @ made.n.T) * (M * made.n).sum(1)[:, None]
    across = d**2 - along**2 - np.einsum("ijx,ix->ij", apart, made.n) ** 2
    more = np.clip((bend[:, :1] * along**2 + bend[:, 1:] * across) / 2.0, -0.5, 0.5)
    said = np.clip(here * (1.0 + more) + np.einsum("ix,ijx->ij", gradient, apart), 0.0, np.maximum(2.0 * here, 0.0))
    variance = (made.noise * Y) ** 2
    off = np.sqrt(np.maximum((said - Y[None]) ** 2 - 4.0 * (variance[:, None] + variance[None]), 0.0))
    off /= error_scale(np.maximum(Y[None], Y[:, None]), made.dark)
    share = x / settings.a * np.sqrt(settings.adapt / np.maximum(off, 1e-30))
    return np.minimum(np.where(witness, share, 1.0).min(1), 1.0)


BASE = Settings(a=0.4, adapt=0.3)
VARIANTS = {
    "default": BASE,
    "without gradients": replace(BASE, gradients=False),
    "weights of the paper": replace(BASE, weights="paper"),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_limits_equal_numpy_in_any_order(ctx: moderngl.Context, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits match numpy, except for rounding at a radius's rim; the least limit is equal bit for bit for any order of parts, and
    for strips of any width."""
    made, settings = Made(ctx, 1300), VARIANTS[name]
    found, expected = made.limits(settings), truth(made, settings)
    assert (found[1300:] == 1.0).all(), "nothing is written beyond the last record"
    assert 0.05 < (expected < 1.0).mean() <= 1.0 and 0.0 < expected.min() < 0.9
    assert np.isclose(found[:1300], expected, rtol=1e-3).mean() > 0.99
    for parts in ((1,), (3, 1024, 1025)) if name == "default" else ():  # numbers of records after each part
        assert np.array_equal(made.limits(settings, *parts), found), f"in parts {parts} as at once"
    monkeypatch.setattr(adaptive_radius, "_STRIP", 100)
    assert np.array_equal(made.limits(settings), found), "in many strips as in a few"


def of_field(ctx: moderngl.Context, slope: np.ndarray, second: np.ndarray) -> Made:
    """Return records on a plane with E = 5 + slope·p + ½ p·second·p and exact derivatives; `second` bends least along x."""
    made = Made(ctx, 200)
    x, z = np.divmod(np.arange(200), 20)  # a grid, so that rounding cannot separate two near records
    made.p, made.n[:] = np.stack([x / 5.0 - 0.9, 0.0 * x, z / 10.0 - 0.95], 1) + 0.2 * made.p * (0.2, 0.0, 0.1), (0.0, 1.0, 0.0)
    made.E = np.repeat((5.0 + made.p @ slope + 0.5 * (made.p**2) @ second)[:, None], 3, axis=1)
    made.M = made.n[:, None, :] * made.E[..., None]
    made.gradient = np.repeat((slope + made.p * second)[:, None], 3, axis=1)
    made.axis[:], made.R[:], made.farthest[:] = (1.0, 0.0, 0.0), 7.0, 20.0
    made.bend, made.noise[:] = second[[0, 2]] / made.E[:, :1], 0.0
    return made


def test_a_record_that_agrees_with_others_keeps_its_radius(ctx: moderngl.Context) -> None:
    """On a plane with linear E and exact gradients, all extrapolations agree; with quadratic E, by bends."""
    slope = np.array([0.5, 0.0, 0.3])
    linear, bent = of_field(ctx, slope, np.array([1e-6, 0.0, 1e-6])), of_field(ctx, slope, np.array([-0.3, 0.0, 0.8]))
    assert (linear.limits(Settings(adapt=0.01, weights="paper"))[:200] == 1.0).all()
    assert (bent.limits(Settings(adapt=0.01))[:200] == 1.0).all()
    assert (bent.limits(Settings(adapt=0.01, weights="paper"))[:200] < 0.5).mean() > 0.9


def test_a_record_beyond_the_rim_is_compared_and_one_beyond_two_radii_is_not(ctx: moderngl.Context) -> None:
    """A bright and a dark record, x radii apart: the error at x determines the allowed share of the radius quadratically."""
    settings = Settings(a=0.5, adapt=0.2, gradients=False)
    for x in (0.3, 0.9, 1.5, 1.9, 2.1):
        made = Made(ctx, 2)
        made.p, made.n[:] = np.array([[0.0, 0.0, 0.0], [0.5 * x, 0.0, 0.0]]), (0.0, 1.0, 0.0)
        made.E, made.R, made.noise = np.array([[4.0] * 3, [1.0] * 3]), np.ones(2), np.zeros(2)
        expected = min(1.0, x * np.sqrt(0.2 / 0.75)) if x < 2.0 else 1.0
        assert np.allclose(made.limits(settings)[:2], expected, rtol=1e-4), x


def test_few_new_records_limit_no_old_ones_until_there_are_more(ctx: moderngl.Context) -> None:
    """An 8th of 360 records are 45: 30 new ones leave old limits, and with 30 more all limits are those of one comparison."""
    made, cache = Made(ctx, 360), RecordCache(ctx)
    with AdaptiveRadius(ctx, cache, Timers(ctx, software=True)) as adaptation:
        cache.luminance_floor = made.dark
        found = []
        for count in (300, 330, 360):
            made.append(cache, count)
            found.append((adaptation(BASE, old_too=True, same_floor=True), cache.limits(300)))
    assert not found[1][0] and np.array_equal(found[0][1], found[1][1])
    assert found[2][0] and np.array_equal(cache.limits(360), made.limits(BASE)[:360])
    cache.release()


@pytest.mark.parametrize(("length", "reach"), [(1.0, 0.05), (30.0, 0.5), (1e6, 1e4)])
def test_few_records_are_compared_in_halls_and_in_corridors(length: float, reach: float) -> None:
    """All records of a hall of 1 x 1, or a corridor: fewer than twice as many are compared as lie within reach of a record."""
    chance, count = np.random.default_rng(0), 20_000
    places = chance.random((count, 3)).astype("f4") * np.array([1.0, 0.0, length], "f4")
    strips, asking = _strips(places, (2, 0), count), places[:200]
    assert np.array_equal(np.sort(np.concatenate(strips)), np.arange(count))
    compared = 0
    for strip in strips:
        x, z = places[strip, 0], places[strip, 2]
        met = asking[(asking[:, 0] + reach > x.min()) & (asking[:, 0] - reach < x.max()), 2]
        compared += int((np.searchsorted(z, met + reach) - np.searchsorted(z, met - reach)).sum())
    near = np.count_nonzero((np.abs(places[:, None] - asking) < reach).all(2))
    assert near > 20_000 and compared < 2 * near


def test_turned_off_and_on_again() -> None:
    with irrsplat.Renderer(room(), SIZE, **FAST, adapt=0.0) as plain, irrsplat.Renderer(room(), SIZE, **FAST) as renderer:
        before = plain.render()
        renderer.render()
        limits = np.frombuffer(renderer.cache.records.textures["limit"].read(), "f4")
        assert (limits < 1.0).any()
        renderer.change(replace(renderer.settings, adapt=0.0))
        renderer.frame()
        assert (renderer.cache.limits(renderer.cache.count) == 1.0).all(), "of the records that were there, too"
        renderer.forget()
        after = renderer.render()
    assert np.array_equal(after.records_position, before.records_position)
    assert np.array_equal(after.weight, before.weight)


def test_the_limits_of_many_are_those_of_the_few_near_them(ctx: moderngl.Context) -> None:
    """More records than one draw compares with, in distant rooms: each room has the limits it would have alone, for any parts.

    Some rooms' records arrive late. Removed records leave nothing behind.
    """
    settings, many = replace(BASE, weights="paper"), 45
    rooms = [Made(ctx, 900, seed) for seed in (1, 2, 3)]
    alone = [made.limits(settings)[:900] for made in rooms]
    whole = Made(ctx, 900 * many)
    for i in range(many):
        made, part = rooms[i % 3], slice(900 * i, 900 * (i + 1))
        for name, values in vars(made).items():
            if isinstance(values, np.ndarray):
                getattr(whole, name)[part] = values
        whole.p[part] += (32.0 * (i // 7), 0.0, 32.0 * (i % 7))
    found = whole.limits(settings, 900, 7000, 33000, 40000)[: 900 * many].reshape(many, 900)
    for i in range(many):
        assert np.isclose(found[i], alone[i % 3], rtol=2e-3, atol=1e-4).mean() > 0.99
    shortened = Made(ctx, 1300)
    again = shortened.limits(settings, 700, -100)
    assert np.array_equal(again, shortened.limits(settings))
