"""The grammar of .scene, .light and .obj: the meaning of each line, and the place of each error."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import irrsplat
from irrsplat.core.errors import InputError
from irrsplat.scene.io.obj.reader import load_obj

CUBE = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 5 8 4\nf 2 3 7 6\nf 1 2 6 5\nf 4 8 7 3\nf 1 4 3 2\nf 5 6 7 8\n"""
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
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
    # a material applies until the next of its kind; before any line the surface is 0.5 and dark
    text = "obj t.obj\npush\ntrans 5 0 0\nbrdf diffuse 1 0 0 1\nobj t.obj\npop\nbrdf emission 1 2 3\nobj t.obj\n"
    scene = write(text)
    assert [m.positions[0, 0] for m in scene.meshes] == [0.0, 5.0, 0.0]
    assert [m.material.albedo for m in scene.meshes] == [(0.5, 0.5, 0.5), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    assert [m.material.emission for m in scene.meshes] == [(0, 0, 0), (0, 0, 0), (1, 2, 3)]


def test_normals_follow_the_inverse_transpose(write):
    # n = (1 1 0)/√2 on a surface stretched by 2 along x: S⁻ᵀn = (½ 1 0), unit (1 2 0)/√5
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 1 1 0\nf 1//1 2//1 3//1\n"
    scene = write("scale 2 1 1\nobj n.obj\n", n_obj=obj)
    np.testing.assert_allclose(scene.meshes[0].normals, [np.array([1, 2, 0]) / math.sqrt(5)] * 3, atol=1e-6)


def test_without_normals_a_face_has_its_own(write):
    # two triangles that share an edge at a right angle, and one with normals: nine vertices, and the normals of the two planes
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 1 0 0\nf 1 2 3\nf 2 1 4\nf 1//1 2//1 3//1\n"
    mesh = write("obj n.obj\n", n_obj=obj).meshes[0]
    assert len(mesh.positions) == 9
    np.testing.assert_allclose(mesh.normals[mesh.faces][:, 0], [[0, 0, 1], [0, 1, 0], [1, 0, 0]], atol=1e-7)


def test_face_forms_polygons_and_negative_indices(tmp_path):
    # a pentagon is a fan of three; -1 is the last vertex *above the face*, here the fifth, although a sixth follows
    vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv .5 2 0\nv 0 1 0\n"
    text = vertices + "vn 0 0 1\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 1//-1 2//-1 3//-1\nf 1/2/1 2/2/1 3/2/1\nf -5 -4 -3 -2 -1\n"
    text += "v 9 9 9\n"
    (tmp_path / "a.obj").write_text(text)
    shape = load_obj(tmp_path / "a.obj")
    assert shape.corners.tolist() == [[0, 1, 2]] * 3 + [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert shape.corner_normals[:, 0].tolist() == [-1, 0, 0, -1, -1, -1]


def test_cameras_and_projection(write):
    # the unnamed camera is the default at any position; `proj` holds for all, above and below it
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
    for cutoff in (90, 180):  # no cone: a direction and an exponent are read and have no effect
        text = f"position 0 5 0 1\ndiffuse 1 1 1 1\nspotDirection 0 0 0\nspotExponent 3\nspotCutoff {cutoff}\n"
        assert light(write, text).spot_target is None


def test_a_sky_stands_in_where_nothing_emits(write):
    plain = write("obj t.obj\n" + CAM)
    assert plain.sky == (1.0, 1.0, 1.0) and plain.sky_gradient == (0.0, 0.0, 0.0) and "sky" in plain.notices[0]
    assert write("obj t.obj\nsky 0 0 0\n" + CAM).sky == (0.0, 0.0, 0.0)  # a requested black sky
    assert write("brdf emission 1 1 1\nobj t.obj\n" + CAM).sky == (0.0, 0.0, 0.0)
    assert write("obj t.obj\nlight a.light\n" + CAM, a_light="position 0 0 0 1\ndiffuse 1 1 1 1\n").notices == ()


def test_closed_means_watertight_and_wound_outward(write):
    def closed(transform: str, obj: str = CUBE) -> bool:
        return bool(write(CAM + transform + "\nobj c.obj\n", c_obj=obj).meshes[0].closed)

    inward = re.sub(r"f (\d) (\d) (\d) (\d)", r"f \4 \3 \2 \1", CUBE)
    assert closed("rotate 33 1 2 3")
    assert not closed("scale -1 1 1")  # a mirror reverses the winding: the surface faces inward
    assert closed("scale 1 1 -1", inward)
    assert not closed("", CUBE.rsplit("f", 1)[0])  # one face is missing


@pytest.mark.parametrize(("units", "watt"), [("units photometric", 179.0), ("units radiometric", 1.0), ("", 1.0)])
def test_photometric_units_are_divided_by_179_lumens_per_watt(write, units, watt):
    """Lights, sky and emission are divided; an albedo has no unit."""
    light = "light a.light\nlight b.light\nsky 17.9 0 0\nbrdf emission 0 358 0\nbrdf diffuse 1 0 0 1\n"
    text = f"# first\n{units}\n{CAM}{light}obj t.obj\n"
    point_lights = {"a_light": "position 0 1 0 1\nintensity 179 358 537\n", "b_light": "position 0 1 0 0\ndiffuse 179 179 0 1\n"}
    scene = write(text, **point_lights)
    assert [light.color for light in scene.lights] == [(179 / watt, 358 / watt, 537 / watt), (179 / watt, 179 / watt, 0)]
    assert scene.sky == (17.9 / watt, 0, 0) and scene.meshes[0].material.emission == (0, 358 / watt, 0)
    assert scene.meshes[0].material.albedo == (1, 0, 0)
    assert irrsplat.load(scene.path, sky="0 17.9 0").sky == (0, 17.9 / watt, 0)


def refused(write, text, file, line, message, **files):
    """Expect reading `text`, a .scene, to fail with one line that starts with the place and contains `says`."""
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        write(text, **files)
    place = f"{file}: " if line is None else f"{file}:{line}: "
    assert place in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("\nfoo 1\n", 2, "unknown word 'foo'"),
        ("units candela\n", 1, "'candela' are no units; expected: units radiometric, or: units photometric"),
        ("units photometric\n\nunits photometric\n", 3, "'units' is given twice; first in line 1"),
        ("brdf emission 1 1 1\nunits radiometric\n", 2, "stands before all light, but line 1 has some"),
        ("cam 1 2 3\n", 1, "'cam' has 3 values"),
        (CAM + CAM, 2, "'cam' is given twice; first in line 1"),
        ("cam a" + CAM[3:] + "cam a" + CAM[3:], 2, "'cam a' is given twice"),
        ("cam 1 2 3 1 2 3 0 1 0\n", 1, "eye lies at its target"),
        ("cam 7" + CAM[3:], 1, "'cam' has 10 numbers"),
        ("cam 0 5 0 0 0 0 0 1 0\n", 1, "parallel"),
        ("proj 0 1 1 10\n", 1, "between 0 and 180"),
        ("proj 45 0 1 10\n", 1, "ASPECT"),
        ("proj 45 1 10 1\n", 1, "NEAR < FAR"),
        ("brdf\n", 1, "no kind of brdf"),
        ("brdf glossy 1 1 1\n", 1, "'glossy' is no kind of brdf"),
        ("brdf diffuse 1.1 0 0 1\n", 1, "from 0 to 1"),
        ("brdf diffuse 0 nan 0 1\n", 1, "not a finite number"),
        ("brdf emission 0 -1 0\n", 1, "the emission is 0 -1 0; expected values of 0 or more"),
        ("push\npush\npop\n", 1, "'push' has no 'pop'"),
        ("push\npop\n\npop\n", 4, "'pop' has no 'push'"),
        ("trans 1 2 1_0\n", 1, "'1_0' is not a number"),
        ("rotate 90 0 0 0\n", 1, "axis is 0 0 0"),
        ("scale 1 0 1\n", 1, "scale of 0"),
        ("obj t.obj\n" * 65537, 65537, "more than 65536 'obj' lines"),
        ("obj\n", 1, "names no file"),
        ("obj nope.obj\n", 1, "there is no file 'nope.obj'"),
        ("obj .\n", 1, "is a directory"),
        ("light nope.light\n", 1, "there is no file 'nope.light'"),
        ("scale 1e30 1 1\n", 1, "beyond 1e+15"),
        ("scale 1e14 1e14 1e14\nscale 1e14 1 1\nscale 1e14 1 1\nobj t.obj\n", 4, "32-bit"),
    ],
)  # fmt: skip
def test_a_malformed_scene_line_is_an_error_with_its_place(write, text, line, message):
    refused(write, text, "a.scene", line, message)


