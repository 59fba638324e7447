"""An .obj as a scene of its own: allowed and damaged forms, and their meshes."""

from __future__ import annotations

import math
import random
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.core.color import linear_from_srgb
from irrsplat.scene import load
from irrsplat.scene.io.mesh_builder import crease_normals
from irrsplat.scene.io.obj.polygons import triangulate
from irrsplat.scene.io.obj.reader import load_obj
from irrsplat.scene.model import Mesh, Scene

pytestmark = pytest.mark.usefixtures("without_stand_ins")

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.fixture
def obj(tmp_path: Path):
    def obj(text: str | bytes, name: str = "a.obj", **keywords: Any) -> Scene:
        (tmp_path / name).write_bytes(text.encode() if isinstance(text, str) else text)
        return load(tmp_path / name, **keywords)

    return obj


def areas(mesh: Mesh) -> np.ndarray:
    """Return the area vectors (F, 3) of a mesh's triangles."""
    a, b, c = (mesh.positions[mesh.faces[:, i]].astype(float) for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


def remarks(scene: Scene) -> str:
    """Return the notices, except those on a stand-in camera and light."""
    return "\n".join(notice for notice in scene.notices if ": no camera; " not in notice and " light; " not in notice)


def test_every_number_is_what_python_reads(tmp_path):
    """Exact equality for digits, signs and exponents of all sizes, 17 digits among them."""
    generator = random.Random(3)
    words = ["1.", "+.5", "-0", "1e-3", "1E+2", "00012.50", "123456789012345", "4.9e-324", ".1e1"]
    for i in range(891):
        words.append(f"{generator.uniform(-1, 1) * 10.0 ** generator.randrange(-12, 12):.{i % 17 + 1}g}")
    rows = "".join(f"v {' '.join(words[i : i + 3])}\n" for i in range(0, 900, 3))
    (tmp_path / "a.obj").write_text(rows + "f 1 2 3\n")
    for strict in (False, True):
        found = load_obj(tmp_path / "a.obj", strict=strict).positions
        assert found.ravel().tolist() == [float(word) for word in words]


@pytest.mark.parametrize(
    "face", ["f 1 2 3", "f  1//1\t2//1 3//1 ", "f 1/1 2/2 3/3", "f 1/1/1 2/2/1 3/3/1", "f -4/-3/-1 2 -2//1", "f +1 2/ 3//"]
)
def test_corners_of_every_form_may_stand_in_one_face(obj, face):
    # after faces of other forms, so that no form is the only one of the file; four vertices: -4 is the first
    mesh = obj(f"{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nf 1 3 4\n{face} # the lower right half\nf 1/1 3/3 4/2\n").meshes[0]
    assert areas(mesh)[1].tolist() == [0, 0, 0.5] and len(mesh.faces) == 3
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * len(mesh.normals), atol=1e-7)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("f 1 2", "1 face can't be read and is left out; the first is line 8: a face has 2 corners"),
        ("f 1 2 9", "line 8: the face refers to vertex 9, but there are 4 'v' lines"),
        ("f 1 2 0", "line 8: the face refers to vertex 0, but indices start at 1"),
        ("f 1/1/1/1 2 3", "line 8: '1/1/1/1' is no corner"),
        ("f 1 2 99999999999999999999", "line 8: '99999999999999999999' is no corner"),
        ("f 1 2 3\nf\nf 1\nf 2", "3 faces can't be read and are left out; the first is line 9: a face has 0 corners"),
        ("v 1 2 x\nf 1 2 5", "line 9: one of its vertices can't be read"),
        ("v 1 1e300 2\nf 1 2 5", "line 8: '1e300' is beyond 1e+15"),
        ("vn 0 0\nvt\nf 1/1/1 2 3", "1 'vn' line can't be read"),
        ("f 1/7 2/8/9 3//9", "4 corners refer to texture coordinates or normals that do not exist"),
        ("l 1 2\nl 1 2\np 1", "2 lines and 1 points are not shown"),
    ],
)  # fmt: skip
def test_a_bad_line_costs_itself_and_a_notice(obj, line, message):
    scene = obj(f"# a square\n{SQUARE}vn 0 0 1\nf 1 2 3\n{line}\nf 1 3 4\n")
    assert message in remarks(scene), scene.notices
    assert all("\n" not in notice and notice.isprintable() for notice in scene.notices)
    kept = line.startswith(("f 1/7", "vn")) + line.startswith("f 1 2 3\n")
    np.testing.assert_array_equal(areas(scene.meshes[0]).sum(0), [0, 0, 1 + 0.5 * kept])


