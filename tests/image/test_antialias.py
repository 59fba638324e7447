"""Samples beside the pixels' centres: where they lie, what their mean is, and that it is the picture, only smoother at edges."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.core.buffers import CHANNELS, GBuffer
from irrsplat.core.material_layout import PROPERTIES
from irrsplat.gpu.target import pixels, table_texture
from irrsplat.image import antialias
from irrsplat.image.antialias import MeanPass
from irrsplat.image.backdrop import Backdrop
from irrsplat.image.jitter import jittered, sample_offset
from irrsplat.image.view import View
from irrsplat.scene.model import Camera, Light, Scene
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import ABOVE, assert_pictures, box, floor, lamp, material, quad, rays, scene

MEANS = ("image", "direct", "indirect", "emission")

# ---- where they lie ---------------------------------------------------------------------------------------------------


def test_the_first_sample_is_the_centre_and_so_many_fill_the_pixel_evenly() -> None:
    """Halton: of the first b^n samples each of b^n strips of the pixel (b 2 across, 3 up, 5 in the turn) holds just one."""
    assert sample_offset(0) == (0.0, 0.0, 0.0)
    for axis, count, span in ((0, 64, 1.0), (1, 81, 1.0), (2, 125, 0.5 * math.pi)):
        along = np.sort([(sample_offset(i)[axis] / span + (0.5 if axis < 2 else 0.0)) for i in range(count)])
        assert np.array_equal(np.floor(along * count + 1e-6), np.arange(count)), axis


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.3, -0.4), (-0.5, 0.5)])
def test_the_camera_beside_sees_at_the_centre_what_the_camera_saw_off_it(offset: tuple[float, float]) -> None:
    """A point on the ray through a pixel's offset is projected to that pixel's centre, at any depth."""
    camera, size = Camera((0.3, 1.0, 2.0), (0.1, -0.2, -1.0), fov=50.0), (40, 30)
    row, column = 7, 31
    right, up, _ = camera.axes
    step = camera.screen / size[1]  # of a pixel, at distance 1
    way = rays(camera, size)[row, column] + step * (offset[0] * right + offset[1] * up)
    other = jittered(camera, offset, size)
    for depth in (0.5, 7.0):
        world = np.append(np.asarray(camera.eye) + depth * way, 1.0)
        clip = other.clip_from_view(size[0] / size[1], 0.1, 10.0) @ other.view_from_world @ world
        x, y = clip[:2] / clip[3]
        assert ((x + 1.0) / 2.0 * size[0], (1.0 - y) / 2.0 * size[1]) == pytest.approx((column + 0.5, row + 0.5))


# ---- their mean -------------------------------------------------------------------------------------------------------


def test_the_means_are_those_of_the_samples(ctx: moderngl.Context) -> None:
    """Random samples, some of which see nothing, some of which no record speaks for: running means as in numpy."""
    chance, (height, width), count, mix, sky = np.random.default_rng(3), (5, 7), 9, (0.4, 1.0), (0.1, 0.2, 0.3)

    def some(*last: np.ndarray) -> tuple[np.ndarray, moderngl.Texture]:
        values = chance.random((height, width, 4)).astype("f4")
        for w in last:
            values[..., 3] = w
        return values, table_texture(ctx, values)

    centre, centre_texture = some(np.full((height, width), 2.0, "f4"))
    total, covered = {name: np.zeros((height, width, 3)) for name in MEANS}, np.zeros((height, width))
    add = MeanPass(ctx, (width, height))
    for number in range(1, count + 1):
        seen = chance.random((height, width)) < 0.8
        heard = chance.random((height, width)) < 0.7
        heard[0, :4] = heard[1, :4] = heard[2, :4] = False  # here nobody around knows anything either
        position, normal = some(seen), some()
        material, direct = {c.name: some() for c in PROPERTIES}, some()
        albedo, emission = material["albedo"], material["emission"]
        values = chance.random((height, width, 4)).astype("f4") * heard[..., None]
        textures = add(
            number,
            GBuffer(position[1], normal[1], **{name: texture for name, (_, texture) in material.items()}),
            direct[1],
            table_texture(ctx, values),
            centre_texture,
            Backdrop("sky", Scene((), (), (), sky)).uniforms(ABOVE, (width, height)),
            mix,
        )
        padded = np.pad(values, ((1, 1), (1, 1), (0, 0)), mode="edge")
        around = sum(padded[y : y + height, x : x + width] for y in range(3) for x in range(3))
        sums = np.where(heard[..., None], values, np.where(around[..., 3:] > 0.0, around, centre))
        E = sums[..., :3] / sums[..., 3:]
        parts = {"direct": direct[0][..., :3], "indirect": albedo[0][..., :3] / np.pi * E, "emission": emission[0][..., :3]}
        parts = {name: np.where(seen[..., None], part, sky if name == "emission" else 0.0) for name, part in parts.items()}
        parts["image"] = mix[0] * parts["direct"] + mix[1] * parts["indirect"] + parts["emission"]
        for name, part in parts.items():
            total[name] += part
        covered += seen
    for name, texture in zip(MEANS, textures, strict=False):
        assert np.allclose(pixels(texture)[::-1, :, :3], total[name] / count, rtol=2e-6, atol=1e-6), name
    assert np.allclose(pixels(textures[-1])[::-1, :, 0], covered / count, rtol=2e-6, atol=1e-6)


def glowing(turn: float) -> Scene:
    """A large square that glows, its edge through the middle of the picture at an angle, before a dark sky; seen from above."""
    c, s = math.cos(turn), math.sin(turn)
    u, v = np.array([c, 0.0, s]), np.array([-s, 0.0, c])
    return scene(
        quad(-10 * u, 20 * u, 20 * v, material(0.0, 1.0)), quad(-10 * u, 20 * v, 20 * u, material(0.0, 1.0)), camera=ABOVE
    )


def test_edges_come_to_the_share_of_the_pixel_that_is_covered() -> None:
    """Exact coverage by 32 x 32 places in each pixel, edges at all angles. The error of the mean falls as that of Halton's points
    does for a half plane, by N^-3/4: at 16 samples to an eighth of what one sample is off, at 64 to a twentieth, about."""
    size, fine = (24, 24), 32
    way = rays(ABOVE, (size[0] * fine, size[1] * fine))
    p = way * (-ABOVE.eye[1] / way[..., 1:2])
    off = dict.fromkeys((1, 4, 16, 64), 0.0)
    for turn in np.arange(8) * 0.8 + 0.1:
        inside = -p[..., 0] * math.sin(turn) + p[..., 2] * math.cos(turn) > 0.0
        truth = inside.reshape(size[1], fine, size[0], fine).mean((1, 3))
        with Renderer(glowing(turn), size, bounces=0) as renderer:
            for count in off:
                renderer.change(replace(renderer.settings, samples=count))
                frame = renderer.render()
                assert np.array_equal(frame.image, frame.emission)
                off[count] += np.mean((frame.image[..., 0] - truth) ** 2)
        assert_pictures(f"edge_{turn:.1f}", frame.image[..., 0], truth, 0.06)
    one, four, sixteen, many = (math.sqrt(error) for error in off.values())
    assert one > 0.05 and four < 0.7 * one and sixteen < one / 4.0 and many < one / 13.0, (one, four, sixteen, many)


def test_a_furnace_has_no_edges() -> None:
    """Every surface reflects half and emits 1: of one bounce, L = 1 + ρ everywhere, edges or not, however samples meet them."""
    paint = material(0.5, 1.0)
    world = scene(
        box((-1, -1, -1), (1, 1, 1), paint, outward=False), box((-0.4, -0.999, -0.6), (0.2, -0.3, 0.0), paint), camera=FRONT
    )
    frame = irrsplat.render(world, (64, 48), bounces=1, gather_size=32, samples=16)
    assert frame.stats["samples"] == 16
    assert np.abs(frame.image / 1.5 - 1.0).max() < 0.02


def test_the_mean_is_as_bright_as_the_picture_and_flat_places_stay() -> None:
    """No bias: the whole picture keeps its mean, and what is smooth its value."""
    one, many = (irrsplat.render(room(), (96, 80), **FAST, samples=n) for n in (1, 64))
    assert many.image.mean() == pytest.approx(one.image.mean(), rel=3e-3)
    steps = [
        np.abs(np.diff(one.image, axis=axis, prepend=np.inf)) + np.abs(np.diff(one.image, axis=axis, append=np.inf))
        for axis in (0, 1)
    ]
    flat = ((steps[0] < 0.06 * one.image.mean()) & (steps[1] < 0.06 * one.image.mean())).all(-1)
    assert flat.mean() > 0.3
    assert np.abs(many.image - one.image)[flat].max() < 0.03 * one.image.mean()
    assert many.image[flat].mean() == pytest.approx(one.image[flat].mean(), rel=1e-3)


# ---- shadows ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_shadows_are_as_soft_as_their_filter_and_no_softer(slope: float) -> None:
    """A square lamp-side up over a floor, a sun above: beyond the filter's reach (four samples in a ring of 0.71 texels, each of
    the nearest texel, so 1.42) and a pixel's own half size all is lit as by formula, or dark; within, it is smooth."""
    side, size = 256, (120, 90)
    sun = Light((slope, 1.0, 0.0), (1.0, 1.0, 1.0), directional=True, physical=True)
    camera = Camera((0.0, 1.2, 2.6), (0.0, 0.0, 0.0), fov=50.0)
    world = scene(floor(2.0, 0.0, material(1.0)), floor(0.5, 0.6, material(1.0)), lights=(sun,), camera=camera)
    frame = irrsplat.render(world, size, bounces=0, shadow_size=side, samples=32)
    p = frame.position
    on = np.isfinite(frame.depth) & (np.abs(p[..., 1]) < 1e-4)
    x, z = p[..., 0] + 0.6 * slope, p[..., 2]
    inside = 0.5 - np.maximum(np.abs(x), np.abs(z))  # metres from the shadow's edge, > 0 in it
    texel = 1.001 * world.diagonal / (side - 4) * math.hypot(1.0, slope)
    pixel = np.maximum(*(np.linalg.norm(np.gradient(p, axis=axis), axis=-1) for axis in (0, 1)))
    near = np.abs(inside) < 1.5 * texel + 1.5 * pixel
    edge_of_floor = 2.0 - np.maximum(np.abs(p[..., 0]), np.abs(p[..., 2])) < 2.0 * pixel
    seen = on & ~edge_of_floor & np.roll(on, 2, 0) & np.roll(on, -2, 0) & np.roll(on, 2, 1) & np.roll(on, -2, 1)
    lit = 1.0 / math.pi / math.hypot(1.0, slope)
    truth = np.where(inside > 0.0, 0.0, lit)
    assert (seen & ~near & (inside > 0.0)).sum() > 50 and (seen & ~near & (inside < 0.0)).sum() > 1000
    assert_pictures(f"shadow_{slope}", frame.direct[..., 0], truth, 2e-3 * lit, seen & ~near)
    between = frame.direct[..., 0][seen & near]
    assert np.mean((between > 0.02 * lit) & (between < 0.98 * lit)) > 0.2


