"""What stands in where a file has no light, no camera, or does not say what is up."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.scene.io.defaults import finish
from irrsplat.scene.model import Camera, Image, Light, Material, Mesh, Scene, Texture
from irrsplat.scene.stand_ins.surroundings import surface_points, surroundings
from irrsplat.scene.stand_ins.up_axis import axes, up_vector
from irrsplat.sky.sky_text import Sky
from tests.support.worlds import box, floor, lamp, material, quad, sphere

UPS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
ROOM = box((-2, 0, -3), (2, 2.5, 3), outward=False)
TABLE = box((0.5, 0, 0.5), (1.3, 0.8, 1.5))


def finished(*meshes: Mesh, lights: tuple[Light, ...] = (), cameras: tuple[Camera, ...] = (), up: str = "y") -> Scene:
    return finish(Path("a.glb"), meshes, lights, cameras, None, {}, up=UPS[up])


def turned(mesh: Mesh, up: str) -> Mesh:
    """A mesh that stands upright with y up, standing upright with another axis up."""
    matrix = axes(UPS[up])  # rows right, up and front: where x, y and z go
    return replace(mesh, positions=(mesh.positions @ matrix).astype("f4"), normals=(mesh.normals @ matrix).astype("f4"))


def inside(scene: Scene, points: np.ndarray) -> np.ndarray:
    """(N,) whether the default camera's square picture shows the points (N, 3)."""
    camera = scene.camera()
    x, y, z = camera.axes @ (points - np.asarray(camera.eye)).T
    shown: np.ndarray = np.maximum(np.abs(x), np.abs(y)) <= -z * math.tan(math.radians(camera.fov / 2.0)) + 1e-9
    return shown


# ---- what is up --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text", "up"),
    [
        ("a.obj", "v 0 0 0\n", "y"),
        ("a.obj", "# Blender 4.1\nv 0 0 0\n", "y"),
        ("a.obj", "# 3ds Max Wavefront OBJ Exporter\nv 0 0 0\n", "y"),
        ("a.obj", "  # Written by FreeCAD 0.21\nv 0 0 0\n", "z"),
        ("a.obj", "#\n# AutoCAD\n", "z"),
        ("a.obj", "o FreeCAD\nv 0 0 0\n", "y"),  # a name is no comment
        ("a.stl", "solid a\n", "z"),
        ("a.ply", "ply\n", "y"),
        ("a.gltf", "{}", "y"),
    ],
)
def test_up_is_as_the_format_has_it_or_the_exporter(tmp_path: Path, name: str, text: str, up: str) -> None:
    (tmp_path / name).write_text(text)
    assert up_vector(tmp_path / name) == UPS[up]
    for wanted in ("x", "y", "z"):
        assert up_vector(tmp_path / name, wanted) == UPS[wanted]


@pytest.mark.parametrize("up", UPS)
def test_the_axes_of_a_thing_are_right_handed(up: str) -> None:
    found = axes(UPS[up])
    assert np.allclose(found @ found.T, np.eye(3)) and np.linalg.det(found) == pytest.approx(1.0)
    assert tuple(found[1]) == UPS[up]