POINT = "position 0 5 0 1\n"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (POINT + "colour 1 1 1\n", 2, "unknown word 'colour'"),
        (POINT + POINT, 2, "given twice"),
        ("position 0 0 0 2\n", 1, "W is 2"),
        ("diffuse 1 1 1 1\nposition 0 0 0 0\n", 2, "other than 0 0 0"),
        ("diffuse 1 1 1 1\n", None, "no position"),
        (POINT, None, "no colour"),
        (POINT + "diffuse 1 -1 1 1\n", 2, "negative"),
        (POINT + "intensity 1 1 1\ndiffuse 1 1 1 1\n", 3, "exclude each other"),
        ("position 0 1 0 0\nintensity 1 1 1\n", 2, "W 0"),
        (POINT + "diffuse 1 1 1 1\nlinearAttenuation -1\n", 3, "negative"),
        (POINT + "diffuse 1 1 1 1\nconstantAttenuation 0\n", 3, "division by zero"),
        (POINT + "diffuse 1 1 1 1\nspotCutoff 30\n", 3, "needs the point"),
        (POINT + "diffuse 1 1 1 1\nspotDirection 0 0 0\nspotCutoff 100\n", 4, "spotCutoff is 100; expected a half angle"),
        (POINT + "diffuse 1 1 1 1\nspotExponent -1\n", 3, "negative"),
        (POINT + "diffuse 1 1 1 1\nspotInner 10\n", 3, "needs a cone"),
        (POINT + "diffuse 1 1 1 1\nspotDirection 0 0 0\nspotCutoff 20\nspotInner 21\n", 5, "spotInner is 21"),
        (POINT + "diffuse 1 1 1 1\nspotDirection 0 5 0\nspotCutoff 20\n", 3, "its own position"),
        ("position 0 1 0 0\ndiffuse 1 1 1 1\nspotDirection 0 0 0\nspotCutoff 20\n", 4, "has no cone"),
        ("\n", None, "empty"),
    ],
)  # fmt: skip
def test_a_malformed_light_is_an_error_with_its_place(write, text, line, message):
    refused(write, "light a.light\n", "a.light", line, message, a_light=text)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("v 1 2\n", 1, "'v' has 2 values"),
        ("v 1 2 3\n\nv 1 x 3\n", 3, "'x' is not a number"),
        ("v 1 \\\n 2 3\nv 1 inf 2\n", 3, "not a finite number"),
        ("vn 0 0\n", 1, "'vn' has 2 values"),
        (TRIANGLE + "f 1 2\n", 5, "a face has 2 corners"),
        (TRIANGLE + "f 1 2 0\n", 5, "vertex 0, but indices start at 1"),
        (TRIANGLE + "f 1 2 -4\n", 5, "vertex -4, but there are 3"),
        (TRIANGLE + "f 1//1 2//1 3//1\n", 5, "normal 1, but there are 0"),
        (TRIANGLE + "f 1/1/2 2/1/1 3/1/1\nvn 0 0 1\n", 5, "normal 2, but there are 1"),
        (TRIANGLE + "f 1 2//1 3\n", 5, "different kinds"),
        (TRIANGLE + "f 1 2 99999999999999999999\n", 5, "is no corner"),
        ("hello\nworld\n", None, "no line of this file is an OBJ command"),
        ("", None, "empty"),
    ],
)  # fmt: skip
def test_a_malformed_obj_line_is_an_error_with_its_place(write, text, line, message):
    refused(write, "obj x.obj\n", "x.obj", line, message, x_obj=text)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "empty"),
        (b"sky 1 1 1\n\0\1\2garbage", "binary"),
        (b"sky 1 1 1\n# caf\xe9\n", "a.scene:2: this is not UTF-8"),
        (b"\x1b[31m 1 2\n", "unknown word"),
    ],
)  # fmt: skip
def test_binary_data_is_an_error(write, data, message):
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        write(data)
    assert "a.scene" in str(caught.value) and str(caught.value).isprintable()
