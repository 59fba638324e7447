"""What moves in a scene: what differs between two states, and meshes and lights along a path, by keys in a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from irrsplat import InputError
from irrsplat.scene import load
from irrsplat.scene.camera_path import Path, load_path
from irrsplat.scene.change import SceneChange
from irrsplat.scene.io.motion_keys import curve
from irrsplat.scene.model import Light, Scene
from irrsplat.scene.motion import moved
from tests.support.worlds import box, floor, lamp, scene

SHIFT = np.column_stack([np.eye(3), (0.1, 0.0, 0.0)])
SCENE = load("cornell")
MOVED = moved(SCENE, SCENE.meshes, 2, SHIFT)
DIMMED = replace(SCENE, lights=tuple(replace(light, color=(1.0, 1.0, 1.0)) for light in SCENE.lights))
CAM = "frames 21\ncam 0 0 5 0 0 0 0 1 0\n"


def read(folder: File, text: str) -> Path:
    (folder / "a.path").write_text(CAM + text)
    return load_path(folder / "a.path")


def world() -> Scene:
    """A floor, a box about (1, 2, 3), a lamp and a spot."""
    spot = Light((0, 5, 0), (1, 1, 1), spot_target=(0, 0, 0), spot_cutoff=20.0)
    return scene(floor(9.0), box((0, 1, 2), (2, 3, 4)), lights=(lamp((0, 3, 0)), spot))


def test_a_curve_is_the_cameras_spline_and_holds_for_uneven_keys() -> None:
    """Even keys: Catmull and Rom's weights at the middle, -1/16, 9/16, 9/16, -1/16. Uneven ones on a line stay on it."""
    values = np.array([[3.0], [1.0], [4.0], [1.5]])
    assert curve([0, 2, 4, 6], values, 3.0) == pytest.approx((-3.0 + 9.0 + 36.0 - 1.5) / 16.0)
    uneven = [0.0, 1.0, 4.0, 5.0, 9.0]
    straight = np.array(uneven)[:, None] * np.array([2.0, -1.0])
    assert np.allclose(curve(uneven, straight, 2.2), [4.4, -2.2])
    assert np.array_equal(curve(uneven, straight, -1.0), straight[0]) and np.array_equal(
        curve(uneven, straight, 99.0), straight[-1]
    )


def test_a_mesh_goes_turns_and_stretches(tmp_path: File) -> None:
    """By number: half a way on and half a turn about its own middle at half time; by a matrix mirrored and larger."""
    there = world()
    motions = read(tmp_path, "mesh 1 0 0 0 0\nmesh 1 20 4 0 0 90 0 3 0\n").motions
    motions.check(there, 21)
    before, after = there.meshes[1].positions.astype(float), motions.at(there, 10.0).meshes[1].positions
    c, s = np.cos(np.pi / 4), np.sin(np.pi / 4)
    turned = (before - (1, 2, 3)) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + (3, 2, 3)
    assert np.allclose(after, turned, atol=1e-5)
    assert motions.at(there, 10.0).meshes[0] is there.meshes[0] and motions.at(there, 10.0).lights is there.lights
    matrix = read(tmp_path, "mesh 1 5  -2 0 0 1  0 2 0 0  0 0 2 0\n").motions.at(there, 17.0).meshes[1].positions
    assert np.allclose(matrix, before * (-2, 2, 2) + (1, 0, 0), atol=1e-5)


def test_lights_go_look_and_dim(tmp_path: File) -> None:
    text = "light 0 0 position 0 3 0\nlight 0 20 position 2 3 0\nlight 1 4 spotDirection 1 0 0\n"
    text += "light 1 0 color 2 2 2\nlight 1 20 color 0 0 4\n"
    motions = read(tmp_path, text).motions
    motions.check(world(), 21)
    first, second = motions.at(world(), 10.0).lights
    assert first.position == pytest.approx((1, 3, 0)) and second.spot_target == (1, 0, 0)
    assert second.color == pytest.approx((1, 1, 3)) and second.position == (0, 5, 0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mesh 1 0 1 2\n", "a.path:3: 'mesh' has 4 values; expected: mesh NAME FRAME X Y Z"),
        ("mesh 1 x 1 2 3\n", "a.path:3: 'x' is not a number; expected: mesh NAME"),
        ("mesh 1 0 1 2 3 90 0 0 0\n", "a.path:3: the axis of the turn is 0 0 0"),
        ("mesh 1 0 1 0 0 0 0 1 0 0 0 0 0 0\n", "a.path:3: the transform is singular"),
        ("mesh ball 0 1 2 3\n", "a.path:3: there is no mesh 'ball'"),
        ("mesh 7 0 1 2 3\n", "a.path:3: there is no mesh 7; the scene has 2"),
        ("mesh 1 21 1 2 3\n", "a.path:3: frame 21: the path's frames are 0 to 20"),
        ("mesh 1 3 1 2 3\nmesh 1 3 0 0 0\n", "a.path:4: mesh has two keys for frame 3 (line 3)"),
        ("light 0 0 position 1 2\n", "a.path:3: 'light' has 5 values; expected: light NUMBER FRAME"),
        ("light lamp 0 position 1 2 3\n", "a.path:3: 'lamp' is no number of a light"),
        ("light 0 0 colour 1 2 3\n", "a.path:3: unknown value 'colour' of a light"),
        ("light 0 0 color 1 -2 3\n", "a.path:3: a colour is not negative"),
        ("light 2 0 color 1 2 3\n", "a.path:3: there is no light 2; the scene has 2"),
        ("light 0 0 spotDirection 1 2 3\n", "a.path:3: light 0 has no cone"),
    ],
)
def test_what_a_file_may_not_say(text: str, words: str, tmp_path: File) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text).motions.check(world(), 21)
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("new", "meshes", "relit"),
    [
        (SCENE, (), False),
        (replace(SCENE, lights=tuple(replace(light) for light in SCENE.lights)), (), False),  # equal lights, new objects
        (DIMMED, (), True),
        (replace(SCENE, lights=()), (), True),
        (MOVED, (2,), False),
        (moved(MOVED, SCENE.meshes, 0, SHIFT), (0, 2), False),
        (replace(MOVED, lights=DIMMED.lights), (2,), True),
    ],
)
def test_a_change_names_what_moved_and_whether_lights_differ(new: Scene, meshes: tuple[int, ...], relit: bool) -> None:
    change = SceneChange.between(SCENE, new)
    assert (change.old, change.new, change.moved, change.relit) == (SCENE, new, meshes, relit)
    assert bool(change) == bool(meshes or relit)


def test_scenes_of_different_meshes_are_no_change() -> None:
    with pytest.raises(ValueError, match="zip"):
        SceneChange.between(SCENE, replace(SCENE, meshes=SCENE.meshes[:-1]))
