"""Other materials and hidden meshes: records are gathered again in place, and in the end they are those of a fresh render."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from irrsplat import InputError, Renderer
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.scene.model import Image, Material, Mesh, Scene, Texture
from irrsplat.scene.motion import hidden
from tests.renderer.test_no_holes import holes, rest
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.worlds import box

GLOWING = Material((0.5, 0.5, 0.5), (6.0, 4.0, 2.0))
RED = Material((0.8, 0.1, 0.05))


def world() -> Scene:
    """The room with a small box in it."""
    scene = room()
    return replace(scene, meshes=(*scene.meshes, replace(box((0.4, -0.9, -0.5), (0.8, -0.5, -0.1)), name="box")))


def mean(renderer: Renderer) -> np.ndarray:
    """(3,) the irradiance of the view."""
    return np.nanmean(renderer.render().irradiance, axis=(0, 1))


def without(scene: Scene, number: int) -> Scene:
    """The scene with a mesh hidden."""
    meshes = list(scene.meshes)
    meshes[number] = hidden(meshes[number], scene.meshes[0].positions[0])
    return replace(scene, meshes=tuple(meshes))


@pytest.mark.parametrize("bounces", [1, "all"])
@pytest.mark.parametrize("what", ["walls red", "box glows", "box dark again", "box hidden", "box shown"])
def test_a_repainted_scene_is_lit_as_a_fresh_one(what: str, bounces: Any) -> None:
    """In ticks, without a hole at the end, and without one of its records."""
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
    with Renderer(before, SIZE, **{**FAST, "bounces": bounces}) as renderer:
        old = mean(renderer)
        if "box" in what and what.split()[1] in ("hidden", "shown"):
            renderer.pose(after)
        else:
            number = 0 if what == "walls red" else "box"
            renderer.repaint(number, after.meshes[0 if number == 0 else last].material)
        view, _ = rest(renderer, None, 0.02)
        assert holes(view) == 0
        new = mean(renderer)
        with Renderer(after, SIZE, **{**FAST, "bounces": bounces}) as fresh:
            expected = mean(fresh)
        assert new == pytest.approx(expected, rel=0.03)
        assert np.abs(old / expected - 1.0).max() > (0.005 if "hidden" in what or "shown" in what else 0.06)


def test_what_glows_becomes_an_area_light_and_ceases_to_be_one() -> None:
    with Renderer(world(), SIZE, **FAST) as renderer:
        renderer.render()
        assert emitter_table(renderer.world) is None
        renderer.repaint("box", GLOWING)
        renderer.render()
        table = emitter_table(renderer.world)
        assert table is not None and table.count == 12
        renderer.pose(without(renderer.scene, len(renderer.scene.meshes) - 1))
        renderer.render()
        assert emitter_table(renderer.world) is None, "hidden, it lights nothing"


def test_a_moved_mesh_keeps_its_paint_and_a_painted_one_its_place() -> None:
    with Renderer(world(), SIZE, **FAST) as renderer:
        renderer.repaint("box", RED)
        step = np.eye(4)
        step[0, 3] = 0.1
        renderer.move("box", step)
        moved = renderer.scene.meshes[-1]
        assert moved.material == RED
        renderer.repaint("box", GLOWING)
        assert renderer.scene.meshes[-1].positions is moved.positions and renderer.scene.meshes[-1].material == GLOWING


def test_the_same_paint_again_makes_nothing_stale() -> None:
    with Renderer(world(), SIZE, **FAST) as renderer:
        renderer.render()
        renderer.repaint("box", renderer.scene.meshes[-1].material)
        assert not len(renderer.cache.stale)
        renderer.repaint("box", RED)
        assert len(renderer.cache.stale) == renderer.cache.count > 0, "each keeps its place and what it holds"


@pytest.mark.parametrize(
    "material",
    [
        Material(albedo_texture=Texture(Image(np.full((2, 2, 4), 255, np.uint8)))),
        Material(opacity=0.2, alpha_mode="blend"),
        Material(transmission=0.9),
    ],
    ids=["texture", "opacity", "transmission"],
)
def test_what_cannot_change_in_place_is_refused_and_changes_nothing(material: Material) -> None:
    with Renderer(world(), SIZE, **FAST) as renderer:
        before, scene = mean(renderer), renderer.scene
        with pytest.raises(InputError, match="load the scene anew"):
            renderer.repaint("box", material)
        assert renderer.scene is scene and renderer.world.shows(scene) and not len(renderer.cache.stale)
        assert np.array_equal(mean(renderer), before)


def test_unknown_meshes_are_named() -> None:
    with Renderer(world(), SIZE, **FAST) as renderer, pytest.raises(InputError, match="there is no mesh 'sofa'"):
        renderer.repaint("sofa", RED)


def test_records_of_a_hidden_mesh_go() -> None:
    """And those of others stay."""
    with Renderer(world(), SIZE, **FAST) as renderer:
        renderer.render()
        mesh: Mesh = renderer.scene.meshes[-1]
        low, high = mesh.positions.min(0) - 1e-4, mesh.positions.max(0) + 1e-4
        on_it = ((renderer.cache.positions >= low) & (renderer.cache.positions <= high)).all(1)
        count = renderer.cache.count
        renderer.pose(without(renderer.scene, len(renderer.scene.meshes) - 1))
        assert renderer.cache.count == count - np.count_nonzero(on_it) < count
