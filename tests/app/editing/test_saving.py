"""Saved scenes keep lights, cameras and triangles; a message lists the features that the format lacks."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.core.errors import InputError
from irrsplat.scene.io.text.scene_writer import write_scene
from irrsplat.scene.model import Camera, Image, Light, Material, Scene, Texture
from irrsplat.scene.motion import hidden, transformed
from tests.support.viewing import write_room

LIGHTS = (
    Light((0.1, 0.7, 1.0 / 3.0), (3.0, 2.0, 1.0), physical=True, name="bulb"),
    Light((0.3, 0.1, 0.2), (0.2, 0.3, math.pi), attenuation=(0.1, 0.2, 0.3), name="old"),
    Light((0.5, 0.5, 0.1), (4, 4, 4), False, True, spot_target=(0.1, -0.9, 0.3), spot_cutoff=31.7, spot_inner=12.3, name="spot"),
    Light((0.2, 1.0, 0.7), (0.25, 0.5, 0.75), directional=True, name="sun"),
)  # fmt: skip


@pytest.fixture
def room(tmp_path: Path) -> Scene:
    """Return the room of the viewer's tests with a moved and repainted box and a light of each kind."""
    scene = irrsplat.load(write_room(tmp_path))
    turn = np.eye(4)
    turn[:3, 3] = 0.123, 0.0456, 1.0 / 7.0
    box = replace(transformed(scene.meshes[2], turn), material=Material((0.1, 0.2, 1.0 / 3.0), (0.5, 0.25, 0.125)))
    return replace(scene, meshes=(*scene.meshes[:2], box), lights=LIGHTS)


def test_lights_cameras_and_triangles_are_saved_exactly(room: Scene, tmp_path: Path) -> None:
    assert write_scene(room, tmp_path / "saved.scene") == ""
    found = irrsplat.load(tmp_path / "saved.scene")
    assert found.lights == room.lights and found.cameras == room.cameras and found.sky == room.sky
    for mesh, before in zip(found.meshes, room.meshes, strict=True):
        corners, expected = mesh.positions[mesh.faces], before.positions[before.faces]
        assert np.array_equal(corners, expected) and mesh.material == before.material
        assert mesh.normals[mesh.faces] == pytest.approx(before.normals[before.faces], abs=1e-6)
        assert (mesh.name, mesh.closed) == (before.name, before.closed)


def test_an_existing_scene_is_replaced_and_another_ending_is_refused(room: Scene, tmp_path: Path) -> None:
    path = tmp_path / "room.scene"
    with pytest.raises(InputError, match=r"ends in \.scene"):
        write_scene(room, tmp_path / "other.obj")
    assert not (tmp_path / "other.obj").exists() and not (tmp_path / "other-files").exists()
    assert irrsplat.load(path).lights != room.lights
    write_scene(room, path)
    assert irrsplat.load(path).lights == room.lights


def test_features_that_the_format_lacks_are_listed_in_one_line(room: Scene, tmp_path: Path) -> None:
    image = Texture(Image(np.full((2, 2, 4), 255, np.uint8)))
    worn = Material((0.5, 0.5, 0.5), albedo_texture=image, normal_texture=image, alpha_mode="mask")
    left = replace(room.meshes[1], material=Material(double_sided=False), colors=np.ones_like(room.meshes[1].positions))
    wide = replace(LIGHTS[2], spot_cutoff=90.0, spot_inner=10.0)
    other = replace(room.cameras[0], fov=20.0, name="tele")
    rich = replace(
        room,
        meshes=(replace(room.meshes[0], material=worn), left, room.meshes[2]),
        lights=(wide,),
        cameras=(*room.cameras, other),
        sky_gradient=(0.1, 0.1, 0.1),
    )
    message = write_scene(rich, tmp_path / "rich.scene")
    assert message.startswith("rich.scene: a .scene does not hold ") and "\n" not in message
    for what in (
        "textures (1)", "normal maps (1)", "opacity (1)", "colours at vertices (1)", "surfaces without a back (1)",
        "cones of 90 degrees or more (1)", "a field of view for each camera", "a sky that is brighter above",
    ):  # fmt: skip
        assert what in message
    irrsplat.load(tmp_path / "rich.scene")


def test_invalid_names_are_replaced(room: Scene, tmp_path: Path) -> None:
    """Objects and lights have unique file names, cameras have unique words, and hidden objects are omitted."""
    first = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov=50.0)
    cameras = (first, replace(first, name="at the # door"), replace(first, name="7"), replace(first, name=""))
    meshes = tuple(replace(mesh, name=name) for mesh, name in zip(room.meshes, ("a/b", "A b", ""), strict=True))
    gone = hidden(replace(room.meshes[0], name="gone"), np.zeros(3))
    lights = tuple(replace(light, name="../bulb") for light in LIGHTS)
    write_scene(replace(room, cameras=cameras, meshes=(*meshes, gone), lights=lights), tmp_path / "odd.scene")
    found = irrsplat.load(tmp_path / "odd.scene")
    assert [c.name for c in found.cameras] == ["", "at_the_door", "7_2", "camera_2"] and found.cameras[0] == first
    assert [m.name for m in found.meshes] == ["a_b", "A_b-2", "mesh"]
    assert [light.position for light in found.lights] == [light.position for light in LIGHTS]
    assert {path.parent for path in map(Path, found.files[1:])} == {tmp_path / "odd-files"}
    write_scene(replace(room, lights=()), tmp_path / "dark.scene")
    dark = irrsplat.load(tmp_path / "dark.scene")
    assert dark.sky == (0.0, 0.0, 0.0) and not dark.notices, "a scene without lights gets no default light"
