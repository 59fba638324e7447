"""Meshes from OBJ, PLY, STL and glTF: geometry, colours and normals of the file, and one line for a damaged file."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import Scene, load
from tests.support.gltf_files import FACES, POINTS, GltfFile

pytestmark = pytest.mark.usefixtures("without_stand_ins")

Write = Callable[[str, bytes | str], Scene]
NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
PLY = """ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z
property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 4\nproperty list uchar int vertex_indices\nend_header
0 0 0 0 0 0\n1 0 0 255 255 255\n0 1 0 188 0 0\n0 0 1 0 0 10\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"""
FLAT = np.array([*POINTS[:3], [0.5, 0.5, 0]], np.float32)  # the slanted face of these points has no area


def solid(points: np.ndarray = POINTS, **node: Any) -> GltfFile:
    """Return a glTF file of the tetrahedron."""
    file = GltfFile()
    file.node(mesh=file.mesh(POSITION=points), **node)
    return file


def stl(triangles: np.ndarray) -> bytes:
    """Return a binary STL of triangles (F, 3, 3)."""
    rows = np.zeros(len(triangles), [("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("rest", "<u2")])
    rows["vertices"] = triangles
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + rows.tobytes()


def ascii_stl() -> str:
    """Return the tetrahedron as text."""

    def facet(face: np.ndarray) -> str:
        corners = "".join("vertex {:g} {:g} {:g}\n".format(*POINTS[i]) for i in face)
        return f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n"

    return "solid thing\n" + "".join(map(facet, FACES)) + "endsolid thing\n"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a file and load it."""

    def write(name: str, data: bytes | str) -> Scene:
        (tmp_path / name).write_bytes(data.encode() if isinstance(data, str) else data)
        return load(tmp_path / name)

    return write


OBJ = "".join("v {:g} {:g} {:g}\n".format(*p) for p in POINTS) + "".join("f {} {} {}\n".format(*(f + 1)) for f in FACES)
TREE = solid().inline()
EVERY: dict[str, bytes] = {  # file name: content
    "a.obj": OBJ.encode(),
    "a.ply": PLY.encode(),
    "a.stl": stl(POINTS[FACES]),
    "b.stl": ascii_stl().encode(),
    "a.gltf": json.dumps(TREE).encode(),
    "A.GLB": solid().packed(),
}


