"""An .obj that is opened by itself: what it may look like, and what becomes of it."""

from __future__ import annotations

import math
import random
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.core.color import linear_from_srgb
from irrsplat.core.errors import InputError
from irrsplat.scene import load
from irrsplat.scene.io.obj.polygons import triangulate
from irrsplat.scene.io.obj.reader import load_obj
from irrsplat.scene.io.obj.text import block, find_lines, floats
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
    """The area vectors (F, 3) of a mesh's triangles."""
    a, b, c = (mesh.positions[mesh.faces[:, i]].astype(float) for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


def remarks(scene: Scene) -> str:
    """The notices."""
    return "\n".join(scene.notices)


# numbers


def test_every_number_is_what_python_reads(tmp_path):
    # to the bit: of digits, signs and exponents of all sizes, 17 digits among them
    generator = random.Random(3)
    words = [
        f"{generator.uniform(-1, 1) * 10.0 ** generator.randrange(-12, 12):.{generator.randrange(1, 18)}g}" for _ in range(900)
    ]
    words[:9] = "1.", "+.5", "-0", "1e-3", "1E+2", "00012.50", "123456789012345678901234567890", "4.9e-324", ".1e1"
    rows = "".join(f"v {' '.join(words[i : i + 3])}\n" for i in range(0, 900, 3))
    lines = find_lines(tmp_path, rows.encode())
    text = block(lines, np.arange(300)).code.tobytes()
    assert floats(text, 900).tolist() == [float(word) for word in words]


@pytest.mark.parametrize(
    "face", ["f 1 2 3", "f  1//1\t2//1 3//1 ", "f 1/1 2/2 3/3", "f 1/1/1 2/2/1 3/3/1", "f -4/-3/-1 2 -2//1", "f +1 2/ 3//"]
)
def test_corners_of_every_form_may_stand_in_one_face(obj, face):
    # behind faces of other forms, so that no form is the only one of the file; four vertices: -4 is the first
    mesh = obj(f"{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nf 1 3 4\n{face} # the lower right half\nf 1/1 3/3 4/2\n").meshes[0]
    assert areas(mesh)[1].tolist() == [0, 0, 0.5] and len(mesh.faces) == 3
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * len(mesh.normals), atol=1e-7)


def test_a_face_mixes_lines_of_all_kinds_with_windows_and_old_mac_ends(obj):
    text = f"{SQUARE}\n  f 1 2 \\\n 3\n\tf 1 3 4 # half\n#f 1 2 3\nf 1 2 3 4\n"
    for ends in ("\n", "\r\n", "\r"):
        scene = obj(text.replace("\n", ends))
        assert scene.triangles == 4 and not remarks(scene)


# what is malformed is left out, and counted


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("f 1 2", "1 face can't be read and is left out; the first is line 8: a face has 2 corners"),
        ("f 1 2 9", "line 8: the face refers to vertex 9, but there are 4 'v' lines"),
        ("f 1 2 -5", "line 8: the face refers to vertex -5"),
        ("f 1 2 0", "line 8: the face refers to vertex 0, but indices start at 1"),
        ("f a b c", "line 8: 'a' is no corner"),
        ("f 1 2 3-4", "line 8: '3-4' is no corner"),
        ("f 1/1/1/1 2 3", "line 8: '1/1/1/1' is no corner"),
        ("f 1 2 /3", "line 8: '/3' is no corner"),
        ("f 1 2 99999999999999999999", "line 8: '99999999999999999999' is no corner"),
        ("f 1.5 2 3", "line 8: '1.5' is no corner"),
        ("f 1 2 3\nf\nf 1\nf 2", "3 faces can't be read and are left out; the first is line 9: a face has 0 corners"),
        ("v 1 2", "1 'v' line can't be read and is left out; the first is line 8: 'v' has 2 values"),
        ("v 1 2 x\nf 1 2 5", "line 9: one of its vertices can't be read"),
        ("v 1 2 x\nf 1 2 5", "line 8: 'x' is not a number"),
        ("v 1 nan 2\nf 1 2 5", "line 8: 'nan' is not a finite number"),
        ("v 1 1e300 2\nf 1 2 5", "line 8: '1e300' is beyond 1e+15"),
        ("v 1 1.2.3 2", "line 8: '1.2.3' is not a number"),
        ("vn 0 0\nvt\nf 1/1/1 2 3", "1 'vn' line can't be read"),
        ("f 1/7 2/8/9 3//9", "4 corners refer to texture coordinates or normals that are not there"),
        ("l 1 2\nl 1 2\np 1", "2 lines and 1 points are not shown"),
    ],
)  # fmt: skip
def test_a_bad_line_costs_itself_and_a_notice(obj, line, says):
    scene = obj(f"# a square\n{SQUARE}vn 0 0 1\nf 1 2 3\n{line}\nf 1 3 4\n")
    assert says in remarks(scene), scene.notices
    assert all("\n" not in notice and notice.isprintable() for notice in scene.notices)
    kept = line.startswith(("f 1/7", "vn")) + line.startswith("f 1 2 3\n")
    np.testing.assert_array_equal(areas(scene.meshes[0]).sum(0), [0, 0, 1 + 0.5 * kept])


