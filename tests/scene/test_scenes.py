"""The bundled scenes: found by name, consistent with their descriptions, and equal to their generator's output."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from irrsplat.core import paths
from irrsplat.core.errors import InputError
from irrsplat.scene import bundled, load
from irrsplat.scene.io.mesh_builder import is_closed
from irrsplat.scenes import generate

GENERATED = ("atrium", "curved", "door")


def test_the_bundled_scenes_load_without_a_notice():
    assert set(bundled()) == {"atrium", "cornell", "cornell-paper", "curved", "door", "furnace"}
    for name in bundled():
        scene = load(name)
        assert scene.name == name and scene.notices == () and scene.triangles > 0
        for mesh in scene.meshes:
            np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
            assert 0.0 <= min(mesh.material.albedo) <= max(mesh.material.albedo) <= 1.0


def test_names_paths_and_invalid_sources(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "thing.txt").write_text("hello")
    for odd_primitive, message in (
        ("nope", "no file 'nope'; the bundled scenes are atrium, cornell"),
        ("thing.txt", r"unknown ending '\.txt'; expected one of \.scene"),
        (tmp_path, "directory"),
        *((odd_primitive, "") for odd_primitive in ("", "x" * 5000, "a\0b", "two\nlines", "../cornell", "cornell/")),
    ):
        with pytest.raises(InputError, match=message or None) as caught:
            load(odd_primitive)
        assert "\n" not in str(caught.value)
    (tmp_path / "furnace").mkdir()
    assert load("furnace").path != "furnace"  # a folder of that name is no file: the bundled scene is meant
    assert load("cornell.scene").path == load("cornell").path
    (tmp_path / "UPPER.SCENE").write_text("sky 1 2 3\n")
    assert load("UPPER.SCENE").sky == (1, 2, 3)
    (tmp_path / "cornell").write_text("sky 1 2 3\n")
    with pytest.raises(InputError, match="unknown ending"):  # an existing file has precedence
        load("cornell")


def test_cornell_is_the_measured_box():
    # published: floor 552.8 wide in front, ceiling at 548.8, back wall at 559.2; the camera's film 0.025 behind 0.035
    scene = load("cornell")
    np.testing.assert_allclose(scene.bounds, np.array([[0, 0, 0], [5.56, 5.488, 5.592]]), atol=1e-6)
    camera = scene.camera()
    assert camera.eye == (2.78, 2.73, -8.0)
    assert camera.fov == pytest.approx(2 * math.degrees(math.atan(0.0125 / 0.035)), abs=1e-3)
    # red is on the left of the picture: +x is left for a view along +z with +y up
    red = next(mesh for mesh in scene.meshes if mesh.name == "red")
    view = camera.view_from_world[:3, :3] @ red.positions.mean(0) + camera.view_from_world[:3, 3]
    assert view[0] < 0 and red.material.albedo[0] > 5 * red.material.albedo[1]
    (point_light,) = scene.lights
    assert point_light.physical and point_light.position[1] == pytest.approx(5.488 - 0.1)


def test_the_furnace_is_closed_and_uniform():
    """A furnace needs one reflectance, one emission, no other light, and no opening."""
    scene = load("furnace")
    assert {mesh.material for mesh in scene.meshes} == {scene.meshes[0].material}
    assert scene.lights == () and scene.sky == (0, 0, 0)
    assert scene.meshes[0].material.albedo == (0.5,) * 3 and scene.meshes[0].material.emission == (1,) * 3
    inward = [is_closed(mesh.positions, mesh.faces[:, ::-1]) for mesh in scene.meshes]
    assert inward.count(True) == 1 and all(a or mesh.closed for a, mesh in zip(inward, scene.meshes, strict=True))


def numbers(path: Path) -> tuple[list[str], np.ndarray]:
    """Return the words of a file that are no numbers, and the numbers."""
    words, values = [], []
    for word in path.read_text().replace("//", " ").split():
        try:
            values.append(float(word))
        except ValueError:
            words.append(word)
    return words, np.array(values)


@pytest.mark.parametrize("name", GENERATED)
def test_the_generator_makes_what_is_committed(name, tmp_path):
    # to one unit of the last written decimal: another machine's sine may round the other way
    generate.SCENES[name](tmp_path, 1.0)
    committed = {file.name: file for file in (paths.folder("scenes") / name).iterdir()}
    assert set(committed) == {file.name for file in tmp_path.iterdir()}
    for file in tmp_path.iterdir():
        words, values = numbers(file)
        expected_words, expected = numbers(committed[file.name])
        assert words == expected_words
        np.testing.assert_allclose(values, expected, atol=1.01e-3 if file.suffix == ".obj" else 0)


def test_detail_scales_the_triangles(tmp_path, monkeypatch):
    """A quarter of the detail gives about a quarter of the triangles of curved objects."""
    monkeypatch.setattr("sys.argv", ["generate.py", "curved", "--detail", "0.25", "-o", str(tmp_path)])
    generate.main()
    assert 0.2 < load(tmp_path / "curved.scene").triangles / load("curved").triangles < 0.35