WHITE = "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\n"


@pytest.mark.parametrize(
    ("text", "green", "message"),
    [
        ("# C:\\ \n" + SQUARE + "g D:\\ \n" + " " * 100 + "f 1 2 3 # E:\\\n", None, ""),  # none of these lines continues
        (WHITE + "f 1 2 3\n", None, ""),
        (WHITE.replace("1 1 1", "0 0 -1") + "f 1 2 3\n", None, ""),  # normals, as from some programs
        (WHITE.replace("1 1 1", "0 1 0") + "f 1 2 3\n", 1.0, ""),
        (WHITE.replace("1 1 1", "0 1 0") + "usemtl black\nf 1 2 3\n", 1.0, ""),  # a black material hides no colours
        (SQUARE + "usemtl gone\nf 1 2 3\nusemtl lost\nf 1 2 3\n", None, "no material file defines 'gone' and 1 more"),
    ],
)
def test_colours_and_materials_without_effect(obj, tmp_path, text, green, message):
    """One triangle in each mesh, which is not closed; colours that are all white are none."""
    (tmp_path / "a.mtl").write_text("newmtl black\nKd 0 0 0\n")
    scene = obj("mtllib a.mtl\n" * ("gone" not in text) + text)
    assert message in remarks(scene) and not any(mesh.closed for mesh in scene.meshes)
    assert areas(scene.meshes[0])[0].tolist() == [0, 0, 0.5]
    assert (None if scene.meshes[0].colors is None else scene.meshes[0].colors[:, 1].min()) == green


RING = [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]  # a hole, connected by a bridge
ARROW = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)]
COMB = [(0, 0), *((x, y) for i in range(8) for x, y in ((2 * i, 5), (2 * i + 1, 1))), (16, 0)]


@pytest.mark.parametrize(
    ("outline", "area"),
    [
        (RING, 8.0),
        (ARROW, 7.0),
        (COMB, None),
        ([(0, 0), (2, 1), (4, 0), (2, 5)], 8.0),  # concave at 1: not the diagonal from 0
        ([(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)], 4.0),  # collinear corners
        ([(math.cos(t), math.sin(t)) for t in np.arange(60) * math.pi / 30], None),
    ],
)
@pytest.mark.parametrize("turn", [0, 3])
def test_polygons_are_covered_once(outline, area, turn):
    # in a tilted plane; the triangles' area vectors sum to the polygon's (the shoelace formula), and so do their lengths
    flat = np.roll(np.array(outline, float), turn, axis=0)
    x, y = flat.T
    shoelace = 0.5 * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    assert area is None or shoelace == pytest.approx(area)
    points = flat @ np.array([[1, 2, 2], [2, 1, -2]]) / 3.0
    triangles, owner = triangulate(points, np.arange(len(points)), np.array([len(points)]))
    a, b, c = (points[triangles[:, i]] for i in range(3))
    vectors = 0.5 * np.cross(b - a, c - a)
    assert np.linalg.norm(vectors.sum(0)) == pytest.approx(shoelace) and (owner == 0).all()
    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(shoelace)


def fold(degrees: float) -> str:
    """Return two squares that meet at an angle along the z axis, without normals."""
    x, y = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return f"v -1 0 0\nv 0 0 0\nv {x} {y} 0\nv -1 0 1\nv 0 0 1\nv {x} {y} 1\nf 1 4 5 2\nf 2 5 6 3\n"


@pytest.mark.parametrize(
    ("angle", "crease", "smooth"), [(30, 40, True), (50, 40, False), (50, 60, True), (30, 0, False), (90, 180, True)]
)
def test_edges_below_the_crease_angle_are_smooth(obj, angle, crease, smooth):
    mesh = obj(fold(angle), crease_angle=crease).meshes[0]
    on_edge = np.abs(mesh.positions[:, 0]) < 1e-6
    half = math.radians(angle / 2 if smooth else 0)
    assert np.abs(mesh.normals[on_edge] @ [-math.sin(half), math.cos(half), 0]).max() == pytest.approx(1, abs=1e-6)
    assert len(mesh.positions) == (6 if smooth else 8 if crease else 12)


