"""Changed lights and sky: converged records and pictures equal those of a fresh render."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.core.timing.clock import use_clock
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect import paper_scan
from irrsplat.reference import fine_gather
from irrsplat.scene.model import Camera, Light, Scene
from irrsplat.scene.motion import hidden, repainted
from tests.renderer.test_live import TICK, dimmed, ticks
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.counted_clock import RayClock
from tests.support.skies import mapped
from tests.support.worlds import box, floor, material, point_light, quad, scene

LIGHT, OTHER, THIRD = room().lights[0], point_light((-0.5, 0.2, 0.5), 5.0), point_light((0.6, -0.4, 0.5), 1.0)
HELD = ("irradiance", "vectors", "gradient", "radius")
TRACED: dict[str, Any] = {**FAST, "gather": "trace"}


def lit_by(*lights: Light, glow: tuple[float, float, float] = (0.0, 0.0, 0.0), sky: float = 0.0) -> Scene:
    """Return the room with these lights and an emissive left wall."""
    plain = room(sky)
    return replace(repainted(plain, len(plain.meshes) - 1, material((0.7, 0.1, 0.1), glow)), lights=lights)


def coloured(light: Light, *factor: float) -> Light:
    """Return the light with these factors on its colour."""
    return replace(light, color=tuple((np.array(light.color) * factor).tolist()))


def gathered_afresh(renderer: Renderer) -> dict[str, np.ndarray]:
    """Return the values of the renderer's records, gathered at their places along as many rays by a new renderer of the scene."""
    with Renderer(renderer.scene, renderer.size, ctx=renderer.ctx, **vars(renderer.settings)) as fresh:
        fresh.cache.append(renderer.cache.sites(slice(0, renderer.cache.count)))
        fresh.cache.column("gather_size")[:] = renderer.cache.column("gather_size")
        fresh.cache.invalidate()
        shadows, gbuffer = fresh.draw_shadows(), fresh.draw_gbuffer(renderer.scene.camera())
        assert fresh.scheduler.gatherer.prepare(shadows, Budget(None))
        fresh.scheduler.refresh(shadows, gbuffer, renderer.scene.camera(), Budget(None))
        return fresh.cache.records.read(*HELD)


def error(found: dict[str, np.ndarray], truth: dict[str, np.ndarray]) -> float:
    """Return the mean difference of the irradiance of records, relative to its mean."""
    return float(np.abs(found["irradiance"] - truth["irradiance"]).mean() / truth["irradiance"].mean())


@pytest.mark.few_sites
@pytest.mark.parametrize("bounces", [1, "all"])
def test_renewed_in_place_is_gathered_from_scratch(ctx: moderngl.Context, bounces: Any) -> None:
    """Under changed lights, records converge to those of a fresh cache at equal sites.

    Lights move: one bounce is equal bit for bit. Further bounces are coarse first, and records with a difference above 2 %
    are gathered again. One of three lights, under a sky and next to an emissive wall, changes its colour, goes out and on
    again.
    """
    with Renderer(room(), SIZE, ctx=ctx, **{**TRACED, "bounces": bounces}) as renderer:
        renderer.render()
        renderer.relight((OTHER, coloured(LIGHT, 1.0, 0.4, 0.1)))
        assert ticks(renderer, 0.01)[-1].done
        found, truth = renderer.cache.records.read(*HELD), gathered_afresh(renderer)
        assert error(found, truth) < 0.005
        assert bounces != 1 or all(np.array_equal(found[name], truth[name]) for name in HELD)
    world = lit_by(LIGHT, OTHER, THIRD, glow=(0.5, 0.2, 0.1), sky=0.2)
    with Renderer(world, SIZE, ctx=ctx, **{**TRACED, "bounces": bounces}) as renderer:
        renderer.render()
        for factor in ((0.0, 0.0, 0.0), (0.2, 0.5, 3.0)):
            renderer.relight([LIGHT, coloured(OTHER, *factor), THIRD])
            assert ticks(renderer, 10.0)[-1].done
            found, truth = renderer.cache.records.read(*HELD), gathered_afresh(renderer)
            assert error(found, truth) < 0.005
            assert bounces != 1 or all(np.array_equal(found[name], truth[name]) for name in HELD)


