"""Stand-ins for a missing light, camera or up axis of a file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.scene.io.defaults import finish
from irrsplat.scene.model import Camera, Light, Mesh, Scene
from irrsplat.scene.stand_ins.up_axis import axes, up_vector
from tests.support.worlds import box, floor, material, point_light, quad, sphere

UPS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
ROOM = box((-2, 0, -3), (2, 2.5, 3), outward=False)
TABLE = box((0.5, 0, 0.5), (1.3, 0.8, 1.5))


def finished(*meshes: Mesh, lights: tuple[Light, ...] = (), cameras: tuple[Camera, ...] = (), up: str = "y") -> Scene:
    return finish(Path("a.glb"), meshes, lights, cameras, None, {}, up=UPS[up])


def turned(mesh: Mesh, up: str) -> Mesh:
    """Return an upright mesh for y up, upright with another axis up."""
    matrix = axes(UPS[up])  # rows right, up and front: the images of x, y and z
    return replace(mesh, positions=(mesh.positions @ matrix).astype("f4"), normals=(mesh.normals @ matrix).astype("f4"))


def inside(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Return (N,) bool: True for points (N, 3) in the default camera's square picture."""
    camera = scene.camera()
    x, y, z = camera.axes @ (points - np.asarray(camera.eye)).T
    shown: np.ndarray = np.maximum(np.abs(x), np.abs(y)) <= -z * math.tan(math.radians(camera.fov / 2.0)) + 1e-9
    return shown


@pytest.mark.parametrize(
    ("name", "text", "up"),
    [
        ("a.obj", "# 3ds Max Wavefront OBJ Exporter\nv 0 0 0\n", "y"),
        ("a.obj", "#\n# AutoCAD\n", "z"),
        ("a.obj", "o FreeCAD\nv 0 0 0\n", "y"),  # a name is no comment
        ("a.stl", "solid a\n", "z"),
        ("a.gltf", "{}", "y"),
    ],
)
def test_up_is_as_the_format_has_it_or_the_exporter(tmp_path: Path, name: str, text: str, up: str) -> None:
    (tmp_path / name).write_text(text)
    assert up_vector(tmp_path / name) == UPS[up] and up_vector(tmp_path / name, "x") == UPS["x"]