# ---- a frame's contract -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "settings", [{}, {"blend": 0.8}, {"smooth": True}, {"preset": "paper", "warmup": 50, "a": 0.3}, {"bounces": 0}]
)
def test_what_is_a_mean_and_what_is_the_centre_s(settings: dict[str, Any]) -> None:
    """The image is the blend of the means; geometry, irradiance, weight and records are those of one sample, bit for bit."""
    world = scene(floor(0.5), box((-0.2, 0, -0.2), (0.1, 0.3, 0.1)), lights=(lamp((1, 2, 1)),), sky=(0.1, 0.2, 0.3))
    one, many = (irrsplat.render(world, SIZE, **{**FAST, **settings, "samples": n}) for n in (1, 8))
    assert one.stats["samples"] == 1 and many.stats["samples"] == 8 and many.stats["converged"]
    assert many.stats["records"] == one.stats["records"]
    for name in set(CHANNELS) - {*MEANS, "alpha"} | {"records_position", "records_irradiance", "records_radius"}:
        assert np.array_equal(getattr(one, name), getattr(many, name)), name
    b = settings.get("blend", 0.5)
    mixed = min(1.0, 2.0 * (1.0 - b)) * many.direct + min(1.0, 2.0 * b) * many.indirect + many.emission
    assert np.allclose(many.image, mixed, rtol=1e-5, atol=1e-6)
    for name in MEANS:
        mean = getattr(many, name)
        assert np.isfinite(mean).all() and (mean >= 0.0).all() and mean.dtype == np.float32 and mean.flags["OWNDATA"]
        if not (name == "indirect" and settings.get("bounces") == 0):
            assert not np.array_equal(mean, getattr(one, name)), name
    unseen = np.isinf(one.depth)
    alone = np.logical_and.reduce([np.roll(unseen, step, axis) for axis in (0, 1) for step in (-1, 0, 1)])
    assert np.allclose(many.image[alone], world.sky, rtol=1e-6) and (many.direct[unseen] > 0.0).any()


