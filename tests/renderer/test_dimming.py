"""Lamps that are dimmed or recoloured: light is linear in them, so that it follows at once, and nothing is gathered."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.view import read
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Light, Scene
from irrsplat.scene.motion import repainted
from irrsplat.surface_cache.lamp_parts import recoloured
from tests.renderer.test_live import TICK, ticks
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import lamp, material

HELD = ("irradiance", "vectors", "gradient", "radius")
SETTINGS: dict[str, Any] = {**FAST, "gather": "trace"}


def lit_by(*lights: Light, glow: tuple[float, float, float] = (0.0, 0.0, 0.0), sky: float = 0.0) -> Scene:
    """The room with its left wall glowing so, lit by these lamps."""
    plain = room(sky)
    return replace(repainted(plain, len(plain.meshes) - 1, material((0.7, 0.1, 0.1), glow)), lights=lights)


LAMP, OTHER = room().lights[0], lamp((-0.5, 0.2, 0.5), 5.0)


def coloured(light: Light, *factor: float) -> Light:
    """The light with these factors on its colour."""
    return replace(light, color=tuple((np.array(light.color) * factor).tolist()))


def gathered_afresh(renderer: Renderer, settings: dict[str, Any]) -> dict[str, np.ndarray]:
    """What the renderer's records would hold, gathered by a renderer that knows no other lights than those of now."""
    with Renderer(renderer.scene, SIZE, **settings) as fresh:
        fresh.cache.append(renderer.cache.sites(slice(0, renderer.cache.count)))
        fresh.cache.invalidate()
        shadows, gbuffer = fresh.draw_shadows(), fresh.draw_gbuffer(FRONT)
        assert fresh.scheduler.prepare(shadows, Budget(None))
        fresh.scheduler.renew(shadows, gbuffer, FRONT, Budget(None))
        return fresh.cache.gathered(*HELD)


def check(renderer: Renderer, settings: dict[str, Any], off: float = 1e-4) -> None:
    """Every record holds what it would if it were gathered now; off: relative, by how much not."""
    found, truth = renderer.cache.gathered(*HELD), gathered_afresh(renderer, settings)
    for name in HELD:
        assert np.allclose(found[name], truth[name], rtol=off, atol=0.1 * off * np.abs(truth[name]).max()), name


@pytest.mark.parametrize("bounces", [1, 3, "all"])
def test_a_lone_lamp_is_dimmed_at_once(bounces: Any) -> None:
    """The very next tick, however short, shows what a fresh render does, and nothing is left to do."""
    settings = SETTINGS | {"bounces": bounces}
    lights = (coloured(LAMP, 0.3, 0.3, 0.3),)
    with Renderer(lit_by(LAMP), SIZE, **settings) as old, Renderer(lit_by(*lights), SIZE, **settings) as fresh:
        old.render()
        ticks(old)
        truth = fresh.render()
        old.relight(lights)
        view, progress = old.frame(seconds=TICK)
        found = read(view, old.cache.read(), {})
        assert not progress.stale and not progress.new and "gather" not in old.timers.milliseconds()
        for one, other in ((found.irradiance, truth.irradiance), (found.image, truth.image)):
            assert np.allclose(one, other, rtol=1e-4, atol=1e-5 * other.max())
        assert ticks(old)[-1].done and old.cache.count == len(truth.records_radius)


@pytest.mark.parametrize("bounces", [1, "all"])
def test_recoloured_records_are_those_of_a_fresh_gather(bounces: Any) -> None:
    """Each channel by a factor of its own; what is gathered in another view later is lit alike; and so it is on the way back."""
    settings = SETTINGS | {"bounces": bounces}
    with Renderer(lit_by(LAMP, OTHER), SIZE, **settings) as renderer:
        renderer.render()
        before = renderer.cache.gathered(*HELD)
        count = renderer.cache.count
        renderer.relight([coloured(light, 0.5, 1.5, 4.0) for light in (LAMP, OTHER)])
        assert not len(renderer.cache.stale)
        check(renderer, settings)
        renderer.render(replace(FRONT, eye=(0.3, 0.2, 0.95)))
        assert renderer.cache.count > count
        check(renderer, settings)
        renderer.relight([LAMP, OTHER])
        after = renderer.cache.gathered(*HELD)
        assert all(np.allclose(after[name][:count], before[name], rtol=1e-5, atol=1e-6) for name in HELD)


