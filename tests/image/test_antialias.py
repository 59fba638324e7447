"""Samples off the pixels' centres: their positions, means and convergence."""

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
from irrsplat.core.timing.input_waits import InputWaits, checked_by
from irrsplat.gpu.target import pixels, table_texture
from irrsplat.image.antialias import MeanPass, jittered, sample_offset
from irrsplat.image.backdrop import Backdrop
from irrsplat.scene.model import Camera, Scene
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import ABOVE, assert_pictures, box, floor, material, point_light, quad, rays, scene

MEANS = ("image", "direct", "indirect", "emission")

# ---- where they lie ---------------------------------------------------------------------------------------------------


def test_the_first_sample_is_the_centre_and_so_many_fill_the_pixel_evenly() -> None:
    """Halton: of the first b^n samples each of b^n strips of the pixel (b 2 across, 3 up, 5 in the turn) holds just one."""
    assert sample_offset(0) == (0.0, 0.0, 0.0)
    for axis, count, span in ((0, 64, 1.0), (1, 81, 1.0), (2, 125, 0.5 * math.pi)):
        along = np.sort([(sample_offset(i)[axis] / span + (0.5 if axis < 2 else 0.0)) for i in range(count)])
        assert np.array_equal(np.floor(along * count + 1e-6), np.arange(count)), axis


@pytest.mark.parametrize("offset", [(0.3, -0.4), (-0.5, 0.5)])
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
    """Random samples, some of which see nothing, some of which no record covers: running means as in numpy."""
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
        material, direct = {name: some() for name in ("albedo", "emission")}, some()
        columns: Any = {name: texture for name, (_, texture) in material.items()}
        albedo, emission = material["albedo"], material["emission"]
        values = chance.random((height, width, 4)).astype("f4") * heard[..., None]
        textures = add(
            number,
            GBuffer(position[1], normal[1], **columns),
            direct[1],
            table_texture(ctx, values),
            centre_texture,
            Backdrop("sky", Scene((), (), (), sky)).uniforms(ABOVE, (width, height)),
            mix,
        )
        padded = np.pad(values, ((1, 1), (1, 1), (0, 0)), mode="edge")
        around = np.sum([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)], axis=0)
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
    for turn in np.arange(4) * 0.8 + 0.1:
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


# ---- shadows ----------------------------------------------------------------------------------------------------------


# ---- a frame's contract -----------------------------------------------------------------------------------------------


SETTINGS: Any = ({}, {"blend": 0.8, "preset": "paper", "warmup": 50, "a": 0.3}, {"bounces": 0})


@pytest.mark.parametrize("settings", SETTINGS)
def test_what_is_a_mean_and_what_is_the_centre_s(settings: dict[str, Any]) -> None:
    """The image is the blend of the means; geometry, irradiance, weight and records are those of one sample, bit for bit."""
    world = scene(floor(0.5), box((-0.2, 0, -0.2), (0.1, 0.3, 0.1)), lights=(point_light((1, 2, 1)),), sky=(0.1, 0.2, 0.3))
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


def test_ticks_add_stages_of_samples_and_come_to_what_a_render_has() -> None:
    """A tick without time left draws a part of a sample, until there are as many as requested; none while input waits."""
    with Renderer(room(), SIZE, **FAST) as renderer:
        renderer.render()
        view = renderer.frame()[0]
        assert renderer.accumulate(view, 1) is view and renderer.accumulate(view, 0) is view
        with checked_by(lambda: True):
            assert [renderer.accumulate(view, 5, seconds=1.0).samples for _ in range(30)] == [1] * 30
        counts = [renderer.accumulate(view, 5, seconds=1e-6).samples for _ in range(30)]
        assert counts == sorted(counts) and all(counts.count(n) > 1 for n in range(1, 6))
        image = pixels(renderer.accumulate(view, 5).image)[..., :3].copy()
        renderer.change(replace(renderer.settings, samples=5))
        assert np.array_equal(image, renderer.render().image)


def test_a_sample_that_input_interrupts_is_drawn_again() -> None:
    """The light moves after the view is drawn: its second sample needs shadow maps, and input waits once they are drawn."""

    def direct(interrupted: bool) -> np.ndarray:
        with Renderer(room(), SIZE, **FAST) as renderer:
            renderer.render()
            view = renderer.frame()[0]
            renderer.relight([point_light((-0.5, 0.6, 0.2), 3.0)])
            if interrupted:
                with checked_by(lambda: True), pytest.raises(InputWaits):
                    renderer.accumulate(view, 2)
            return pixels(renderer.accumulate(view, 2).direct).copy()

    assert np.array_equal(direct(interrupted=True), direct(interrupted=False))


@pytest.mark.parametrize("tile_size", [0, 20])
def test_ctrl_c_leaves_the_samples_that_there_are(tile_size: int) -> None:
    """Interrupted after half of the samples, the picture is whole: the mean of fewer samples, or of one in further tiles."""

    def stop(progress: Any) -> None:
        if progress.sampled >= 0.5:
            raise KeyboardInterrupt

    with Renderer(room(), SIZE, **FAST, samples=4, tile_size=tile_size) as renderer:
        frame = renderer.render(progress=stop)
        assert frame.stats["interrupted"] and not frame.stats["converged"] and frame.stats["samples"] < 4
        whole = renderer.render()
        assert np.abs(frame.image - whole.image).mean() < 0.05 * whole.image.mean()