def test_load_takes_the_up_axis(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    assert irrsplat.load(tmp_path / "a.obj").up == UPS["y"]
    for up in ("x", "y", "z"):
        scene = irrsplat.load(tmp_path / "a.obj", up_axis=up)
        assert scene.up == UPS[up] and scene.camera().up == UPS[up]
        assert np.array_equal(scene.bounds, [[0, 0, 0], [1, 1, 1]]), "geometry stays as it is"


# ---- where to stand ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("up", UPS)
@pytest.mark.parametrize("thing", [sphere((1, 2, 3), 0.5), box((0, 0, 0), (1, 5, 0.2)), floor(3.0)])
def test_a_thing_is_seen_whole_from_the_front_and_above(thing: Mesh, up: str) -> None:
    scene = finished(turned(thing, up), up=up)
    camera, world = scene.camera(), axes(UPS[up])
    right, above, front = world @ np.subtract(camera.eye, camera.target)
    assert front > right > 0.0 and above > 0.0
    points = scene.meshes[0].positions
    assert inside(scene, points).all()
    x, y, z = camera.axes @ (points - np.asarray(camera.eye)).T
    assert (np.maximum(np.abs(x), np.abs(y)) / -z).max() > 0.85 * math.tan(math.radians(camera.fov / 2.0)), "it fills the picture"


@pytest.mark.parametrize("up", UPS)
@pytest.mark.parametrize("at", [(0.4, 0.5), (-1.7, -2.6)])
def test_in_a_closed_room_one_stands_at_eye_height_and_looks_at_what_is_in_it(up: str, at: tuple[float, float]) -> None:
    table = box((at[0], 0, at[1]), (at[0] + 1.0, 0.8, at[1] + 1.2))
    scene = finished(turned(ROOM, up), turned(table, up), up=up)
    camera, world = scene.camera(), axes(UPS[up])
    right, above, front = world @ np.asarray(camera.eye)
    assert abs(right) < 2.0 and above == pytest.approx(1.6, abs=0.1) and abs(front) < 3.0
    ahead = world @ np.subtract(camera.target, camera.eye)
    assert ahead[1] == pytest.approx(0.0, abs=1e-6) and np.linalg.norm(ahead) > 3.0
    assert inside(scene, turned(table, up).positions).all()


def test_a_room_in_other_units_has_its_eyes_below_the_middle() -> None:
    meshes = [replace(m, positions=m.positions * np.float32(100.0)) for m in (ROOM, TABLE)]
    assert finished(*meshes).camera().eye[1] == pytest.approx(0.45 * 250.0, rel=0.1)


def test_a_room_that_lacks_a_wall_is_seen_from_there() -> None:
    """Its side at greater x is open; the camera stands outside of it, and looks in."""
    walls = [quad((-1, 0, -1), (0, 0, 2), (2, 0, 0)), quad((-1, 2, -1), (2, 0, 0), (0, 0, 2))]
    walls += [
        quad((-1, 0, -1), (0, 2, 0), (0, 0, 2)),
        quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)),
        quad((-1, 0, 1), (0, 2, 0), (2, 0, 0)),
    ]
    scene = finished(*walls)
    camera = scene.camera()
    assert camera.eye[0] > 2.0 and abs(camera.eye[2]) < 0.3 and inside(scene, np.concatenate([w.positions for w in walls])).all()


@pytest.mark.parametrize("thing", [box((0, 0, 0), (1, 1, 1)), sphere((0, 0, 0), 1.0)])
def test_nobody_stands_in_a_solid_thing(thing: Mesh) -> None:
    scene = finished(thing)
    eye = np.asarray(scene.camera().eye)
    assert ((eye < scene.bounds[0]) | (eye > scene.bounds[1])).any()


def test_what_surrounds_a_point_in_a_room_is_about_known() -> None:
    """A cell of the sphere has the least distance in it, so that the volume comes out a little too small."""
    points = surface_points(Scene((ROOM,), (), ()))
    around = surroundings(points, np.array([0.5, 1.0, -1.0]), np.eye(3))
    assert around.closed == 1.0 and around.fronts == 1.0
    assert 0.7 < around.volume / (4 * 2.5 * 6) < 1.0
    assert surroundings(points, np.array([0.0, 1.0, 30.0]), np.eye(3)).closed < 0.1


def test_near_surfaces_are_closed_between_their_points() -> None:
    """Where 20 000 points are 7 cm apart, a wall at 15 cm has none in many directions."""
    around = surroundings(surface_points(Scene((ROOM,), (), ())), np.array([-1.85, 1.2, 0.0]), np.eye(3))
    assert around.closed == 1.0 and around.fronts > 0.99


def test_what_stands_on_a_vast_ground_fills_the_picture() -> None:
    """The camera is about as near as without the ground, and looks at the same."""
    ground, thing = floor(80.0), sphere((3, 1, -2), 1.0)
    alone, camera = finished(thing).camera(), finished(ground, thing).camera()
    far, farther = (np.linalg.norm(np.subtract(one.eye, one.target)) for one in (alone, camera))
    assert far < farther < 2.0 * far and np.allclose(camera.target, alone.target, atol=0.1)
    assert finished(ground, ROOM).camera().eye[1] > 5.0, "where the ground has as many vertices, it is a part of the whole"


