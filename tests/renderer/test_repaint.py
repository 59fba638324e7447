"""Changed materials and hidden meshes: records are gathered again in place and converge to those of a fresh render."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import InputError, Renderer
from irrsplat.core.timing.clock import use_clock
from irrsplat.scene.model import Image, Material, Scene, Texture
from irrsplat.scene.motion import hidden
from tests.renderer.test_no_holes import holes, rest
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.counted_clock import RayClock
from tests.support.worlds import box

GLOWING = Material((0.5, 0.5, 0.5), (6.0, 4.0, 2.0))
RED = Material((0.8, 0.1, 0.05))


def world() -> Scene:
    """Return the room with a small box in it."""
    scene = room()
    return replace(scene, meshes=(*scene.meshes, replace(box((0.4, -0.9, -0.5), (0.8, -0.5, -0.1)), name="box")))


def mean(renderer: Renderer) -> np.ndarray:
    """Return the mean irradiance (3,) of the view."""
    return np.nanmean(renderer.render().irradiance, axis=(0, 1))


def without(scene: Scene, number: int) -> Scene:
    """Return the scene with a hidden mesh."""
    meshes = list(scene.meshes)
    meshes[number] = hidden(meshes[number], scene.meshes[0].positions[0])
    return replace(scene, meshes=tuple(meshes))


@pytest.mark.parametrize(
    ("what", "bounces"),
    [
        *(("walls red", 1), ("box shown", 1)),
        *(pytest.param(what, "all", marks=pytest.mark.long) for what in ("walls red", "box glows", "box hidden")),
    ],
)
def test_a_repainted_scene_is_lit_as_a_fresh_one(ctx: moderngl.Context, what: str, bounces: Any) -> None:
    """Limited frames leave no hole and no stale record at the end."""
    before = after = world()
    last = len(before.meshes) - 1
    if what == "walls red":
        after = replace(before, meshes=(replace(before.meshes[0], material=RED), *before.meshes[1:]))
    elif what.startswith(("box glows", "box dark")):
        after = replace(before, meshes=(*before.meshes[:-1], replace(before.meshes[-1], material=GLOWING)))
    else:
        after = without(before, last)
    if what in ("box dark again", "box shown"):
        before, after = after, before
    with Renderer(before, SIZE, ctx=ctx, **{**FAST, "bounces": bounces}) as renderer:
        old = mean(renderer)
        if "box" in what and what.split()[1] in ("hidden", "shown"):
            renderer.pose(after)
        else:
            number = 0 if what == "walls red" else "box"
            renderer.repaint(number, after.meshes[0 if number == 0 else last].material)
        view, _ = rest(renderer, None, 0.05)
        assert holes(view) == 0
        new = mean(renderer)
        with Renderer(after, SIZE, ctx=renderer.ctx, **{**FAST, "bounces": bounces}) as fresh:
            expected = mean(fresh)
        assert new == pytest.approx(expected, rel=0.03)
        assert np.abs(old / expected - 1.0).max() > (0.003 if "hidden" in what or "shown" in what else 0.06)


def test_another_part_of_a_texture_reflects_as_in_a_fresh_scene() -> None:
    """The mapping alone changes: walls show the dark half of their texture in place of the bright one.

    The transport between the sites holds reflectances at hits. With those of the bright half, light was 23 % too bright.
    """
    pixels = np.full((8, 8, 4), 255, np.uint8)
    pixels[:, :4, :3] = 40
    image = Image(pixels)
    maps = (Texture(image, transform=(0.0, 0.0, u, 0.0, 0.0, 0.5)) for u in (0.25, 0.75))
    dark, bright = (Material((0.9, 0.9, 0.9), albedo_texture=one) for one in maps)
    walls = box((-1, -1, -1), (1, 1, 1), bright, outward=False)
    with Renderer(replace(world(), meshes=(walls, world().meshes[-1])), SIZE, **{**FAST, "bounces": "all"}) as renderer:
        mean(renderer)
        renderer.repaint(0, dark)
        after = mean(renderer)
        with Renderer(renderer.scene, SIZE, ctx=renderer.ctx, **{**FAST, "bounces": "all"}) as fresh:
            assert after == pytest.approx(mean(fresh), rel=0.03)


@pytest.mark.parametrize("what", ["walls", "sky", "glow"])
def test_indirect_light_follows_paint_and_sky_that_change_in_every_tick(what: str) -> None:
    """The slider of a reflectance is dragged over twelve ticks: it falls to a fifth, or the sky or a wall's emission brightens.

    No tick has time for a whole coarse surface cache. Light that waits for the last change is off by 100 to 450 % there.
    """
    cornell = irrsplat.load("cornell")
    white = cornell.meshes[0].material
    with use_clock(RayClock(1.5e6)), Renderer(cornell, (64, 48)) as renderer:
        renderer.frame(seconds=0.05)  # makes the coarse values
        renderer.render()
        for step in range(1, 13):
            if what == "walls":
                renderer.repaint(0, replace(white, albedo=tuple(0.88**step * np.array(white.albedo))))
            elif what == "glow":
                renderer.repaint("green", replace(renderer.scene.meshes[-1].material, emission=(0.1 * step,) * 3))
            else:
                renderer.pose(replace(renderer.scene, sky=(0.2 * step,) * 3))
            view, _ = renderer.frame(seconds=0.05)
        found, last = view.read().irradiance, renderer.scene
    with Renderer(last, (64, 48)) as fresh:
        reference = fresh.render().irradiance
    assert np.sqrt(np.mean((found - reference) ** 2)) < 0.115 * reference.mean()  # measured: 0.076, 0.088, 0.044


def test_no_picture_is_too_bright_after_paint_that_grows_lighter_in_every_tick() -> None:
    """Unfinished coarse light is of earlier paint. Records that probes change meanwhile would change twice by the next values."""
    cornell, reds = irrsplat.load("cornell"), []
    paints = [replace(cornell.meshes[0].material, albedo=(0.1 * step, 0.4, 0.4)) for step in range(9)]
    with use_clock(RayClock(6e5)), Renderer(cornell, (64, 48)) as renderer:
        renderer.frame(seconds=0.05)  # makes the coarse values
        renderer.repaint(0, paints[0])
        renderer.render()
        for paint in (*paints, *12 * paints[-1:]):  # a tick lasts a quarter of the time that coarse values take
            renderer.repaint(0, paint)
            reds.append(renderer.frame(seconds=0.05)[0].read().irradiance[..., 0].mean())
        assert max(reds) < 1.02 * renderer.render().irradiance[..., 0].mean()


def test_the_same_paint_again_makes_nothing_stale(ctx: moderngl.Context) -> None:
    with Renderer(world(), SIZE, ctx=ctx, **FAST) as renderer:
        renderer.render()
        renderer.repaint("box", renderer.scene.meshes[-1].material)
        assert not renderer.cache.waiting
        renderer.repaint("box", RED)
        assert renderer.cache.waiting == renderer.cache.count > 0, "each keeps its place and what it holds"


def test_what_cannot_change_in_place_is_refused_and_changes_nothing(ctx: moderngl.Context) -> None:
    materials = (
        Material(albedo_texture=Texture(Image(np.full((2, 2, 4), 255, np.uint8)))),
        Material(opacity=0.2, alpha_mode="blend"),
        Material(transmission=0.9),
    )
    with Renderer(world(), SIZE, ctx=ctx, **FAST) as renderer:
        before, scene = mean(renderer), renderer.scene
        for one in materials:
            with pytest.raises(InputError, match="load the scene anew"):
                renderer.repaint("box", one)
            assert renderer.scene is scene and renderer.world.shows(scene) and not len(renderer.cache.stale)
            assert np.array_equal(mean(renderer), before)
        with pytest.raises(InputError, match="there is no mesh 'sofa'"):
            renderer.repaint("sofa", RED)