# ---- ticks ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def renderer() -> Any:
    with Renderer(room(), SIZE, **FAST) as made:
        made.render()
        yield made


def test_samples_come_one_a_tick_at_least_and_end(renderer: Renderer) -> None:
    view = renderer.frame()[0]
    assert renderer.accumulate(view, 1) is view and renderer.accumulate(view, 0) is view
    counts = [renderer.accumulate(view, 5, seconds=1e-6).samples for _ in range(4)]
    assert counts == [2, 3, 4, 5]
    last = renderer.accumulate(view, 5, seconds=1e-6)
    renderer.timers.clear()
    assert renderer.accumulate(view, 5, seconds=1e-6) is last and renderer.timers.milliseconds() == {}
    assert last.gbuffer is view.gbuffer and last.sums is view.sums and last.image is not view.image
    assert renderer.accumulate(view, 40, seconds=10.0).samples == 40, "as many as there is time for"
    assert renderer.cache.count == renderer.frame()[1].records and renderer.frame()[0] is view


def test_in_ticks_they_come_to_what_a_render_has(renderer: Renderer) -> None:
    view = renderer.frame()[0]
    for _ in range(6):
        made = renderer.accumulate(view, 7, seconds=1e-6)
    image = pixels(made.image)[..., :3]
    with Renderer(room(), SIZE, **FAST, samples=7) as other:
        assert np.array_equal(image, other.render().image)