def test_a_million_triangles_are_looked_at_in_a_second() -> None:
    side = 710
    x, z = (g.ravel() for g in np.meshgrid(np.arange(side), np.arange(side)))
    positions = np.stack([x, np.sin(0.1 * x) * np.cos(0.1 * z), z], 1).astype("f4")
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + side, a + 1], 1), np.stack([a + 1, a + side, a + side + 1], 1)]).astype("i4")
    mesh = Mesh(positions, np.tile(np.array([0, 1, 0], "f4"), (len(positions), 1)), faces)
    assert len(faces) > 1_000_000
    start = time.process_time()
    finished(mesh)
    assert time.process_time() - start < 2.0  # 0.5 s where nothing else runs


# ---- light -------------------------------------------------------------------------------------------------------------


def lit_by_itself(scene: Scene) -> bool:
    """Whether nothing stands in for light."""
    own = not any(light.name == "key" for light in scene.lights)
    assert own == (not any(scene.sky)) == (not any("stand in" in notice for notice in scene.notices))
    assert not scene.own_sky
    return own


def glowing(radiance: float, share: float) -> list[Mesh]:
    """A ball of radius 1, and on it a patch of this share of 4π m² that glows."""
    side = math.sqrt(share * 4.0 * math.pi)
    return [sphere((0, 0, 0), 1.0), quad((0, 1.001, 0), (0, 0, side), (side, 0, 0), material(0.5, radiance))]


@pytest.mark.parametrize(
    ("meshes", "own"),
    [
        ([sphere((0, 0, 0), 1.0)], False),
        (glowing(1.0, 0.01), False),  # a small display
        (glowing(1000.0, 0.01), True),
        ([sphere((0, 0, 0), 1.0, material(0.0, 1.0))], True),  # a lamp, and nothing else
        ([ROOM], False),
        ([ROOM, quad((-0.5, 2.4, -0.5), (1, 0, 0), (0, 0, 1), material(0.5, 1.0))], True),  # lit by a panel
        ([ROOM, quad((0, 1.4, -2.99), (0.02, 0, 0), (0, 0.02, 0), material(0.5, 1.0))], False),  # a switch that glows
    ],
)
def test_emission_that_is_minor_lights_nothing(meshes: list[Mesh], own: bool) -> None:
    assert lit_by_itself(finished(*meshes)) == own


def test_emission_counts_by_the_mean_of_its_texture() -> None:
    """The same ball, whose map is black but for a few texels, or white."""
    pixels = np.zeros((64, 64, 4), np.uint8)
    few, white = pixels.copy(), pixels + np.uint8(255)
    few[:4, :4] = 255
    for image, own in ((few, False), (white, True)):
        paint = Material(emission=(1.0, 1.0, 1.0), emission_texture=Texture(Image(image)))
        assert lit_by_itself(finished(sphere((0, 0, 0), 1.0, paint))) == own


@pytest.mark.parametrize("power", [0.0, 1e-9, 1.0, 1e5])
def test_lamps_that_are_off_light_nothing(power: float) -> None:
    light = Light((0.0, 2.0, 0.0), (power,) * 3, physical=True)
    assert lit_by_itself(finished(sphere((0, 0, 0), 1.0), lights=(light,))) == (power >= 1.0)
    assert not lit_by_itself(finished(sphere((0, 0, 0), 1.0), lights=(replace(light, color=(1e-9,) * 3, directional=True),)))


def test_a_lone_sun_has_a_sky_of_its_strength_and_no_key() -> None:
    """What falls on the side away is 0.3 of what falls on the other, however strong it is; with a lamp none stands in."""
    suns = Light((0.0, 2.0, 1.0), (1e5,) * 3, directional=True, name="key"), Light((1.0, 2.0, 0.0), (2e5,) * 3, directional=True)
    for lights, strength in (suns, 3e5), (suns[:1], 1e5):
        scene = finished(sphere((0, 0, 0), 1.0), lights=lights)
        assert scene.lights == lights and not scene.own_sky
        assert any("directional light alone" in notice for notice in scene.notices)
        assert scene.sky == pytest.approx((0.3 * strength,) * 3) and 0.0 < scene.sky_gradient[0] < scene.sky[0]
    assert lit_by_itself(finished(sphere((0, 0, 0), 1.0), lights=(suns[1], lamp((0, 3, 0), 1.0))))


