"""Repeated, moved and simultaneous renders: records persist, pictures repeat to the bit, renderers are independent."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from irrsplat import Frame, Renderer
from irrsplat.core.buffers import CHANNELS
from irrsplat.gpu import context
from irrsplat.scene.model import Camera
from tests.renderer.test_renderer import FAST, FRONT, SIZE, rendered, room, unserved
from tests.support.worlds import box, floor, point_light, scene


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    """A renderer of `room` after one render of FRONT."""
    with Renderer(room(), SIZE, **FAST) as made:
        made.render()
        yield made


def same(one: Frame, other: Frame, names: tuple[str, ...] = tuple(CHANNELS)) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


# ---- repetition -------------------------------------------------------------------------------------------------------


def test_fresh_renderers_agree_bit_for_bit() -> None:
    one, other = rendered(room(), seed=3), rendered(room(), seed=3)
    assert same(one, other)
    for name in ("position", "normal", "irradiance", "radius"):
        assert np.array_equal(getattr(one, f"records_{name}"), getattr(other, f"records_{name}"))


def test_another_seed_is_another_picture_but_not_much() -> None:
    one, other = rendered(room(), gather_size=16), rendered(room(), gather_size=16, seed=1)
    assert not np.array_equal(one.irradiance, other.irradiance) and not np.array_equal(
        one.records_position[:5], other.records_position[:5]
    )
    assert np.array_equal(one.direct, other.direct) and np.array_equal(one.position, other.position)
    assert np.sqrt(np.mean((one.irradiance - other.irradiance) ** 2)) < 0.25 * one.irradiance.mean()
    assert one.irradiance.mean() == pytest.approx(other.irradiance.mean(), rel=0.03)


def test_away_and_back_gathers_hardly_anything_the_second_time(renderer: Renderer) -> None:
    """Records of the second view may limit the radii of a few records of the first one."""
    before = renderer.render()
    away = renderer.render(Camera((0.2, 0.3, 0.9), (0.5, -0.5, -1.0), fov=50.0))
    back = renderer.render()
    assert away.stats["records"] > before.stats["records"]
    assert away.stats["records"] <= back.stats["records"] <= 1.02 * away.stats["records"]
    assert unserved(back) == 0 and same(before, back, ("position", "normal", "albedo", "depth", "direct", "emission"))
    assert np.sqrt(np.mean((back.irradiance - before.irradiance) ** 2)) < 0.1 * before.irradiance.mean()


def turned(camera: Camera, degrees: float) -> Camera:
    """Return the camera rotated to the left about its up vector."""
    t = np.radians(degrees)
    right, up, backward = camera.axes
    forward = -np.cos(t) * backward - np.sin(t) * right
    return Camera(camera.eye, tuple(np.asarray(camera.eye) + forward), tuple(up), camera.fov)


def test_incremental_splats_are_one_full_splat_bit_for_bit() -> None:
    """The sum of several rounds equals one draw of all records: a picture depends on records alone."""
    with Renderer(room(), SIZE, **FAST) as fresh:
        rounds = fresh.render()
        limits = fresh.cache.limits(fresh.cache.count)
        fresh.render(turned(FRONT, 180.0))  # the first view's last records may limit others now
        cleared = fresh.render()  # redrawn: all records at once, those of the other view last
        count = rounds.stats["records"]
        fresh.cache.truncate(count)
        fresh.cache.set_limits(limits)
        fresh.forget(records=False)
        once = fresh.render()
    assert rounds.stats["rounds"] > 2 and once.stats["rounds"] == 1 and once.stats["records"] == count
    assert same(rounds, once)
    assert cleared.stats["records"] > count


# ---- several renderers ------------------------------------------------------------------------------------------------


def test_renderers_do_not_disturb_each_other() -> None:
    """Two renderers of different scenes and sizes take turns, each is released while the other lives: results as if alone."""
    worlds = {
        (48, 40): room(),
        (30, 50): scene(floor(1.0), box((0, 0, 0), (0.3, 0.4, 0.3)), lights=(point_light((1, 2, 1)),), sky=0.2),
    }
    alone = {}
    for size, world in worlds.items():
        with Renderer(world, size, **FAST) as one:
            alone[size] = [one.render(), one.render(turned(world.camera(), 20.0))]
    pair = {size: Renderer(world, size, **FAST) for size, world in worlds.items()}
    by_turns: dict[tuple[int, int], list[Frame]] = {size: [] for size in worlds}
    for angle in (0.0, 20.0):
        for size, one in pair.items():
            camera = one.scene.camera()
            by_turns[size].append(one.render(turned(camera, angle) if angle else camera))
    for size, one in pair.items():
        assert all(same(a, b) for a, b in zip(alone[size], by_turns[size], strict=True)), size
        one.release()


def test_a_given_context_is_left_to_its_owner() -> None:
    """A renderer in its caller's context draws the same picture, and leaves the context alive and current for a window."""
    alone = rendered(room())
    mine = context.create()
    with Renderer(room(), SIZE, ctx=mine, **FAST) as one:
        frame = one.render()
        assert mine.buffer(b"alive").read() == b"alive", "after a render"
    assert mine.buffer(b"alive").read() == b"alive", "after the release"
    mine.release()
    assert same(frame, alone)