def test_a_sphere_without_normals_is_round(obj):
    """24 × 12 quads with a seam of doubled vertices: within 2° of the radius."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0.2, np.pi - 0.2, 13))
    points = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], 2).reshape(-1, 3).round(6)
    text = "".join("v {} {} {}\n".format(*p) for p in points)
    text += "".join(f"f {i} {i + 25} {i + 26} {i + 1}\n" for r in range(12) for i in range(25 * r + 1, 25 * r + 25))
    mesh = obj(text).meshes[0]
    inside = np.abs(mesh.positions[:, 2]) < 0.95
    assert (mesh.normals * mesh.positions).sum(1)[inside].min() > math.cos(math.radians(2))


def test_many_triangles_at_one_vertex_are_not_compared_in_pairs():
    """A cone of 3000 sides: its tip alone has 9 million pairs of corners, which would take 72 MB."""
    t = np.arange(3000) * 2 * np.pi / 3000
    points = np.concatenate([np.array([[0.0, 0.0, 3.0]]), np.stack([np.cos(t), np.sin(t), 0.0 * t], axis=1)])
    first = np.arange(3000)
    tracemalloc.start()
    normals, _ = crease_normals(points, np.stack([0 * first, first + 1, (first + 1) % 3000 + 1], axis=1), 40.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(normals) >= 3000 and peak < 20e6


def test_more_groups_than_400_are_merged_by_material(obj):
    groups = "".join(f"g part{i}\nusemtl m{i % 3}\nf 1 2 3\n" for i in range(1000))
    scene = obj(SQUARE + 100 * "v 0 0 0\n" + "v 5 5 0\n" + groups + "usemtl far\nf 1 2 105\n")
    assert [mesh.name for mesh in scene.meshes] == ["m0", "m1", "m2", "far"] and scene.triangles == 1001
    assert np.ptp(scene.meshes[3].positions, axis=0).tolist() == [5, 5, 0]


@pytest.mark.parametrize(("scale", "form"), [(1, "{:.4f}"), (255, "{:.1f}")])
def test_vertex_colours_are_srgb_in_either_range_times_the_material(obj, tmp_path, scale, form):
    values = np.array([[0.5, 0, 1], [1, 1, 1], [0.25, 0.75, 0.1], [0, 0, 0.6]])
    rows = [line + " " + " ".join(form.format(x) for x in c * scale) for line, c in zip(SQUARE.splitlines(), values, strict=True)]
    (tmp_path / "a.mtl").write_text("newmtl half\nKd 0.5 0.5 0.5\n")
    mesh = obj("mtllib a.mtl\n" + "\n".join(rows) + "\nusemtl half\nf 1 2 3 4\n").meshes[0]
    at = {tuple(p): i for i, p in enumerate(mesh.positions.tolist())}
    order = [at[tuple(map(float, line.split()[1:]))] for line in SQUARE.splitlines()]
    assert mesh.colors is not None
    np.testing.assert_allclose(mesh.colors[order], 0.5 * linear_from_srgb(values), atol=2e-3 if scale > 1 else 1e-4)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16", "utf-16-be"])
def test_every_encoding_is_read(obj, tmp_path, encoding):
    (tmp_path / "Möbel.mtl").write_bytes("newmtl Stühle rot\nKd 1 0 0\n".encode(encoding))
    scene = obj(f"mtllib Möbel.mtl\n{SQUARE}usemtl Stühle rot\nf 1 2 3\n".encode(encoding))
    assert (scene.meshes[0].name, scene.meshes[0].material.albedo) == ("Stühle rot", (1, 0, 0)) and not remarks(scene)


@pytest.mark.parametrize(
    "written", ["./my colours.MTL", "sub\\My Colours.mtl", "My%20Colours.mtl", "b.mtl My Colours.mtl", "gone", ""]
)
def test_material_files_are_found_under_other_names(obj, tmp_path, written):
    # the last two name no file that exists: the one named like the .obj is read instead; keywords may be in upper case
    (tmp_path / ("a.mtl" if written in ("gone", "") else "My Colours.mtl")).write_text("newmtl Red\nKd 1 0 0\n")
    (tmp_path / "b.mtl").write_text("newmtl other\nKd 0 1 0\n")
    scene = obj(f"MTLLIB {written}\n{SQUARE.upper()}UseMtl red\nF 1 2 \\ \n3\n")
    assert scene.meshes[0].material.albedo == (1, 0, 0)
    assert remarks(scene).count("\n") == 0 and ("'a.mtl' is read instead" in remarks(scene)) == (written == "gone")