def test_the_key_comes_from_the_upper_left_behind_the_camera() -> None:
    for up in ("y", "z"):
        scene = finished(turned(sphere((0, 1, 0), 1.0), up), up=up)
        key = scene.lights[-1]
        right, above, back = scene.camera().axes @ np.asarray(key.position)
        assert key.directional and right < 0.0 < above and back > 0.0
        assert np.dot(key.position, UPS[up]) > 0.5 * np.linalg.norm(key.position)
        assert scene.up == UPS[up] and min(scene.sky_gradient) > 0.0


def test_in_a_closed_room_the_key_is_a_lamp_in_it() -> None:
    for cameras in ((), (Camera((0.0, 1.0, 2.0), (0.0, 1.0, -1.0)),)):
        scene = finished(ROOM, TABLE, cameras=cameras)
        key = scene.lights[-1]
        assert not key.directional and key.position[1] < 2.4
        assert (np.asarray(key.position) > scene.bounds[0]).all() and (np.asarray(key.position) < scene.bounds[1]).all()
        assert key.position[1] > scene.camera().eye[1]


def test_a_file_of_filters_alone_says_so() -> None:
    glass = Material(transmission=1.0)
    for meshes, told in (([sphere((0, 0, 0), 1.0, glass)], True), ([sphere((0, 0, 0), 1.0, glass), floor(1.0)], False)):
        assert any("only their tints are shown" in notice for notice in finished(*meshes).notices) == told


def test_a_text_scene_keeps_its_promise() -> None:
    """A plain sky of 1 1 1, and that only where there is no light at all, however weak."""
    plain = finish(Path("a.scene"), [ROOM], (), (), None, {})
    assert plain.sky == (1.0, 1.0, 1.0) and plain.sky_gradient == (0.0, 0.0, 0.0) and not plain.own_sky and plain.lights == ()
    weak = finish(Path("a.scene"), [ROOM], (lamp((0, 1, 0), 1e-12),), (), None, {})
    assert weak.sky == (0.0, 0.0, 0.0) and weak.own_sky
    assert finish(Path("a.scene"), [ROOM], (), (), Sky(), {}).own_sky


def test_the_up_of_a_text_scene_is_its_camera_s() -> None:
    camera = Camera((5.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.1, 0.0, 1.0))
    assert finish(Path("a.scene"), [ROOM], (), (camera,), None, {}).up == UPS["z"]


def test_a_white_sphere_stands_out_and_has_a_shape(tmp_path: Path) -> None:
    """Loaded from a file, it is neither as bright as what is behind it nor the same all over."""
    ball = sphere((0, 0, 0), 1.0, rings=12, segments=24)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.positions.tolist()] + [f"vn {x} {y} {z}" for x, y, z in ball.normals.tolist()]
    lines += ["usemtl white", *(f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (ball.faces + 1).tolist())]
    (tmp_path / "m.mtl").write_text("newmtl white\nKd 1 1 1\n")
    (tmp_path / "ball.obj").write_text("mtllib m.mtl\n" + "\n".join(lines) + "\n")
    frame = irrsplat.render(irrsplat.load(tmp_path / "ball.obj"), (64, 64), bounces=1, gather_size=8, shadow_size=256)
    seen, picture = frame.alpha == 1.0, frame.picture.mean(-1)
    assert abs(picture[seen].mean() - picture[~seen].mean()) > 0.08
    assert np.percentile(picture[seen], 90) - np.percentile(picture[seen], 10) > 0.1
    left, right = picture[:, :32][seen[:, :32]].mean(), picture[:, 32:][seen[:, 32:]].mean()
    assert left > right, "the key is on the left"