def test_load_takes_the_up_axis(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    assert irrsplat.load(tmp_path / "a.obj").up == UPS["y"]
    scene = irrsplat.load(tmp_path / "a.obj", up_axis="z")
    assert scene.up == UPS["z"] and scene.camera().up == UPS["z"]
    assert np.array_equal(scene.bounds, [[0, 0, 0], [1, 1, 1]]), "geometry stays as it is"


@pytest.mark.parametrize(("thing", "up"), [(sphere((1, 2, 3), 0.5), "x"), (box((0, 0, 0), (1, 5, 0.2)), "z"), (floor(3.0), "y")])
def test_an_object_is_wholly_in_view_from_the_front_and_above(thing: Mesh, up: str) -> None:
    scene = finished(turned(thing, up), up=up)
    camera, world = scene.camera(), axes(UPS[up])
    right, above, front = world @ np.subtract(camera.eye, camera.target)
    assert front > right > 0.0 and above > 0.0
    points = scene.meshes[0].positions
    assert inside(scene, points).all()
    x, y, z = camera.axes @ (points - np.asarray(camera.eye)).T
    slope = math.tan(math.radians(camera.fov / 2.0))
    assert (np.maximum(np.abs(x), np.abs(y)) / -z).max() > 0.85 * slope, "it fills the picture"
    margins = [[(slope / 1.08 * z + side).max(), (slope / 1.08 * z - side).max()] for side in (x, y)]
    assert np.ptp(margins, axis=1) == pytest.approx(0.0, abs=1e-5 * scene.diagonal), "it is in the middle of the picture"
    assert np.max(margins) == pytest.approx(0.0, abs=1e-5 * scene.diagonal), "no camera in this direction is nearer"


@pytest.mark.parametrize(("up", "at"), [("y", (0.4, 0.5)), ("z", (-1.7, -2.6))])
def test_the_camera_of_a_closed_room_is_at_eye_height_and_shows_its_contents(up: str, at: tuple[float, float]) -> None:
    table = box((at[0], 0, at[1]), (at[0] + 1.0, 0.8, at[1] + 1.2))
    scene = finished(turned(ROOM, up), turned(table, up), up=up)
    camera, world = scene.camera(), axes(UPS[up])
    right, above, front = world @ np.asarray(camera.eye)
    assert abs(right) < 2.0 and above == pytest.approx(1.6, abs=0.1) and abs(front) < 3.0
    ahead = world @ np.subtract(camera.target, camera.eye)
    assert ahead[1] == pytest.approx(0.0, abs=1e-6) and np.linalg.norm(ahead) > 3.0
    assert inside(scene, turned(table, up).positions).mean() >= 0.5, "most of the table is in the picture"


def test_a_room_that_lacks_a_wall_is_seen_from_there() -> None:
    """Its side at greater x is open; the camera is outside, in front of it."""
    x, y, z, low = (2, 0, 0), (0, 2, 0), (0, 0, 2), (-1, 0, -1)
    walls = [quad(low, z, x), quad((-1, 2, -1), x, z), quad(low, y, z), quad(low, x, y), quad((-1, 0, 1), y, x)]
    scene = finished(*walls)
    camera = scene.camera()
    assert camera.eye[0] > 2.0 and abs(camera.eye[2]) < 0.3 and inside(scene, np.concatenate([w.positions for w in walls])).all()


def test_many_rooms_without_a_ceiling_are_seen_from_above() -> None:
    """The view is steeper than the line from a wall's top to the far edge of its floor."""
    room = replace(ROOM, faces=ROOM.faces[(ROOM.positions[ROOM.faces][..., 1] < 2.5).any(1)])
    rooms = [replace(room, positions=room.positions + np.array((4 * i, 0, 6 * k), "f4")) for i in range(3) for k in range(2)]
    camera = finished(*rooms).camera()
    right, above, front = np.subtract(camera.eye, camera.target)
    assert above / np.hypot(right, front) > 2.5 / 4.0


def test_an_object_on_a_vast_ground_fills_the_picture() -> None:
    """The camera is about as near as without the ground, and the object is near the middle."""
    ground, thing = floor(80.0), sphere((3, 1, -2), 1.0)
    alone, camera = finished(thing).camera(), finished(ground, thing).camera()
    far, farther = (np.linalg.norm(np.subtract(one.eye, one.target)) for one in (alone, camera))
    x, y, z = camera.axes @ ((3, 1, -2) - np.asarray(camera.eye))
    assert far < farther < 2.0 * far and inside(finished(ground, thing), thing.positions).all()
    assert np.hypot(x, y) < -z * math.tan(math.radians(camera.fov / 2.0)) / 3.0


def has_own_light(scene: Scene) -> bool:
    """True if the scene gets no default light."""
    own = not any(light.name == "key" for light in scene.lights)
    assert own == (not any(scene.sky)) == (not any("added a sky" in notice for notice in scene.notices))
    assert not scene.own_sky
    return own


def glowing(radiance: float, share: float) -> list[Mesh]:
    """Return a ball of radius 1, and on it a glowing patch of this share of 4π m²."""
    side = math.sqrt(share * 4.0 * math.pi)
    return [sphere((0, 0, 0), 1.0), quad((0, 1.001, 0), (0, 0, side), (side, 0, 0), material(0.5, radiance))]


@pytest.mark.parametrize(
    ("meshes", "own"),
    [
        (glowing(1.0, 0.01), False),  # a small display
        (glowing(1000.0, 0.01), True),
        ([sphere((0, 0, 0), 1.0, material(0.0, 1.0))], True),  # a luminous ball only
        ([ROOM, quad((-0.5, 2.4, -0.5), (1, 0, 0), (0, 0, 1), material(0.5, 1.0))], True),  # lit by a panel
        ([ROOM, quad((0, 1.4, -2.99), (0.02, 0, 0), (0, 0.02, 0), material(0.5, 1.0))], False),  # a glowing switch
    ],
)
def test_minor_emission_does_not_count(meshes: list[Mesh], own: bool) -> None:
    assert has_own_light(finished(*meshes)) == own


def test_lights_that_are_off_do_not_count() -> None:
    for light, own in ((point_light((0, 2, 0), 1e-9), False), (point_light((0, 2, 0), 1.0), True)):
        assert has_own_light(finished(sphere((0, 0, 0), 1.0), lights=(light,))) == own


def test_a_lone_sun_has_a_sky_of_its_strength_and_no_key() -> None:
    """Irradiance on the far side is 0.3 of that on the near side, at any strength; with a point light no sky is added."""
    suns = Light((0.0, 2.0, 1.0), (1e5,) * 3, directional=True, name="key"), Light((1.0, 2.0, 0.0), (2e5,) * 3, directional=True)
    for lights, strength in (suns, 3e5), (suns[:1], 1e5):
        scene = finished(sphere((0, 0, 0), 1.0), lights=lights)
        assert scene.lights == lights and not scene.own_sky
        assert any("only directional light" in notice for notice in scene.notices)
        assert scene.sky == pytest.approx((0.3 * strength,) * 3) and 0.0 < scene.sky_gradient[0] < scene.sky[0]
    assert has_own_light(finished(sphere((0, 0, 0), 1.0), lights=(suns[1], point_light((0, 3, 0), 1.0))))


def test_the_key_comes_from_the_upper_left_behind_the_camera() -> None:
    for up in ("y", "z"):
        scene = finished(turned(sphere((0, 1, 0), 1.0), up), up=up)
        key = scene.lights[-1]
        right, above, back = scene.camera().axes @ np.asarray(key.position)
        assert key.directional and right < 0.0 < above and back > 0.0
        assert np.dot(key.position, UPS[up]) > 0.5 * np.linalg.norm(key.position)
        assert scene.up == UPS[up] and min(scene.sky_gradient) > 0.0


def test_a_white_sphere_stands_out_and_has_a_shape() -> None:
    """It differs from its background, and its brightness varies."""
    model = finished(sphere((0, 0, 0), 1.0, material(1.0), rings=12, segments=24))
    frame = irrsplat.render(model, (64, 64), bounces=1, gather_size=8, shadow_size=256)
    seen, picture = frame.alpha == 1.0, frame.picture.mean(-1)
    assert abs(picture[seen].mean() - picture[~seen].mean()) > 0.08
    assert np.percentile(picture[seen], 90) - np.percentile(picture[seen], 10) > 0.1
    left, right = picture[:, :32][seen[:, :32]].mean(), picture[:, 32:][seen[:, 32:]].mean()
    assert left > right, "the key is on the left"