@pytest.mark.few_sites
@pytest.mark.parametrize(("bounces", "lights"), [(1, (dimmed(LIGHT, 0.3),)), ("all", (dimmed(LIGHT, 0.3),)), ("all", ())])
def test_a_single_light_is_dimmed_at_once(ctx: moderngl.Context, bounces: Any, lights: tuple[Light, ...]) -> None:
    """Light is linear in its only source: the next frame, however short, shows a fresh render's picture, or darkness."""
    settings = {**TRACED, "bounces": bounces}
    after = lit_by(*lights)
    with Renderer(lit_by(LIGHT), SIZE, ctx=ctx, **settings) as old, Renderer(after, SIZE, ctx=ctx, **settings) as fresh:
        old.render()
        ticks(old)
        truth = fresh.render()
        old.relight(after.lights)
        view, progress = old.frame(seconds=TICK)
        found = view.read()
        assert not progress.stale and not progress.new
        for one, other in ((found.irradiance, truth.irradiance), (found.image, truth.image)):
            assert np.allclose(one, other, rtol=1e-4, atol=1e-5 * other.max())


def test_a_dimmed_view_goes_on_to_request_records(ctx: moderngl.Context) -> None:
    """Each of ten dimmings completes a round without a gain. None of them counts towards a stall of the view.

    A view gives up after eight successive rounds without a gain. Later, another colour makes records differ, and pixels between
    them request further records.
    """
    with Renderer(lit_by(LIGHT, sky=0.0), SIZE, ctx=ctx, **{**TRACED, "bounces": 1}) as renderer:
        renderer.render()
        for factor in 10 * [(0.9, 0.9, 0.9)]:
            renderer.relight([coloured(renderer.scene.lights[0], *factor)])
            assert ticks(renderer, 10.0)[-1].done
        before = renderer.cache.count
        renderer.relight([coloured(renderer.scene.lights[0], 0.01, 1.0, 0.01)])
        assert ticks(renderer, 10.0)[-1].done and renderer.cache.count > before


def truth(renderer: Renderer, count: int = 250) -> fine_gather.Truth:
    """Return the renderer's fine gather of one bounce at some of its pixels."""
    seen = paper_scan.read_back(renderer.frame(gather=False)[0].gbuffer)
    size = renderer.settings.shadow_size
    return fine_gather.gather(renderer.world, seen, size, count, seconds=1e6)


def test_light_that_changes_little_needs_no_coarse_values_and_leaves_some_records_their_rays() -> None:
    """One of 16 lights fades by half, a thirtieth of the light. Values that follow a small change are nearer than coarse ones.

    Probes correct all records, and a record with a change of less than 2 % keeps its rays.
    """
    cornell, renewed, errors = irrsplat.load("cornell"), 0, []
    (light,) = cornell.lights
    x, y, z = light.position
    many = tuple(
        replace(coloured(light, 1 / 16), position=(x + dx, y, z + dz))
        for dx in (-0.6, -0.2, 0.2, 0.6)
        for dz in (-0.6, -0.2, 0.2, 0.6)
    )
    after = replace(cornell, lights=(coloured(many[0], 0.5), *many[1:]))
    with Renderer(after, (64, 48)) as fresh:
        reference = fresh.render().irradiance
    with use_clock(RayClock(1e6)), Renderer(replace(cornell, lights=many), (64, 48)) as renderer:
        renderer.render()
        renderer.relight(after.lights)
        done = False
        while not done:
            view, progress = renderer.frame(seconds=0.05)
            done, renewed = progress.done, renewed + progress.renewed
            assert not renderer.scheduler.gatherer.provisional
            errors.append(np.sqrt(np.mean((view.read().irradiance - reference) ** 2)) / reference.mean())
        assert max(errors) < 0.03 and renewed < 0.8 * renderer.cache.count


