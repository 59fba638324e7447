"""The .scene, .light and .obj grammar: what each line means."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import load
from irrsplat.scene.io.mesh_builder import build_mesh, is_closed
from irrsplat.scene.io.obj.reader import load_obj
from irrsplat.scene.model import Material, Scene

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
CUBE = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 5 8 4\nf 2 3 7 6\nf 1 2 6 5\nf 4 8 7 3\nf 1 4 3 2\nf 5 6 7 8\n"""
CAM = "cam 0 0 5  0 0 0  0 1 0\n"


def light(write, text: str):
    return write("light a.light\n", a_light=text).lights[0]


def test_matrices_multiply_on_the_right_as_opengl_does(write):
    # p' = T·R·S·U·p: (1 0 0) is moved to (1 0 1), scaled to (2 0 4), turned by 90° about z to (0 2 4), moved to (10 2 4); the
    # axis need not be unit, and U comes last, so that no command has only the unit matrix to multiply
    scene = write("trans 10 0 0\nrotate 90 0 0 7\nscale 2 3 4\ntrans 0 0 1\nobj t.obj\n")
    np.testing.assert_allclose(scene.meshes[0].positions, [[10, 0, 4], [10, 2, 4], [7, 0, 4]], atol=1e-6)
    assert scene.meshes[0].positions.dtype == np.float32


def test_push_and_pop_save_the_matrix_and_not_the_material(write):
    scene = write("push\ntrans 5 0 0\nbrdf diffuse 1 0 0 1\nobj t.obj\npop\nobj t.obj\n")
    assert [m.positions[0, 0] for m in scene.meshes] == [5.0, 0.0]
    assert [m.material.albedo for m in scene.meshes] == [(1.0, 0.0, 0.0)] * 2


def test_a_material_holds_until_the_next_of_its_kind(write):
    # emission and reflectance are independent; before any line the surface is 0.5 and dark
    scene = write("obj t.obj\nbrdf emission 1 2 3\nobj t.obj\nbrdf diffuse .1 .2 .3 9\nobj t.obj\nbrdf emission 0 0 0\nobj t.obj")
    grey, some = (0.5, 0.5, 0.5), (0.1, 0.2, 0.3)
    expected = [(grey, (0, 0, 0)), (grey, (1, 2, 3)), (some, (1, 2, 3)), (some, (0, 0, 0))]
    assert [(m.material.albedo, m.material.emission) for m in scene.meshes] == expected


def test_normals_follow_the_inverse_transpose(write):
    # n = (1 1 0)/√2 on a surface stretched by 2 along x: S⁻ᵀn = (½ 1 0), unit (1 2 0)/√5
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 1 1 0\nf 1//1 2//1 3//1\n"
    scene = write("scale 2 1 1\nobj n.obj\n", n_obj=obj)
    np.testing.assert_allclose(scene.meshes[0].normals, [np.array([1, 2, 0]) / math.sqrt(5)] * 3, atol=1e-6)


def test_without_normals_a_face_has_its_own(write):
    # two triangles that share an edge at a right angle: six vertices, and the normals of the two planes
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 2 1 4\n"
    mesh = write("obj n.obj\n", n_obj=obj).meshes[0]
    assert len(mesh.positions) == 6
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * 3 + [[0, 1, 0]] * 3, atol=1e-7)


def test_faces_with_and_without_normals_live_in_one_file(write):
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 1 0 0\nf 1//1 2//1 3//1\nf 1 2 3\n"
    mesh = write("obj n.obj\n", n_obj=obj).meshes[0]
    np.testing.assert_allclose(mesh.normals[mesh.faces][:, 0], [[1, 0, 0], [0, 0, 1]], atol=1e-7)


def test_face_forms_polygons_and_negative_indices(tmp_path):
    # a pentagon is a fan of three; -1 is the last vertex *above the face*, here the fifth, although a sixth follows
    vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv .5 2 0\nv 0 1 0\n"
    text = vertices + "vn 0 0 1\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 1//-1 2//-1 3//-1\nf 1/2/1 2/2/1 3/2/1\nf -5 -4 -3 -2 -1\n"
    text += "v 9 9 9\n"
    (tmp_path / "a.obj").write_text(text)
    shape = load_obj(tmp_path / "a.obj")
    assert shape.corners.tolist() == [[0, 1, 2]] * 3 + [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert shape.corner_normals[:, 0].tolist() == [-1, 0, 0, -1, -1, -1]


def test_an_obj_keeps_what_its_lines_say_in_any_spelling(tmp_path):
    # comments, tabs, exponents, a weight after the position, a continued line, other words, CRLF and a byte-order mark
    text = "\ufeff# a\r\no thing\r\n\tv\t0 0 0 1\r\nv 1e0 +0 -.0 # b\r\nv 0 \\\r\n1 0\r\ns off\r\nf 1 2 \\\r\n3\r\n"
    (tmp_path / "a.obj").write_bytes(text.encode())
    shape = load_obj(tmp_path / "a.obj")
    assert shape.positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]] and shape.corners.tolist() == [[0, 1, 2]]