@pytest.mark.parametrize("name", EVERY)
def test_each_format_gives_the_same_solid_with_face_normals(write: Write, name: str) -> None:
    """A tetrahedron, outward: closed, 4 flat triangles; the slanted one's normal is (1 1 1)/√3."""
    scene = write(name, EVERY[name])
    (mesh,) = scene.meshes
    assert mesh.closed and scene.triangles == 4 and len(mesh.positions) == 12
    np.testing.assert_array_equal(scene.bounds, [[0, 0, 0], [1, 1, 1]])
    edges = mesh.positions[mesh.faces]
    cross = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    flat = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals[mesh.faces], np.repeat(flat[:, None], 3, axis=1), atol=1e-6)
    assert (np.abs(flat - 1 / math.sqrt(3)) < 1e-6).all(1).any()
    assert mesh.material.albedo == (0.5, 0.5, 0.5) and len(scene.cameras) == 1 and scene.sky == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.ply", PLY.replace("3 1 2 3\n", ""), "truncated|no PLY"),
        ("a.ply", PLY.replace("uchar red", "uchur red"), "this is no line of a PLY header: 'property uchur red'"),
        ("a.ply", PLY.replace("format ascii 1.0\n", ""), "no 'format' line"),
        ("a.ply", PLY.replace("float x", "float a"), "no vertices"),
        ("a.obj", b"\0\0\0\1v\n" * 99, "this is binary data"),  # object code of a compiler
        ("a.ply", PLY.replace("ply", "plx"), "no PLY"),
        ("a.ply", "", "the file is empty"),
        ("a.ply", PLY.replace("element vertex 4", "element vertex 99999999999"), "truncated"),
        ("a.ply", PLY.replace("element face 4", "element face 0"), "no faces"),
        ("a.ply", PLY.replace("0 0 0 0 0 0", "nan 0 0 0 0 0").replace("3 1 2 3", "3 0 2 3"), "a.ply: "),
        ("a.ply", PLY.replace("0 0 1 0 0 10", "0 0 1 0"), "truncated"),
        ("b.stl", ascii_stl().rpartition("endfacet")[0], "this is no STL file, or a truncated one"),
        ("a.stl", stl(POINTS[FACES] * np.nan), "a.stl: "),
        *(("a.obj", text, "OBJ|no faces") for text in ("hello\nworld\n", "v 0 0 0\n", "f 1 2 3\n", "v\nf\n\0\n", "l 1 2\n")),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2\nf 7 8 9\n", "no faces"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no triangle in this file has an area; nothing"),
        ("a.gltf", solid(POINTS * FLAT[1]).inline(), "no triangle in this file has an area; nothing"),
        ("a.glb", solid().packed().replace(b"glTF\2", b"glTF\1"), "this is glTF 1.0; expected version 2.0"),
        ("a.glb", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "run 'git lfs pull'"),
        ("a.gltf", {"asset": {"version": "2.0"}}, "there are no meshes in this file; nothing"),
        ("a.gltf", {**TREE, "scene": 0, "scenes": [{}]}, "none of the 1 meshes in this file is in its scene; nothing"),
        ("a.gltf", solid(scale=[1, 0, 0]).inline(), "its scale is 0"),
        ("a.gltf", {**TREE, "asset": {"version": "1.0"}}, "glTF 1.0"),
        ("a.gltf", {**TREE, "asset": None}, "no glTF"),
        ("a.gltf", {**TREE, "buffers": [{"byteLength": 10, "uri": "gone.bin"}]}, "gone.bin is missing"),
        ("a.gltf", {**TREE, "buffers": [{"byteLength": 10}]}, "its binary chunk is missing"),
        ("a.gltf", {**TREE, "buffers": [{"byteLength": 10, "uri": "data:;base64,A"}]}, "a data URI is damaged"),
        ("a.gltf", {**TREE, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}]}, "only points"),
        ("a.gltf", {**TREE, "meshes": [{"primitives": [{"attributes": {"POSITION": 9}, "indices": 1}]}]}, "a.gltf: "),
        ("a.gltf", {**TREE, "meshes": [{"primitives": [{"attributes": {}}]}]}, "a.gltf: "),
    ],
)  # fmt: skip
def test_a_file_with_nothing_to_show_is_one_line(write: Write, name: str, data: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        write(name, json.dumps(data) if isinstance(data, dict) else data)
    assert re.search(rf"{name}(:\d+)?: ", str(caught.value)) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "data", "left", "message"),
    [
        ("a.obj", OBJ + "f 1 1 2\n", 4, "1 degenerate triangle dropped"),
        ("a.ply", PLY.replace("element face 4", "element face 5") + "3 1 1 2\n", 4, "1 degenerate triangle dropped"),
        ("a.stl", stl(FLAT[FACES]), 3, "1 degenerate triangle dropped"),
        ("b.stl", ascii_stl().replace("vertex 0 0 1", "vertex 0.5 0.5 0"), 3, "1 degenerate triangle dropped"),
        ("a.glb", solid(FLAT).packed(), 3, "1 degenerate triangle dropped"),
        ("a.ply", PLY.replace("0 0 1 0 0 10", "0 inf nan 0 0 10"), 1, "3 .*left out"),
        ("a.ply", PLY.replace("3 0 1 3\n3 0 3 2\n3 1 2 3\n", "3 0 1 4\n3 0 -1 2\n2 1 2\n"), 1, "3 .*left out"),
        ("a.stl", stl(np.array([*POINTS[:3], [0, np.nan, np.inf]], np.float32)[FACES]), 1, "3 .*left out"),
    ],
)
def test_faces_that_cant_be_drawn_are_left_out_with_one_notice(
    write: Write, name: str, data: bytes | str, left: int, message: str
) -> None:
    """A face without an area; or three of the four faces have the fourth vertex, which is invalid or missing."""
    scene = write(name, data)
    assert scene.triangles == left and sum(bool(re.search(message, notice)) for notice in scene.notices) == 1


def test_ply_vertex_colours_become_linear(write: Write) -> None:
    """sRGB 188 is linear 0.5 (0.5029); 10/255 lies on the straight part: /12.92."""
    mesh = write("a.ply", PLY).meshes[0]
    assert mesh.colors is not None
    by_place = {tuple(p): c for p, c in zip(mesh.positions.tolist(), mesh.colors.tolist(), strict=True)}
    assert by_place[1, 0, 0] == [1, 1, 1] and by_place[0, 0, 0] == [0, 0, 0]
    assert by_place[0, 1, 0] == pytest.approx([0.5029, 0, 0], abs=1e-4)
    assert by_place[0, 0, 1] == pytest.approx([0, 0, 10 / 255 / 12.92])


def test_ply_colours_of_faces_are_reported(write: Write) -> None:
    colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    head, _, _ = PLY.replace(colours, "").replace("indices\n", f"indices\n{colours}").partition("0 0 0 0 0 0")
    rows = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1 9 9 9\n3 0 1 3 9 9 9\n3 0 3 2 9 9 9\n3 1 2 3 9 9 9\n"
    scene = write("a.ply", head + rows)
    assert scene.triangles == 4 and any("the colours of the faces are not shown" in notice for notice in scene.notices)