def test_changed_lights_behind_walls_leave_records_black_and_complete(ctx: moderngl.Context) -> None:
    """Records and luminance floor are 0, and so is their change. The share 0/0 is no number for a file."""
    rooms = [box((x - 1, -1, -1), (x + 1, 1, 1), outward=False) for x in (0, 8)]
    many = tuple(point_light((8.0 + 0.1 * x, 0.0, 0.0), 1.0) for x in range(8))
    world = scene(*rooms, lights=many, camera=Camera((0.0, 0.0, 0.8), (0.0, 0.0, 0.0)))
    with Renderer(world, SIZE, ctx=ctx, **{**TRACED, "bounces": 1}) as renderer:
        renderer.render()
        renderer.relight((dimmed(many[0], 0.5), *many[1:]))
        with np.errstate(invalid="raise"):
            assert ticks(renderer, 10.0)[-1].done
        assert renderer.cache.count and not renderer.cache.column("drift").any() and not renderer.cache.values[:, :3].any()


def test_after_other_lights_errors_are_those_of_a_fresh_render() -> None:
    """Five seeds: a single pixel at the foot of a box may double one seed's error."""
    before = irrsplat.load("cornell")
    (old,) = before.lights
    x, y, z = old.position
    after = replace(before, lights=(replace(old, position=(x - 1.0, y, z), color=(34.0, 9.6, 0.8)),))
    errors: list[list[float]] = []
    reference: fine_gather.Truth | None = None
    for seed in range(5):
        kind: dict[str, Any] = {"bounces": 1, "gather_size": 32, "shadow_size": 512, "seed": seed}
        with Renderer(after, (80, 80), **kind) as new, Renderer(before, (80, 80), **kind) as changed:
            reference = reference or truth(new)
            changed.render()
            changed.relight(after.lights)
            errors.append([reference.error(one.render().irradiance) or 0.0 for one in (new, changed)])
    fresh, relit = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 0.001 < fresh < 0.1 and relit < 1.4 * fresh


@pytest.mark.long
def test_no_spot_check_compares_stale_records_with_probes() -> None:
    """Stale records hold the light of before: a check among them finds faults everywhere, and makes thousands of records."""
    dark = irrsplat.load("door")
    lights = [replace(dark.lights[0], color=(0.0, 0.0, 0.0)), *dark.lights[1:]]
    with Renderer(dark, (320, 240), bounces="all") as renderer:
        renderer.render()
        renderer.relight(lights)
        while not renderer.frame(seconds=0.08)[1].done:
            pass
        count = renderer.cache.count
    with Renderer(replace(dark, lights=tuple(lights)), (320, 240), bounces="all") as fresh:
        assert count < 1.6 * fresh.render().stats["records"]


@pytest.mark.parametrize("bounces", [1, pytest.param("all", marks=pytest.mark.long)])
def test_another_sky_lights_in_proportion_and_a_map_of_one_radiance_as_that(bounces: Any) -> None:
    """A box on a floor under a sky alone: three times the radiance gives three times the irradiance everywhere.

    A map of uniform radiance has the same effect; the records stay, and no trace of the old sky remains after convergence.
    """
    plain = scene(floor(), box((-0.5, 0.0, -0.5), (0.5, 0.7, 0.5)), sky=1.0)
    tripled = replace(plain, sky=(3.0, 3.0, 3.0))
    around = replace(mapped(plain, np.full((32, 64, 3), 3.0)), sky=(0.0, 0.0, 0.0))
    with Renderer(plain, SIZE, **{**TRACED, "bounces": bounces}, radius_max=25.0) as renderer:
        before = renderer.render().irradiance
        count = renderer.cache.count
        for other, times in ((tripled, 3.0), (around, 3.0), (plain, 1.0)):
            renderer.pose(other)
            after = renderer.render().irradiance
            assert after.mean() == pytest.approx(times * before.mean(), rel=0.01) and before.mean() > 0.5
            assert np.quantile(np.abs(after - times * before), 0.95) < 0.03 * times * before.mean()
            assert renderer.cache.count <= 1.1 * count