def test_a_scene_may_have_a_byte_order_mark_and_windows_line_ends(write):
    scene = write(b"\xef\xbb\xbfcam 0 0 5 0 0 0 0 1 0\r\nsky 1 2 3\r\n")
    assert scene.sky == (1.0, 2.0, 3.0) and scene.cameras[0].eye == (0.0, 0.0, 5.0)


def test_cameras_and_projection(write):
    # the unnamed camera is the default wherever it stands; `proj` holds for all, above and below it
    scene = write("cam left 1 0 5 0 0 0 0 1 0\n" + CAM + "proj 30 1.5 0.1 10\ncam right 2 0 5 0 0 0 0 1 0\n")
    assert [(c.name, c.eye[0], c.fov) for c in scene.cameras] == [("", 0, 30), ("left", 1, 30), ("right", 2, 30)]
    assert write("cam left 1 0 5 0 0 0 0 1 0\ncam right 2 0 5 0 0 0 0 1 0\n").camera().name == "left"


def test_lights(write):
    plain = light(write, "position 1 2 3 1\nambient 0 0 0 1\nspecular 1 1 1 1\ndiffuse .5 .6 .7 1\nquadraticAttenuation 2\n")
    assert (plain.position, plain.color, plain.attenuation) == ((1, 2, 3), (0.5, 0.6, 0.7), (1, 0, 2))
    assert not plain.physical and not plain.directional and plain.spot_target is None and plain.name == "a"
    assert light(write, "position 0 1 0 0\ndiffuse 1 1 1 1\n").directional
    spot = light(write, "position 0 5 0 1\nintensity 1 2 3\nspotDirection 0 0 0\nspotCutoff 30\nspotInner 20\nspotExponent 2\n")
    assert spot.physical and spot.spot_target == (0, 0, 0)
    assert (spot.spot_cutoff, spot.spot_inner, spot.spot_exponent) == (30, 20, 2)
    hard = light(write, "position 0 5 0 1\nintensity 1 2 3\nspotDirection 0 0 0\nspotCutoff 30\n")
    assert hard.spot_inner == 30  # a hard edge
    for cutoff in (90, 180):  # no cone: a direction and an exponent are read and mean nothing
        text = f"position 0 5 0 1\ndiffuse 1 1 1 1\nspotDirection 0 0 0\nspotExponent 3\nspotCutoff {cutoff}\n"
        assert light(write, text).spot_target is None


def test_where_nothing_shines_a_sky_stands_in(write):
    assert write("obj t.obj\n" + CAM).sky == (1.0, 1.0, 1.0)
    assert "sky" in write("obj t.obj\n" + CAM).notices[0]
    assert write("obj t.obj\nsky 0 0 0\n" + CAM).sky == (0.0, 0.0, 0.0)  # a black sky that was asked for
    assert write("brdf emission 1 1 1\nobj t.obj\n" + CAM).sky == (0.0, 0.0, 0.0)
    assert write("obj t.obj\nlight a.light\n" + CAM, a_light="position 0 0 0 1\ndiffuse 1 1 1 1\n").notices == ()


@pytest.mark.parametrize("text", ["scale 30 2 2\ntrans 4 4 4\nobj t.obj\n", "sky 1 1 1\n"])
def test_without_a_camera_one_sees_the_whole_scene(write, text):
    # every vertex lies inside the view of a square picture: |x|, |y| <= tan(fov/2)·depth
    scene = write(text)
    camera = scene.camera()
    points = np.concatenate([np.zeros((0, 3)), *(mesh.positions for mesh in scene.meshes)])
    x, y, z = camera.view_from_world[:3, :3] @ points.T + camera.view_from_world[:3, 3:]
    assert (np.maximum(np.abs(x), np.abs(y)) <= math.tan(math.radians(camera.fov / 2)) * -z + 1e-6).all()
    assert any("camera" in notice for notice in scene.notices)


def test_no_geometry_is_legal(write):
    scene = write("# nothing but a comment\n")
    assert scene.triangles == 0 and scene.sky == (1.0, 1.0, 1.0)
    assert any("there are no triangles in this file; its sky alone is shown" in notice for notice in scene.notices)
    assert write("obj e.obj\n", e_obj="# no faces\n").meshes == ()


def test_degenerate_triangles_are_dropped_with_one_notice(write):
    # a point, a line (three collinear vertices, which no rounding may save) and a true triangle, drawn twice
    obj = TRIANGLE + "v .1 .1 .1\nv .2 .2 .2\nv .3 .3 .3\nf 1 1 1\nf 4 5 6\n"
    scene = write(CAM + "sky 1 1 1\nobj d.obj\ntrans 1 0 0\nobj d.obj\n", d_obj=obj)
    assert scene.triangles == 2
    assert len(scene.notices) == 1 and re.search(r"d\.obj: 4 degenerate triangles dropped", scene.notices[0])