@pytest.mark.parametrize("text", ["hello\nworld\n", SQUARE, "f 1 2 3\n", SQUARE + "f 1 2\nf 7 8 9\n", "v\nf\n\0\n", "l 1 2\n"])
def test_a_file_without_one_good_face_is_refused_in_one_line(obj, text):
    with pytest.raises(InputError, match=r"a\.obj: ") as caught:
        obj(text)
    assert "\n" not in str(caught.value)


def test_two_hundred_damaged_files_load_or_are_refused_in_one_line(obj, tmp_path):
    # letters, lines and blocks of a true file are changed, doubled, swapped and cut out
    generator = random.Random(11)
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
    strip = "".join(f"v {i} {j} 0\n" for i in range(6) for j in range(2))
    true = f"mtllib a.mtl\no x\n{strip}vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n"
    true += "usemtl a\ns 1\nf 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\nf 3 4 6 5\nf 5 6 8 7\nf 7/1 8/2 10/2 9/3\nf 9 10 12 11\n"
    loaded = 0
    for _ in range(200):
        data = bytearray(true.encode())
        for _ in range(generator.randrange(1, 5)):
            at, to = sorted(generator.randrange(len(data)) for _ in range(2))
            change = generator.randrange(4)
            if change == 0:
                data[at] = (
                    generator.choice(b"0123456789-+./ \n\r\t#\\vnftgos\0\xff")
                    if generator.random() < 0.8
                    else generator.randrange(256)
                )
            elif change == 1:
                data[at:at] = data[at : min(to, at + 9)]
            elif change == 2 and len(data) > 60:
                del data[at : min(to, at + 9)]
            else:
                data[at], data[to] = data[to], data[at]
        try:
            scene = obj(bytes(data))
        except InputError as error:
            assert "\n" not in str(error)
        else:
            loaded += 1
            assert all(np.isfinite(mesh.positions).all() and np.isfinite(mesh.normals).all() for mesh in scene.meshes)
            assert all("\n" not in notice for notice in scene.notices)
    assert loaded > 150


# polygons

RING = [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]  # a hole, reached by a bridge to and fro
ARROW = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)]
COMB = [(0, 0), *((x, y) for i in range(8) for x, y in ((2 * i, 5), (2 * i + 1, 1))), (16, 0)]


@pytest.mark.parametrize(
    ("outline", "area"),
    [
        (RING, 8.0),
        (ARROW, 7.0),
        (COMB, None),
        ([(0, 0), (2, 1), (4, 0), (2, 5)], 8.0),  # concave at 1: not the diagonal from 0
        ([(0, 0), (4, 0), (1, 1), (0, 4)], 4.0),
        ([(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)], 4.0),  # corners in one line
        ([(math.cos(t), math.sin(t)) for t in np.arange(60) * math.pi / 30], None),
    ],
)
@pytest.mark.parametrize("turn", [0, 1, 3])
def test_polygons_are_covered_once(outline, area, turn):
    # in a tilted plane; the triangles' area vectors add up to the polygon's (the shoelace formula), and so do their lengths
    flat = np.roll(np.array(outline, float), turn, axis=0)
    x, y = flat.T
    shoelace = 0.5 * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    assert area is None or shoelace == pytest.approx(area)
    points = flat @ np.array([[1, 2, 2], [2, 1, -2]]) / 3.0
    triangles, owner = triangulate(points, np.arange(len(points)), np.array([len(points)]))
    a, b, c = (points[triangles[:, i]] for i in range(3))
    vectors = 0.5 * np.cross(b - a, c - a)
    assert np.linalg.norm(vectors.sum(0)) == pytest.approx(shoelace) and np.linalg.norm(vectors, axis=1).sum() == pytest.approx(
        shoelace
    )
    assert (owner == 0).all()