def test_pictures_stay_near_a_fresh_render_once_a_carried_light_rests() -> None:
    """The values that follow a light are about as exact as coarse ones, and full ones are more exact.

    So no picture from the last step on is far from a fresh render, and the last one is nearer than the coarse ones.
    """
    cornell = irrsplat.load("cornell")
    x, y, z = cornell.lights[0].position
    carried = [replace(cornell.lights[0], position=(x + 0.15 * step, y, z)) for step in range(1, 5)]
    with Renderer(replace(cornell, lights=(carried[-1],)), (64, 48)) as fresh:
        reference = fresh.render().irradiance
    with use_clock(RayClock(4e6)), Renderer(cornell, (64, 48)) as renderer:
        renderer.frame(seconds=0.05)  # makes the coarse values
        renderer.render()
        errors = []
        for light in (*carried, *12 * [carried[-1]]):
            renderer.relight([light])
            view, _ = renderer.frame(seconds=0.05)
            errors.append(np.sqrt(np.mean((view.read().irradiance - reference) ** 2)) / reference.mean())
    rest = errors[len(carried) - 1 :]
    assert max(rest) < 0.07 and rest[-1] < 0.6 * max(rest)  # 0.060 and 0.026 measured


@pytest.mark.parametrize(("others", "most"), [(0, 0.25), (15, 0.3)])
def test_the_third_picture_is_lit_everywhere_once_a_light_of_a_dark_scene_is_on_again(others: int, most: float) -> None:
    """Records of a dark scene are removed. Probes fill the holes, where black records would be gathered again one by one.

    While the scene stays dark, all records stay.
    """
    cornell = irrsplat.load("cornell")
    off = coloured(cornell.lights[0], 0.0)
    with use_clock(RayClock(1e6)), Renderer(replace(cornell, lights=(*cornell.lights, *[off] * others)), (64, 48)) as renderer:
        lights, reference = renderer.scene.lights, renderer.render().irradiance
        renderer.relight([off] * len(lights))
        view, progress = renderer.frame(seconds=0.05)
        assert progress.records and not view.read().irradiance.any()
        renderer.change(replace(renderer.settings, blend=0.5))
        assert renderer.cache.count == progress.records
        renderer.relight(lights)
        *_, found = (renderer.frame(seconds=0.05)[0].read().irradiance for _ in range(3))
    assert np.sqrt(np.mean((found - reference) ** 2)) < most * reference.mean(), "0.19, 0.25; 0.70 with black records"


def test_the_fifth_picture_is_lit_everywhere_once_the_only_emitter_is_shown_again() -> None:
    """A hidden emitter leaves a dark scene. To show it is a change of light, although a mesh moves."""
    walls, things, _ = room().meshes
    panel = quad((-0.4, 0.95, -0.4), (0.8, 0, 0), (0, 0, 0.8), material((0.5, 0.5, 0.5), (6.0, 6.0, 6.0)))
    lit = scene(walls, things, panel, camera=room().camera())
    with use_clock(RayClock(1e6)), Renderer(lit, (64, 48)) as renderer:
        reference = renderer.render().irradiance
        renderer.pose(replace(lit, meshes=(walls, things, hidden(panel, np.array((0.0, 0.95, 0.0))))))
        assert not renderer.render().irradiance.any()
        renderer.pose(lit)
        *_, found = (renderer.frame(seconds=0.05)[0].read().irradiance for _ in range(5))
    assert np.sqrt(np.mean((found - reference) ** 2)) < 0.1 * reference.mean(), "0.03; 0.72 with black records"