def test_closed_means_watertight_and_wound_outward(write):
    def closed(transform: str, obj: str = CUBE) -> bool:
        return write(transform + "\nobj c.obj\n", c_obj=obj).meshes[0].closed

    inward = re.sub(r"f (\d) (\d) (\d) (\d)", r"f \4 \3 \2 \1", CUBE)
    assert closed("rotate 33 1 2 3")
    assert not closed("scale -1 1 1")  # a mirror turns the winding: the surface now faces inward
    assert closed("scale 1 1 -1", inward)
    assert not closed("", inward)
    assert not closed("", CUBE.rsplit("f", 1)[0])  # one face is missing


def test_closed_asks_every_part_for_a_positive_volume():
    # 50 tetrahedra apart from each other are 50 closed parts; turn one of them and the whole no longer is
    corners = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    points = np.concatenate([np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) + 3 * k for k in range(50)]).astype(
        np.float32
    )
    faces = np.concatenate([corners + 4 * k for k in range(50)])
    assert is_closed(points, faces)
    faces[-4:] = faces[-4:, ::-1]
    assert not is_closed(points, faces)


def test_a_transform_beyond_float32_is_an_error():
    positions, corners = np.eye(3), np.array([[0, 1, 2]])
    with pytest.raises(InputError, match="32-bit"):
        build_mesh(positions, corners, np.zeros((0, 3)), -np.ones_like(corners), np.diag([1e39, 1, 1, 1]), Material())


def test_a_large_obj_loads_in_a_blink(tmp_path):
    # 80 000 triangles; a loop over lines in Python would take some ten times as long
    n = 200
    x, y = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    v = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel() + 1
    f = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    lines = [f"v {a} {b} {c}" for a, b, c in v.tolist()] + ["vn 0 0 1"]
    lines += [f"f {a}//1 {b}//1 {c}//1" for a, b, c in f.tolist()]
    (tmp_path / "big.obj").write_text("\n".join(lines))
    shape = load_obj(tmp_path / "big.obj")
    np.testing.assert_array_equal(shape.positions, v)
    np.testing.assert_array_equal(shape.corners, f - 1)


# ---- units -------------------------------------------------------------------------------------------------------------


def in_units(folder: Path, units: str) -> Scene:
    """A scene with one of everything that shines."""
    (folder / "quad.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    (folder / "a.light").write_text("position 0 1 0 1\nintensity 179 358 537\n")
    (folder / "b.light").write_text("position 0 1 0 0\ndiffuse 179 179 0 1\n")
    text = "light a.light\nlight b.light\nsky 17.9 0 0\nbrdf emission 0 358 0\nbrdf diffuse 0.2 0.3 0.4 1\nobj quad.obj\n"
    (folder / "one.scene").write_text(f"# first\n{units}\ncam 0 0 5 0 0 0 0 1 0\n{text}")
    return load(folder / "one.scene")


def test_photometric_units_are_divided_by_179_lumens_per_watt(tmp_path: Path) -> None:
    scene = in_units(tmp_path, "units photometric")
    assert scene.lights[0].color == pytest.approx((1.0, 2.0, 3.0))
    assert scene.lights[1].color == pytest.approx((1.0, 1.0, 0.0))
    assert scene.sky == pytest.approx((0.1, 0.0, 0.0))
    assert scene.meshes[0].material.emission == pytest.approx((0.0, 2.0, 0.0))
    assert scene.meshes[0].material.albedo == (0.2, 0.3, 0.4), "a share has no unit"


@pytest.mark.parametrize("units", ["units radiometric", ""])
def test_other_units_are_watts(tmp_path: Path, units: str) -> None:
    scene = in_units(tmp_path, units)
    assert scene.lights[0].color == (179.0, 358.0, 537.0) and scene.sky == (17.9, 0.0, 0.0)
    assert scene.meshes[0].material.emission == (0.0, 358.0, 0.0)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("units candela\n", 1, "'candela' are no units; expected: units radiometric, or: units photometric"),
        ("units\n", 1, "'' are no units"),
        ("units photometric\n\nunits photometric\n", 3, "'units' is given twice; first in line 1"),
        ("sky 1 1 1\nunits photometric\n", 2, "stands before all light, but line 1 has some"),
        ("brdf emission 1 1 1\nunits radiometric\n", 2, "stands before all light, but line 1 has some"),
    ],
)
def test_units_that_cannot_be_are_refused(tmp_path: Path, text: str, line: int, words: str) -> None:
    (tmp_path / "one.scene").write_text(text)
    with pytest.raises(InputError) as caught:
        load(tmp_path / "one.scene")
    assert f"one.scene:{line}: " in str(caught.value) and words in str(caught.value)