@pytest.mark.parametrize("change", ["camera", "light", "blend", "records"])
def test_another_view_starts_over(renderer: Renderer, change: str) -> None:
    view = renderer.frame()[0]
    before = pixels(renderer.accumulate(view, 6).image).copy()
    camera = None
    if change == "camera":
        camera = replace(FRONT, fov=55.0)
    elif change == "light":
        renderer.relight([lamp((-0.5, 0.2, 0.5), 5.0)])
    elif change == "blend":
        renderer.change(replace(renderer.settings, blend=0.7))
    else:
        renderer.forget()
    for _ in range(40):
        now, progress = renderer.frame(camera)
        if progress.done:
            break
    assert now is not view
    made = renderer.accumulate(now, 6, seconds=1e-6)
    assert made.samples == 2 and not np.array_equal(pixels(made.image), before)


def test_ctrl_c_leaves_the_samples_that_there_are(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = antialias._add_sample

    def add(number: int, *rest: Any) -> None:
        if number == 3:
            raise KeyboardInterrupt
        plain(number, *rest)

    monkeypatch.setattr(antialias, "_add_sample", add)
    renderer.change(replace(renderer.settings, samples=8))
    frame = renderer.render()
    assert frame.stats["samples"] == 3 and frame.stats["interrupted"] and not frame.stats["converged"]
    monkeypatch.undo()
    renderer.change(replace(renderer.settings, samples=3))
    assert np.array_equal(renderer.render().image, frame.image)


def test_a_render_tells_of_its_samples(renderer: Renderer) -> None:
    told: list[float] = []
    renderer.change(replace(renderer.settings, samples=4))
    renderer.render(progress=lambda now: told.append(now.sampled))
    assert told[-4:] == [0.0, 0.5, 0.75, 1.0]


def test_another_size_has_its_own_samples(renderer: Renderer) -> None:
    renderer.accumulate(renderer.frame()[0], 3)
    renderer.resize((30, 20))
    renderer.change(replace(renderer.settings, samples=3))
    assert renderer.render().image.shape == (20, 30, 3)


def test_a_view_says_which_textures_hold_what(renderer: Renderer) -> None:
    view: View = renderer.frame()[0]
    assert view.mean("indirect") is None and view.mean("image") is view.image
    many = renderer.accumulate(view, 2)
    assert all(many.mean(name) is not None for name in MEANS) and many.mean("normal") is None
