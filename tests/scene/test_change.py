"""What differs between two states of a scene: moved meshes, other lights, or nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irrsplat.scene import load
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Scene
from irrsplat.scene.motion import moved

SHIFT = np.column_stack([np.eye(3), (0.1, 0.0, 0.0)])
SCENE = load("cornell")
MOVED = moved(SCENE, SCENE.meshes, 2, SHIFT)
DIMMED = replace(SCENE, lights=tuple(replace(light, color=(1.0, 1.0, 1.0)) for light in SCENE.lights))


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
