"""The bundled scenes: found by name, as their descriptions say, and equal to what their generator makes."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from trimesh.triangles import closest_point

from irrsplat.core import paths
from irrsplat.core.errors import InputError
from irrsplat.scene import Light, Scene, bundled, load
from irrsplat.scenes.generate import SCENES

GENERATED = ("atrium", "curved", "door")


def triangles(scene: Scene) -> np.ndarray:
    """(F, 3, 3) float64: the corners of all triangles."""
    return np.concatenate([mesh.positions[mesh.faces].astype(float) for mesh in scene.meshes])


def first_hits(scene: Scene, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N,) distances along unit rays (N, 3) from one point to the nearest triangle, or infinity (Möller & Trumbore 1997)."""
    corners = triangles(scene)
    a, e, f = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    s = origin - a
    q = np.cross(s, e)
    with np.errstate(all="ignore"):  # det = e·(d × f) = d·(f × e), and so on: products of all rays with all triangles at once
        inverse = 1.0 / (directions @ np.cross(f, e).T)
        u, v = directions @ np.cross(f, s).T * inverse, directions @ q.T * inverse
        t = (f * q).sum(1) * inverse
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
    return np.where(hit, t, np.inf).min(axis=1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_the_bundled_scenes_load_without_a_notice():
    assert set(bundled()) == {"atrium", "cornell", "cornell-paper", "curved", "door", "furnace"}
    for name in bundled():
        scene = load(name)
        assert scene.name == name and scene.notices == () and scene.triangles > 0
        for mesh in scene.meshes:
            np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
            assert 0.0 <= min(mesh.material.albedo) <= max(mesh.material.albedo) <= 1.0


def test_each_bundled_scene_says_where_its_numbers_come_from():
    for name in bundled():
        first = (paths.folder("scenes") / name / f"{name}.scene").read_text().splitlines()[0]
        assert first.startswith("# ") and len(first) > 40


def test_names_paths_and_what_is_neither(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="no file 'nope'; the bundled scenes are atrium, cornell"):
        load("nope")
    for odd in ("", "x" * 5000, "a\0b", "two\nlines", "../cornell", "cornell/"):
        with pytest.raises(InputError) as caught:
            load(odd)
        assert "\n" not in str(caught.value)
    (tmp_path / "thing.txt").write_text("hello")
    with pytest.raises(InputError, match=r"unknown ending '\.txt'; expected one of \.scene"):
        load("thing.txt")
    (tmp_path / "furnace").mkdir()
    assert load("furnace").path != "furnace"  # a folder of that name is no file: the bundled scene is meant
    with pytest.raises(InputError, match="directory"):
        load(tmp_path)
    (tmp_path / "UPPER.SCENE").write_text("sky 1 2 3\n")
    assert load("UPPER.SCENE").sky == (1, 2, 3)
    (tmp_path / "cornell").write_text("sky 1 2 3\n")
    with pytest.raises(InputError, match="unknown ending"):  # an existing file wins
        load("cornell")


def test_cornell_is_the_measured_box():
    # published: floor 552.8 wide in front, ceiling at 548.8, back wall at 559.2; the camera's film 0.025 behind 0.035
    scene = load("cornell")
    np.testing.assert_allclose(scene.bounds, np.array([[0, 0, 0], [5.56, 5.488, 5.592]]), atol=1e-6)
    camera = scene.camera()
    assert camera.eye == (2.78, 2.73, -8.0)
    assert camera.fov == pytest.approx(2 * math.degrees(math.atan(0.0125 / 0.035)), abs=1e-3)
    # red stands on the left of the picture: +x is left where one looks along +z with +y up
    red = next(mesh for mesh in scene.meshes if mesh.name == "red")
    view = camera.view_from_world[:3, :3] @ red.positions.mean(0) + camera.view_from_world[:3, 3]
    assert view[0] < 0 and red.material.albedo[0] > 5 * red.material.albedo[1]
    (lamp,) = scene.lights
    assert lamp.physical and lamp.position[1] == pytest.approx(5.488 - 0.1)


def test_cornell_faces_look_inward_and_blocks_outward():
    # a wall's normal points at the box's middle; a block's, away from its own
    scene = load("cornell")
    middle = scene.bounds.mean(0)
    for mesh in scene.meshes:
        inside = mesh.positions.mean(0) * [1, 0.8, 1] if mesh.name in ("short", "tall") else middle
        towards = ((inside - mesh.positions) * mesh.normals).sum(1)
        assert (towards < 0).all() if mesh.name in ("short", "tall") else (towards > 0).all()


def test_cornell_paper_is_the_papers_box():
    # in its own words: pure red and green walls, white rest, two boxes, three lights, one at the ceiling's centre, two outside
    scene = load("cornell-paper")
    albedos = [mesh.material.albedo for mesh in scene.meshes]
    assert albedos.count((1, 0, 0)) == albedos.count((0, 1, 0)) == 1 and set(albedos) == {(1, 0, 0), (0, 1, 0), (1, 1, 1)}
    assert sum(mesh.closed for mesh in scene.meshes) == 2
    low, high = scene.bounds
    ceiling, *outside = scene.lights
    assert ceiling.position == pytest.approx(((low[0] + high[0]) / 2, high[1], (low[2] + high[2]) / 2))
    assert len(outside) == 2 and all(light.position[2] > high[2] for light in outside)
    assert all(light.attenuation == (1, 0, 0) and not light.physical for light in scene.lights)
    assert sum(light.color[0] for light in scene.lights) <= 1.0  # no wall saturates, whatever its angle


def test_the_furnace_is_closed_and_uniform():
    # the argument of a furnace needs: one reflectance, one emission, no other light, and no way out
    scene = load("furnace")
    assert {mesh.material for mesh in scene.meshes} == {scene.meshes[0].material}
    assert scene.lights == () and scene.sky == (0, 0, 0)
    assert scene.meshes[0].material.albedo == (0.5,) * 3 and scene.meshes[0].material.emission == (1,) * 3
    directions = unit(np.random.default_rng(0).normal(size=(200, 3)))
    for camera in scene.cameras:
        assert first_hits(scene, np.array(camera.eye), directions).max() < 8.0


def test_sizes_are_as_bundled():
    triangles = {name: load(name).triangles for name in GENERATED}
    assert 4_000 <= triangles["door"] <= 6_000 and 4_000 <= triangles["curved"] <= 6_500
    assert 15_000 <= triangles["atrium"] <= 25_000
    for name in GENERATED:
        assert sum(file.stat().st_size for file in (paths.folder("scenes") / name).iterdir()) < 500_000


def test_shapes_that_should_be_closed_are():
    # front faces are culled from a shadow map only where a mesh is closed: lathes that end on the axis, balls, rings, cubes
    for name, open_ones in (
        ("curved", {"stage"}),
        ("door", {"spout", "handle"}),
        ("atrium", {"column", "arch_front", "arch_back", "arch_inside", "drape", "rod"}),
    ):
        for mesh in load(name).meshes:
            assert mesh.closed == (mesh.name not in open_ones), mesh.name


@pytest.mark.parametrize("name", ["curved", "door"])
def test_lamps_keep_their_distance(name):
    # a lamp near a surface makes a tiny spot that neither gather nor path tracer resolves
    corners = triangles(load(name))
    for lamp in load(name).lights:
        nearest = closest_point(corners, np.broadcast_to(lamp.position, (len(corners), 3)))
        assert np.linalg.norm(nearest - lamp.position, axis=1).min() > 0.3  # metres


def lights_up(scene: Scene, lamp: Light, points: np.ndarray) -> np.ndarray:
    """(N,) whether a spot lights points (N, 3): they lie in its cone, and nothing is between."""
    towards = points - np.array(lamp.position)
    far = np.linalg.norm(towards, axis=1)
    assert lamp.spot_target is not None
    axis = unit(np.subtract(lamp.spot_target, lamp.position))
    in_cone = unit(towards) @ axis > math.cos(math.radians(lamp.spot_cutoff))
    return in_cone & (first_hits(scene, np.array(lamp.position), unit(towards)) > 0.999 * far)


def test_most_of_what_door_shows_is_lit_indirectly():
    # rays through a 24 x 24 picture; from the lamps, rays to what they hit: some pixels see a lamp (the doorway), most don't
    scene = load("door")
    camera = scene.camera()
    half = math.tan(math.radians(camera.fov / 2))
    steps = half * ((np.arange(24) + 0.5) / 12 - 1)
    directions = unit(np.stack([*np.meshgrid(steps, steps), -np.ones((24, 24))], axis=-1).reshape(-1, 3)) @ camera.axes
    distance = first_hits(scene, np.array(camera.eye), directions)
    assert np.isfinite(distance).all()  # the room is closed
    points = np.array(camera.eye) + 0.999 * distance[:, None] * directions
    lit = np.any([lights_up(scene, lamp, points) for lamp in scene.lights], axis=0)
    assert 0.01 < lit.mean() < 0.2


def test_door_has_no_lamp_in_the_room():
    # the room ends where the wall with the doorway begins, at z = -2.7
    assert all(lamp.position[2] < -2.7 for lamp in load("door").lights)


def numbers(path: Path) -> tuple[list[str], np.ndarray]:
    """The words of a file that are no numbers, and those that are."""
    words, values = [], []
    for word in path.read_text().replace("//", " ").split():
        try:
            values.append(float(word))
        except ValueError:
            words.append(word)
    return words, np.array(values)


@pytest.mark.parametrize("name", GENERATED)
def test_the_generator_makes_what_is_committed(name, tmp_path):
    # to one unit of the last decimal that it writes: another machine's sine may round the other way
    SCENES[name](tmp_path, 1.0)
    committed = {file.name: file for file in (paths.folder("scenes") / name).iterdir()}
    assert set(committed) == {file.name for file in tmp_path.iterdir()}
    for file in tmp_path.iterdir():
        words, values = numbers(file)
        expected_words, expected = numbers(committed[file.name])
        assert words == expected_words
        np.testing.assert_allclose(values, expected, atol=1.01e-3 if file.suffix == ".obj" else 0)


@pytest.mark.parametrize("name", GENERATED)
def test_detail_scales_the_triangles(name, tmp_path):
    # ten times the detail makes about ten times the triangles of what is curved
    SCENES[name](tmp_path, 10.0)
    scene = load(tmp_path / f"{name}.scene")
    assert 7 < scene.triangles / load(name).triangles < 11 and scene.notices == ()


def test_the_generator_is_a_script(tmp_path):
    script = paths.folder("scenes") / "generate.py"
    subprocess.run([sys.executable, str(script), "curved", "--detail", "0.1", "-o", str(tmp_path)], check=True)
    assert load(tmp_path / "curved.scene").triangles > 0


def test_a_scene_is_told_in_a_line() -> None:
    """In a notebook a name alone shows it: without its arrays."""
    scene = load("cornell")
    assert repr(scene) == "<Scene 'cornell', meshes: 5, triangles: 30, lights: 1, cameras: 1>"
    assert repr(scene.meshes[1]) == f"<Mesh {scene.meshes[1].name!r}: {len(scene.meshes[1].positions)} vertices, 10 triangles>"