def test_ply_normals_are_kept(write: Write) -> None:
    text = PLY.partition("0 0 0 0 0 0")[0]
    for i, colour in enumerate(("red", "green", "blue")):
        text = text.replace(f"uchar {colour}", f"float n{'xyz'[i]}")
    rows = [" ".join(f"{x:g}" for x in (*p, *n)) for p, n in zip(POINTS, NORMALS, strict=True)]
    mesh = write("a.ply", text + "\n".join(rows) + "\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n").meshes[0]
    assert len(mesh.positions) == 4 and mesh.colors is None
    by_place = {tuple(p): n for p, n in zip(mesh.positions.tolist(), mesh.normals.tolist(), strict=True)}
    assert by_place == {tuple(p): n for p, n in zip(POINTS.tolist(), NORMALS.tolist(), strict=True)}


QUADS = """ply\nformat {format} 1.0\ncomment TextureFile gone.png\nelement vertex 5
property float x\nproperty float y\nproperty float z
property float s\nproperty float t\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"""
ROWS = [(0, 0, 0, 0, 0), (1, 0, 0, 0.5, 0), (1, 1, 0, 0.5, 0.25), (0, 1, 0, 0, 0.25), (0.5, 2, 0, 0, 1)]


def quads(form: str) -> bytes:
    """Return a square with a triangle on it: rows of different lengths."""
    head = QUADS.format(format=form).encode()
    if form == "ascii":
        rows = "".join(" ".join(map(str, row)) + "\n" for row in ROWS)
        return head + rows.encode() + b"4 0 1 2 3\ncomment odd\n\n3 3 2 4 9 9\n"
    order = "<" if "little" in form else ">"
    vertices = b"".join(struct.pack(f"{order}5f", *row) for row in ROWS)
    return head + vertices + struct.pack(f"{order}B4iB3i", 4, 0, 1, 2, 3, 3, 3, 2, 4)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_polygons_of_several_sizes(write: Write, form: str) -> None:
    scene = write("a.ply", quads(form))
    assert scene.triangles == 3 and any("the textures of this PLY file are not shown" in notice for notice in scene.notices)
    data = quads(form)
    for cut in (len(data) - 30, len(data) - 13, len(data) - 10):
        with pytest.raises(InputError, match="truncated"):
            write("a.ply", data[:cut])


@pytest.mark.parametrize("line", ["\ncomment by hand\n", "element edge 3\nproperty int a\n"])
def test_an_odd_ply_is_whole(write: Write, tmp_path: Path, line: str) -> None:
    """Four separate triangles, with white where three of them meet; lines, which are missing and not drawn."""
    write("a.ply", PLY.replace("end_header", line + "end_header"))
    scene = load(tmp_path / "a.ply", crease_angle=0.0)
    (mesh,) = scene.meshes
    assert scene.triangles == 4 and mesh.colors is not None and np.count_nonzero(mesh.colors[:, 1] == 1.0) == 3


def test_binary_faces_whose_rows_grow_are_read_one_by_one(write: Write) -> None:
    """A triangle, then a square, each with its own count; and a notice on the colours of an STL."""
    head = QUADS.format(format="binary_little_endian")
    head = head.replace("element face 2\n", "element face 2\nproperty int id\n")
    rows = b"".join(struct.pack("<5f", *row) for row in ROWS) + struct.pack("<iB3iiB4i", 7, 3, 3, 2, 4, 8, 4, 0, 1, 2, 3)
    assert write("a.ply", head.encode() + rows).triangles == 3
    colored = write("a.stl", b"COLOR=\xff\0\0\xff".ljust(80) + EVERY["a.stl"][80:])
    assert any("the colours of this STL file are not shown" in notice for notice in colored.notices)


def test_an_stl_is_smooth_where_it_bends_a_little(write: Write, tmp_path: Path) -> None:
    """A drum of 32 sides (11.25° each): one normal at each place of its wall, and 32 more on each lid."""
    t = np.arange(33) % 32 * 2 * np.pi / 32
    x, y = np.cos(t), np.sin(t)
    triangles: list[tuple[tuple[float, ...], ...]] = []
    for i in range(32):
        low, high, low2, high2 = ((x[k], y[k], z) for k in (i, i + 1) for z in (0, 1))
        triangles += [(low, low2, high2), (low, high2, high), ((0, 0, 0), low2, low), ((0, 0, 1), high, high2)]
    (mesh,) = write("a.stl", stl(np.array(triangles))).meshes
    assert len(mesh.positions) == 4 * 32 + 2 and mesh.closed
    wall = np.abs(mesh.normals[:, 2]) < 0.5
    np.testing.assert_allclose(mesh.normals[wall][:, :2], mesh.positions[wall][:, :2], atol=1e-5)
    assert len(load(tmp_path / "a.stl", crease_angle=0).meshes[0].positions) == 3 * len(triangles)