def test_polygons_keep_the_order_of_the_file(obj):
    # a concave pentagon between triangles, in a file: its triangles lie between theirs
    text = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3\nf 1 2 3 4 5\nf 1 2 5\n"
    sizes = areas(obj(text).meshes[0])[:, 2]
    assert len(sizes) == 5 and sizes[0] == 8 and sizes[-1] == 8 and sizes[1:-1].sum() == 16 - 6


# normals


def fold(degrees: float) -> str:
    """Two squares that meet at an angle along the z axis, without normals."""
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


def test_a_sphere_without_normals_is_round_and_a_cube_is_sharp(obj):
    # 24 × 12 quads with a seam of doubled vertices: within 2° of the radius; a cube keeps four vertices a side
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0.2, np.pi - 0.2, 13))
    points = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], 2).reshape(-1, 3).round(6)
    text = "".join("v {} {} {}\n".format(*p) for p in points)
    text += "".join(f"f {i} {i + 25} {i + 26} {i + 1}\n" for r in range(12) for i in range(25 * r + 1, 25 * r + 25))
    mesh = obj(text).meshes[0]
    inside = np.abs(mesh.positions[:, 2]) < 0.95
    assert (mesh.normals * mesh.positions).sum(1)[inside].min() > math.cos(math.radians(2))
    cube = "".join(f"v {i & 1} {i >> 1 & 1} {i >> 2}\n" for i in range(8))
    cube += "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
    mesh = obj(cube).meshes[0]
    assert mesh.closed and len(mesh.positions) == 24 and (np.abs(mesh.normals).max(1) == 1).all()


def test_smoothing_that_is_off_and_normals_that_are_given_win(obj):
    text = fold(30).replace("f 1", "s off\nf 1").replace("f 2", "s 0\nf 2")
    assert len(obj(text).meshes[0].positions) == 12
    given = "vn 0 1 0\n" + fold(30).replace("f 1 4 5 2", "f 1//1 4//1 5//1 2//1")
    normals = obj(given).meshes[0].normals  # the other square's edge is at 30°
    assert (np.abs(normals - [0, 1, 0]).max(1) < 1e-7).sum() == 4


def test_many_triangles_at_one_vertex_are_no_hang(obj):
    # a cone of 3000 sides: its tip alone has 9 million pairs of corners
    t = np.arange(3000) * 2 * np.pi / 3000
    text = "v 0 0 3\n" + "".join(f"v {x} {y} 0\n" for x, y in zip(np.cos(t), np.sin(t), strict=True))
    text += "".join(f"f 1 {i + 2} {(i + 1) % 3000 + 2}\n" for i in range(3000))
    begin = time.process_time()
    assert obj(text).triangles == 3000 and time.process_time() - begin < 2


# groups, colours, coordinates, encodings


def test_groups_and_objects_become_meshes_of_their_name(obj):
    text = SQUARE + "f 1 2 3\no chair\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\ng seat  left\nf 1 3 4\no chair\nusemtl a\nf 1 3 4\n"
    found = {mesh.name: len(mesh.faces) for mesh in obj(text).meshes}
    assert found == {"a": 1, "chair a": 2, "chair b": 1, "seat left": 1}


def test_more_groups_than_400_are_merged_by_material(obj):
    text = SQUARE + "".join(f"g part{i}\nusemtl m{i % 3}\nf 1 2 3\n" for i in range(20_000))
    begin = time.process_time()
    scene = obj(text)
    assert [mesh.name for mesh in scene.meshes] == ["m0", "m1", "m2"] and scene.triangles == 20_000
    assert time.process_time() - begin < 2


@pytest.mark.parametrize(("scale", "form"), [(1, "{:.4f}"), (255, "{:.1f}")])
def test_vertex_colours_are_srgb_in_either_range(obj, scale, form):
    values = np.array([[0.5, 0, 1], [1, 1, 1], [0.25, 0.75, 0.1], [0, 0, 0.6]])
    rows = [line + " " + " ".join(form.format(x) for x in c * scale) for line, c in zip(SQUARE.splitlines(), values, strict=True)]
    mesh = obj("\n".join(rows) + "\nf 1 2 3 4\n").meshes[0]
    at = {tuple(p): i for i, p in enumerate(mesh.positions.tolist())}
    order = [at[tuple(map(float, line.split()[1:]))] for line in SQUARE.splitlines()]
    assert mesh.colors is not None
    np.testing.assert_allclose(mesh.colors[order], linear_from_srgb(values), atol=2e-3 if scale > 1 else 1e-4)


