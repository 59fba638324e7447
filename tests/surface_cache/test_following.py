"""The surface cache while a lamp is carried through a room: its values follow from tick to tick, before they are made again."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.gpu.time_budget import Budget
from irrsplat.image.view import read
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Light
from irrsplat.surface_cache.follower import overlap
from tests.renderer.test_live import TICK, ticks
from tests.renderer.test_renderer import FRONT
from tests.support.worlds import box, lamp, material, scene
from tests.surface_cache.test_bounces import ALL, made, values
from tests.surface_cache.test_bounces import few as few

WALLS = box((-1, -1, -1), (1, 1, 1), material((0.8, 0.6, 0.5)), outward=False)
THING = box((-0.4, -1, -0.6), (0.2, -0.3, 0.0), material((0.2, 0.6, 0.8)))
STEPS = 10


def carried(share: float) -> tuple[float, float, float]:
    """From just under the ceiling, where it lights a small bright spot, across the room."""
    return -0.7 + 1.3 * share, 0.95 - 0.6 * share, 0.0


ROOM = scene(WALLS, THING, lights=(lamp(carried(0.0)),), camera=FRONT)


def lit(share: float) -> list[Light]:
    """The lamps when it has come so far, 0..1."""
    return [replace(ROOM.lights[0], position=carried(share))]


@pytest.mark.usefixtures("few")
def test_what_was_known_of_a_lamp_goes_with_it(ctx: moderngl.Context) -> None:
    """The bright spot above a lamp does not stay where the lamp was: what follows is near what is made anew."""
    after = replace(ROOM, lights=tuple(lit(1.0)))
    with made(ctx, ROOM) as renderer, made(ctx, after) as other:
        surface = renderer.scheduler.gatherer.surface
        assert surface is not None
        for step in range(1, STEPS + 1):
            renderer.relight(lit(step / STEPS))
            assert surface.advance(renderer.draw_shadows(), Budget(TICK)) and surface.following
        assert surface.layout is not None
        area, found, true = surface.layout.area[:, None], values(renderer), values(other)
        off = np.sqrt((area * (found - true) ** 2).sum() / (area * true**2).sum())
        assert off < 0.1
        assert (area * found).sum() == pytest.approx((area * true).sum(), rel=0.1)


@pytest.mark.usefixtures("few")
def test_how_much_of_a_lamp_s_light_still_holds() -> None:
    area, D = np.array([1.0, 3.0]), np.array([[1.0, 2.0, 3.0], [4.0, 4.0, 4.0]])
    assert overlap(D, D, area) == 1.0 and overlap(0 * D, 0 * D, area) == 1.0
    assert overlap(D * [[1], [0]], D * [[0], [1]], area) == 0.0
    assert overlap(D, 0.8 * D, area) == pytest.approx(0.6)


@pytest.mark.usefixtures("few")
def test_no_pixel_goes_dark_while_a_lamp_is_carried() -> None:
    """In ticks that do no more than they must; and soon after, the picture is that of a fresh render."""
    after = replace(ROOM, lights=tuple(lit(1.0)))
    with Renderer(ROOM, (48, 40), **ALL) as renderer, Renderer(after, (48, 40), **ALL) as fresh:
        renderer.render()
        true = fresh.render().irradiance
        for step in range(1, STEPS + 1):
            renderer.relight(lit(step / STEPS))
            view, _ = renderer.frame(seconds=TICK)
            found = read(view, renderer.cache.read(), {})
            seen = np.isfinite(found.depth)
            assert (found.irradiance[seen].sum(1) > 0.05 * true[seen].sum(1)).all()
        ticks(renderer, 10.0)
        last = renderer.render().irradiance
        assert np.sqrt(((last - true) ** 2).mean()) < 0.06 * true.mean()