def test_a_lamp_goes_out_at_once_and_comes_again() -> None:
    """Of nothing no factor leads back: then records are gathered."""
    settings = SETTINGS | {"bounces": "all"}
    with Renderer(lit_by(LAMP), SIZE, **settings) as renderer:
        renderer.render()
        renderer.relight([coloured(LAMP, 0.0, 1.0, 0.0)])
        assert not len(renderer.cache.stale) and not renderer.cache.read()["irradiance"][:, [0, 2]].any()
        check(renderer, settings, 1e-2)  # where green alone is left, bounces end at another number
        renderer.relight([LAMP])
        assert len(renderer.cache.stale) == renderer.cache.count
        assert ticks(renderer)[-1].done
        check(renderer, settings)


def test_dimmed_while_a_view_still_fills_it_comes_to_the_same() -> None:
    """Surface cache and records half made, some of them stale by an older change."""
    settings = SETTINGS | {"bounces": "all"}
    with Renderer(lit_by(LAMP), SIZE, **settings) as renderer:
        for _ in range(3):
            renderer.frame(seconds=TICK)
        renderer.relight([coloured(LAMP, 2.0, 2.0, 2.0)])
        while not renderer.cache.count:
            renderer.frame(seconds=TICK)
        renderer.relight([coloured(OTHER, 2.0, 2.0, 2.0)])  # elsewhere: stale
        renderer.frame(seconds=TICK)
        renderer.relight([OTHER])
        assert ticks(renderer)[-1].done
        check(renderer, settings)


def test_the_fading_picture_is_dimmed_too() -> None:
    """What still fades over from an older change is dimmed with the rest: the same picture, darker."""
    shown = []
    for by in (0.25, 1.0 + 1e-6):
        with Renderer(lit_by(LAMP), SIZE, **SETTINGS) as renderer:
            ticks(renderer, 10.0)
            for light in (OTHER, coloured(OTHER, by, by, by)):
                renderer.relight([light])
                view, progress = renderer.frame(seconds=10.0)
            assert progress.fading
            shown.append(read(view, renderer.cache.read(), {}).irradiance)
    assert np.allclose(shown[0], 0.25 * shown[1], rtol=1e-3, atol=1e-3 * shown[0].max())


THIRD = lamp((0.6, -0.4, 0.5), 1.0)


@pytest.mark.parametrize("bounces", [1, 3, "all"])
def test_one_lamp_of_three_is_dimmed_at_once(bounces: Any) -> None:
    """After its first change, what it brings is gathered apart; from then on it follows, below a sky and beside a glowing wall.

    The sums of bounces are those of a lamp alone, so that they may end at another number: a hair's difference.
    """
    settings = SETTINGS | {"bounces": bounces}
    with Renderer(lit_by(LAMP, OTHER, THIRD, glow=(0.5, 0.2, 0.1), sky=0.2), SIZE, **settings) as renderer:
        renderer.render()
        renderer.relight([LAMP, coloured(OTHER, 0.5, 0.5, 0.5), THIRD])
        assert len(renderer.cache.stale) == renderer.cache.count
        assert ticks(renderer, 10.0)[-1].done
        for factor in ((0.2, 0.5, 3.0), (0.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.5, 0.5, 0.5)):
            renderer.relight([LAMP, coloured(OTHER, *factor), THIRD])
            assert not len(renderer.cache.stale)
            view, progress = renderer.frame(seconds=TICK, gather=False)
            assert not progress.fading
            shown = read(view, renderer.cache.read(), {}).irradiance
            renderer.forget(records=False)
            again = read(renderer.frame(gather=False)[0], renderer.cache.read(), {}).irradiance
            assert np.allclose(shown, again, rtol=1e-5)
            check(renderer, settings, 1e-2)
            assert ticks(renderer, 10.0)[-1].done


def test_what_is_known_of_a_lamp_ends_with_its_place_and_grows_with_the_view() -> None:
    settings = SETTINGS | {"bounces": "all"}
    with Renderer(lit_by(LAMP, OTHER), SIZE, **settings) as renderer:
        renderer.render()
        renderer.relight([LAMP, coloured(OTHER, 0.5, 0.5, 0.5)])
        ticks(renderer, 10.0)
        aside = replace(FRONT, eye=(0.3, 0.2, 0.95))
        count = renderer.cache.count
        renderer.render(aside)
        assert renderer.cache.count > count
        renderer.relight([LAMP, OTHER])
        assert renderer.cache.stale.tolist() == list(range(count, renderer.cache.count)), "those that are new since"
        ticks(renderer, 10.0)
        renderer.relight([LAMP, coloured(OTHER, 2.0, 1.0, 1.0)])
        assert not len(renderer.cache.stale)
        check(renderer, settings, 1e-3)
        renderer.relight([coloured(LAMP, 2.0, 1.0, 1.0), coloured(OTHER, 2.0, 1.0, 1.0)])
        assert len(renderer.cache.stale) == renderer.cache.count, "nothing is known of the first lamp"
        ticks(renderer, 10.0)
        renderer.relight([replace(LAMP, position=(0.2, 0.6, 0.2)), OTHER])
        assert ticks(renderer, 10.0)[-1].done
        check(renderer, settings, 1e-3)
        renderer.relight([replace(LAMP, position=(0.2, 0.6, 0.2)), coloured(OTHER, 0.1, 0.1, 0.1)])
        assert len(renderer.cache.stale) == renderer.cache.count
        assert ticks(renderer, 10.0)[-1].done
        check(renderer, settings, 1e-3)


