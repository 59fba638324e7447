"""Invariance to a scene's position and size, except for its positions: distant scenes are drawn relative to an origin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.gpu.target import pixels
from irrsplat.image.frame import Frame
from irrsplat.scene.io.text.scene_writer import write_scene
from irrsplat.scene.model import Scene
from tests.renderer.test_renderer import FAST, FRONT, SIZE, rendered, room
from tests.support.gltf_files import GltfFile

# Multiples of a power of two greater than the room, so that relative coordinates are exactly equal
FAR = [(1e4, -1e4, 2e4), (-1e6, 1e6, 3e6)]
Place = tuple[float, float, float]


def same(far: Frame, near: Frame, place: Place) -> None:
    """Assert that two views are equal except for positions, which have float32 errors of about 1e-7 of their distance."""
    seen = np.isfinite(near.depth)
    assert seen.any() and np.array_equal(seen, np.isfinite(far.depth))
    slack = 1e-7 * np.abs(place).max()
    assert np.abs(far.position[seen].astype(float) - place - near.position[seen]).max() < slack
    assert far.records_position.shape == near.records_position.shape
    assert np.abs(far.records_position.astype(float) - place - near.records_position).max() < slack
    for name in ("irradiance", "direct", "image", "records_irradiance", "records_radius"):
        a, b = getattr(far, name), getattr(near, name)
        assert np.abs(a - b).max() <= 1e-4 * np.abs(b).max(), name
    assert near.irradiance.mean() > 0.0 and near.direct.max() > 0.0


# ---- files -----------------------------------------------------------------------------------------------------------------


def wavefront(folder: Path, place: Place) -> Path:
    """Write the room as one .obj with absolute coordinates; camera and light are stand-ins."""
    lines, first = [], 1
    for mesh in room().meshes:
        lines += ["v {:.9f} {:.9f} {:.9f}".format(*row) for row in mesh.positions + np.array(place)]
        lines += ["f {} {} {}".format(*face) for face in mesh.faces + first]
        first += len(mesh.positions)
    path = folder / "room.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def text(folder: Path, place: Place) -> Path:
    """Write this .obj in a .scene with a camera and a light."""
    wavefront(folder, place)
    x, y, z = np.add(room().lights[0].position, place)
    (folder / "lamp.light").write_text(f"position {x:.9f} {y:.9f} {z:.9f} 1\nintensity 5 4 3\n")
    places = " ".join(f"{v:.9f}" for v in (*np.add(FRONT.eye, place), *np.add(FRONT.target, place)))
    path = folder / "room.scene"
    path.write_text(f"cam {places} 0 1 0\nlight lamp.light\nobj room.obj\n")
    return path


def gltf(folder: Path, place: Place) -> Path:
    """Write the meshes under a node with a translation; camera and light are stand-ins."""
    file = GltfFile()
    meshes = [file.mesh(indices=m.faces.astype(np.uint32), POSITION=m.positions, NORMAL=m.normals) for m in room().meshes]
    children = [file.node(mesh=mesh) for mesh in meshes]
    top = file.node(children=children, translation=list(place))
    file.tree["scenes"], file.tree["scene"] = [{"nodes": [top]}], 0
    return file.glb(folder / "room.glb")


def saved(folder: Path, place: Place) -> Path:
    """Write a loaded scene again."""
    scene = irrsplat.load(text(folder, place))
    path = folder / "again.scene"
    assert write_scene(scene, path) == ""
    again = irrsplat.load(path)
    assert again.cameras[0].eye == scene.cameras[0].eye and again.lights[0].position == scene.lights[0].position
    return path


@pytest.mark.parametrize(("written", "place"), [(gltf, FAR[0]), (saved, FAR[1])])
def test_a_file_far_away_is_the_file_near_by(written: Callable[[Path, Place], Path], place: Place, tmp_path: Path) -> None:
    frames = []
    for name, there in (("near", (0.0, 0.0, 0.0)), ("far", place)):
        folder = tmp_path / name
        folder.mkdir()
        scene = irrsplat.load(written(folder, there))
        assert np.abs(scene.bounds - there - room().bounds).max() < 1e-6
        assert np.abs(np.subtract(scene.cameras[0].eye, there)).max() < 10.0 * room().diagonal, "in world space"
        frames.append(rendered(scene))
    same(frames[1], frames[0], place)


# ---- callers ---------------------------------------------------------------------------------------------------------------


def test_what_callers_give_and_get_is_in_world_space() -> None:
    """Cameras, lights, moves about a point, poses, and the returned scene use world space."""
    place = FAR[1]
    about = np.array([0.3, 0.2, -0.1])
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    frames, meshes, depths = [], [], []
    for there in ((0.0, 0.0, 0.0), place):
        scene = room().placed(there)
        with Renderer(scene, SIZE, **FAST) as renderer:
            assert renderer.scene.lights == scene.lights and renderer.scene.cameras == scene.cameras
            point_light = renderer.scene.lights[0]
            renderer.relight([replace(point_light, position=tuple(np.add(point_light.position, (0.2, -0.1, 0.1))))])
            centre = about + there
            renderer.move(1, np.column_stack([turn, centre - turn @ centre + (0.1, 0.0, 0.0)]))
            frames.append(renderer.render(FRONT.shifted(there)))
            meshes.append(renderer.scene.meshes[1].positions.astype(float) + renderer.scene.origin)
            renderer.pose(scene)
            renderer.render(FRONT.shifted(there))
            frames.append(renderer.frame(FRONT.shifted(there))[0].read())
            depths.append(pixels(renderer.draw_gbuffer(FRONT.shifted(there)).position)[..., 3].copy())
    same(frames[2], frames[0], place)
    same(frames[3], frames[1], place)
    assert np.array_equal(depths[0], depths[1]) and depths[0].any()
    assert np.abs(meshes[1] - place - meshes[0]).max() < 1e-6
    assert np.abs(frames[0].direct - frames[1].direct).max() > 0.1 * frames[0].direct.max(), "the changes are seen"


# ---- size ------------------------------------------------------------------------------------------------------------------


def times(factor: float, place: Place) -> Place:
    """Return a scaled vector."""
    x, y, z = (factor * v for v in place)
    return x, y, z


def scaled(scene: Scene, factor: float) -> Scene:
    """Return the scene scaled by `factor`, with light powers scaled by its square, so that irradiance is equal."""
    point_lights = (
        replace(point_light, position=times(factor, point_light.position), color=times(factor**2, point_light.color))  # W/sr
        for point_light in scene.lights
    )
    meshes = (replace(mesh, positions=mesh.positions * np.float32(factor)) for mesh in scene.meshes)
    return replace(scene, meshes=tuple(meshes), lights=tuple(point_lights))


@pytest.mark.few_sites
@pytest.mark.parametrize("factor", [2.0**-20])  # above 25 m, a record's ray offset is limited to 2.5 mm
def test_no_threshold_is_absolute(factor: float) -> None:
    """A power of two causes no rounding: all bits of light are equal, also with all bounces."""
    frames = []
    for by in (1.0, factor):
        camera = replace(FRONT, eye=times(by, FRONT.eye), target=times(by, FRONT.target))
        settings = {**FAST, "bounces": "all", "gather": "trace"}
        with Renderer(scaled(room(), by), SIZE, **settings) as renderer:
            frames.append(renderer.render(camera))
    for name in ("image", "irradiance", "weight", "records_irradiance"):
        assert np.array_equal(*(getattr(frame, name) for frame in frames)), name
    assert np.array_equal(frames[1].records_radius, frames[0].records_radius * np.float32(factor))