def test_what_stands_behind_positions_may_be_no_colour(obj):
    for text in (SQUARE.replace(" 0\n", " 0 0 -1 0\n"), SQUARE.replace(" 0\n", " 0 1.0\n"), SQUARE.replace(" 0\n", " 0 1 1 1\n")):
        assert obj(text + "f 1 2 3 4\n").meshes[0].colors is None


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "cp1252", "utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_every_encoding_is_read(obj, tmp_path, encoding):
    (tmp_path / "Möbel.mtl").write_bytes("newmtl Stühle rot\nKd 1 0 0\n".encode(encoding))
    scene = obj(f"mtllib Möbel.mtl\n{SQUARE}usemtl Stühle rot\nf 1 2 3\n".encode(encoding))
    assert (scene.meshes[0].name, scene.meshes[0].material.albedo) == ("Stühle rot", (1, 0, 0)) and not remarks(scene)


@pytest.mark.parametrize(
    "written",
    [
        "My Colours.mtl",
        "./my colours.MTL",
        "sub\\My Colours.mtl",
        "C:\\work\\My Colours.mtl",
        "My%20Colours.mtl",
        "b.mtl My Colours.mtl",
        "gone.mtl",
    ],
)
def test_material_files_are_found_under_other_names(obj, tmp_path, written):
    # the last is missing: one that is called like the .obj is read instead
    (tmp_path / ("a.mtl" if written == "gone.mtl" else "My Colours.mtl")).write_text("newmtl Red\nKd 1 0 0\n")
    (tmp_path / "b.mtl").write_text("newmtl other\nKd 0 1 0\n")
    scene = obj(f"mtllib {written}\n{SQUARE}usemtl red\nf 1 2 3\n")
    assert scene.meshes[0].material.albedo == (1, 0, 0)
    assert remarks(scene).count("\n") == 0 and ("'a.mtl' is read instead" in remarks(scene)) == (written == "gone.mtl")


def test_an_unknown_material_and_a_missing_library_are_grey_and_told_once(obj, tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 0 0\n")
    scene = obj(f"mtllib m.mtl\n{SQUARE}usemtl x\nf 1 2 3\nusemtl y\nf 1 2 3\nusemtl a\nf 1 2 3\n")
    assert [mesh.material.albedo for mesh in scene.meshes] == [(0.5, 0.5, 0.5)] * 2 + [(1, 0, 0)]
    assert remarks(scene).endswith("no material file knows 'x' and 1 more; grey 0.5 stands in")
    scene = obj(f"mtllib gone.mtl\n{SQUARE}usemtl x\nf 1 2 3\n")
    assert scene.meshes[0].material.albedo == (0.5, 0.5, 0.5) and remarks(scene).endswith("'gone.mtl'; its colours are 0.5")


def test_a_large_file_with_many_materials_and_groups_loads_in_seconds(obj, tmp_path):
    # 100 000 triangles in 250 groups and materials; the time of the first reader grew with materials × vertices (some 5 s here)
    rows = ["mtllib a.mtl\n"]
    for part in range(250):
        rows += [f"o part{part}\nusemtl m{part}\n"]
        rows += [f"v {x} {y} {part}\nvt {x / 15} {y / 15}\nvn 0 0 1\n" for y in range(15) for x in range(15)]
        base = 225 * part + 1
        quads = [base + 15 * y + x for y in range(14) for x in range(14)]
        rows += [f"f {i}/{i}/{i} {i + 1}/{i + 1}/{i + 1} {i + 16}/{i + 16}/{i + 16}\n" for i in quads]
        rows += [f"f {i}/{i}/{i} {i + 16}/{i + 16}/{i + 16} {i + 15}/{i + 15}/{i + 15}\n" for i in quads]
    (tmp_path / "a.mtl").write_text("".join(f"newmtl m{i}\nKd {i / 250} 0 0\n" for i in range(250)))
    (tmp_path / "a.obj").write_text("".join(rows))
    begin = time.process_time()
    scene = load(tmp_path / "a.obj")
    assert time.process_time() - begin < 3
    assert len(scene.meshes) == 250 and scene.triangles == 250 * 392 and scene.meshes[9].material.albedo == (9 / 250, 0, 0)
    assert all(len(mesh.positions) == 225 for mesh in scene.meshes)


def test_a_scene_reads_the_same_triangles_strictly_and_forgivingly(tmp_path):
    (tmp_path / "a.obj").write_text(f"{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1 4//1\nf 1 2 3\n")
    one, other = load_obj(tmp_path / "a.obj"), load_obj(tmp_path / "a.obj", strict=False)
    for name in ("positions", "normals", "corners", "corner_normals"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