def test_a_lamp_that_goes_out_leaves_no_noise_of_finer_looks() -> None:
    """A refined view's records come from more rays than what is known of a lamp: those that lose most are gathered again."""
    settings = SETTINGS | {"bounces": "all", "gather_size": 16}
    with Renderer(lit_by(LAMP, coloured(OTHER, 20.0, 20.0, 20.0)), SIZE, **settings) as renderer:
        renderer.render()
        renderer.relight([LAMP, coloured(OTHER, 10.0, 10.0, 10.0)])
        ticks(renderer, 10.0)
        surface = renderer.scheduler.gatherer.surface_now
        assert surface is not None
        while not surface.refined:
            renderer.refine(None, 0.005, seconds=0.2)
        renderer.relight([LAMP, coloured(OTHER, 0.0, 0.0, 0.0)])
        assert 0 < len(renderer.cache.stale) <= renderer.cache.count
        assert ticks(renderer, 10.0)[-1].done
        found, truth = renderer.cache.gathered("irradiance")["irradiance"], gathered_afresh(renderer, settings)["irradiance"]
        assert np.sqrt(((found - truth) ** 2).mean()) < 0.02 * truth.mean()


CASES: list[tuple[Scene, Scene, tuple[float, float, float] | None]] = [
    (lit_by(LAMP), lit_by(coloured(LAMP, 0.5, 0.5, 0.5)), (0.5, 0.5, 0.5)),
    (lit_by(LAMP), lit_by(replace(coloured(LAMP, 0.0, 2.0, 1.0), name="hall")), (0.0, 2.0, 1.0)),
    (lit_by(LAMP, OTHER), lit_by(coloured(LAMP, 3.0, 2.0, 1.0), coloured(OTHER, 3.0, 2.0, 1.0)), (3.0, 2.0, 1.0)),
    (lit_by(LAMP, coloured(OTHER, 0, 0, 0)), lit_by(coloured(LAMP, 3.0, 2.0, 1.0), coloured(OTHER, 0, 0, 0)), (3.0, 2.0, 1.0)),
    (lit_by(LAMP, OTHER), lit_by(coloured(LAMP, 0.5, 0.5, 0.5), OTHER), None),
    (lit_by(LAMP), lit_by(replace(coloured(LAMP, 0.5, 0.5, 0.5), position=(0.0, 0.0, 0.0))), None),
    (lit_by(LAMP), lit_by(LAMP, OTHER), None),
    (lit_by(coloured(LAMP, 0.0, 1.0, 1.0)), lit_by(LAMP), None),
    (lit_by(LAMP, sky=0.1), lit_by(coloured(LAMP, 0.5, 0.5, 0.5), sky=0.1), None),
    (lit_by(LAMP, glow=(0.1, 0, 0)), lit_by(coloured(LAMP, 0.5, 0.5, 0.5), glow=(0.1, 0, 0)), None),
    (lit_by(LAMP, glow=(0.1, 0, 0)), lit_by(coloured(LAMP, 1.0, 0.5, 0.5), glow=(0.1, 0, 0)), (1.0, 0.5, 0.5)),
    (lit_by(LAMP), lit_by(LAMP), None),
]


@pytest.mark.parametrize(("before", "after", "factor"), CASES)
def test_which_changes_are_a_factor_on_all_light(before: Scene, after: Scene, factor: tuple[float, ...] | None) -> None:
    found = SceneChange.between(before, replace(after, meshes=before.meshes)).dimming
    assert (found is None) == (factor is None)
    assert found is None or factor is None or np.allclose(found, factor)


def test_another_sky_beside_a_recoloured_lamp_is_no_matter_of_the_lamp_alone() -> None:
    """As where the turbidity of a sky with a sun changes."""
    for after in (lit_by(coloured(LAMP, 0.5), sky=2.0), lit_by(coloured(LAMP, 0.5), OTHER, sky=2.0)):
        before = replace(after, lights=(LAMP, *after.lights[1:]), sky=(1.0, 1.0, 1.0))
        change = SceneChange.between(before, after)
        assert change.other_sky and change.dimming is None and recoloured(change) is None