def test_records_by_present_light_take_no_former_change_of_the_surface_cache() -> None:
    """A light is carried from the first tick on, in flight: coarse values wait for the first records, and then follow at once.

    Records have the light by then. Scaled by the whole change again, those of one wall had twice their light.
    """
    cornell, size, carried, worst = irrsplat.load("cornell"), (160, 120), 12, 0.0
    camera, (light, *others) = cornell.camera(), cornell.lights
    eye, ahead = np.array(camera.eye), np.array(camera.target) - camera.eye
    with (
        use_clock(RayClock(1.2e6)),
        Renderer(cornell, size, seed=1) as renderer,
        Renderer(cornell, size, preset="preview") as fresh,
    ):
        for tick in range(carried):
            position = tuple((np.array(light.position) + tick * np.array([0.02, -0.01, 0.02])).tolist())
            lights, angle = (replace(light, position=position), *others), np.radians(2.5 * tick)
            turned = ahead * np.cos(angle) + np.cross(camera.up, ahead) * np.sin(angle)
            seen = replace(camera, target=tuple((eye + turned).tolist()))
            renderer.relight(lights)
            view, _ = renderer.frame(seen, 0.08)
            if tick > 8:
                fresh.relight(lights)
                found, expected = view.read().irradiance, fresh.render(seen, buffers=["irradiance"]).irradiance
                worst = max(worst, float(np.sqrt(((found - expected) ** 2).mean()) / expected.mean()))
    assert worst < 0.3


@pytest.mark.parametrize(("before", "after"), [("all", 1), (1, "all")])
def test_a_picture_follows_other_bounces_before_half_of_the_records_are_gathered_again(before: Any, after: Any) -> None:
    """Probes along few rays correct all records, and the picture takes their values at once. Both lights differ by half."""
    cornell = irrsplat.load("cornell")
    with Renderer(cornell, (64, 48), bounces=after) as fresh:
        reference = fresh.render().irradiance
    with use_clock(RayClock(4e6)), Renderer(cornell, (64, 48), bounces="all") as renderer:
        renderer.render()
        renderer.change(replace(renderer.settings, bounces=before))
        renderer.render()
        renderer.change(replace(renderer.settings, bounces=after))
        stale, error = renderer.cache.count, 0.0
        while stale > renderer.cache.count / 2:
            view, progress = renderer.frame(seconds=0.05)
            stale, error = progress.stale, np.sqrt(np.mean((view.read().irradiance - reference) ** 2)) / reference.mean()
        assert stale > 0 and error < 0.07


@pytest.mark.parametrize("ticks", [False, True])
def test_records_of_a_file_take_the_light_of_other_bounces(ticks: bool, tmp_path: Path) -> None:
    """The surface cache of a file is made after the change. Its first values replace the light of all records.

    Otherwise records keep their light, or those of both lights mix. Probes then add the former light once more.
    """
    two, everything = ({**TRACED, "gather_size": 16, "bounces": bounces} for bounces in (2, "all"))
    with Renderer(room(), SIZE, **two) as fresh:
        reference, count = fresh.render().irradiance, fresh.cache.count
    with Renderer(room(), SIZE, **everything) as renderer:
        brighter = renderer.render().irradiance
        renderer.save_cache(tmp_path / "all.npz")
    with use_clock(RayClock(4e6)), Renderer(room(), SIZE, **everything) as renderer:
        renderer.load_cache(tmp_path / "all.npz")
        renderer.render()
        renderer.change(replace(renderer.settings, bounces=2))
        while ticks and not renderer.frame(seconds=0.05)[1].still:
            assert renderer.frame(seconds=0.05)[0].read().irradiance.mean() < 1.01 * brighter.mean()
        found = renderer.render()
    assert np.sqrt(np.mean((found.irradiance - reference) ** 2)) < 0.05 * reference.mean()
    assert found.stats["records"] < 1.5 * count
