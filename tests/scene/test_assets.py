"""Meshes from OBJ, PLY, STL and glTF: geometry, colours and normals as the file has them, and one line for a damaged file."""

from __future__ import annotations

import base64
import json
import math
import random
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import load

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)  # a tetrahedron, wound outward
NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
PLY = """ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z
property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 4\nproperty list uchar int vertex_indices\nend_header
0 0 0 0 0 0\n1 0 0 255 255 255\n0 1 0 188 0 0\n0 0 1 0 0 10\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"""


def gltf(material: dict[str, Any] | None = None, node: dict[str, Any] | None = None, **attributes: np.ndarray) -> dict[str, Any]:
    """A glTF tree that holds the tetrahedron, with one more vertex attribute for each keyword; its buffer is inline."""
    arrays = {"POSITION": POINTS, **attributes}
    data, views, accessors = b"", [], []
    for array in (*arrays.values(), FACES):
        kind = {"f": 5126, "B": 5121, "I": 5125}[array.dtype.char]
        shape = "SCALAR" if array is FACES else {3: "VEC3", 4: "VEC4"}[array.shape[1]]
        count = array.size if array is FACES else len(array)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": kind, "count": count, "type": shape})
        data += array.tobytes()
    accessors[0] |= {"min": [0, 0, 0], "max": [1, 1, 1]}
    primitive: dict[str, Any] = {"attributes": {name: i for i, name in enumerate(arrays)}, "indices": len(arrays)}
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"mesh": 0, **(node or {})}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
    }
    if material is not None:
        primitive["material"] = 0
        tree["materials"] = [material]
    return tree


def glb(tree: dict[str, Any]) -> bytes:
    """The same as a GLB, its buffer in a chunk of its own."""
    buffer = dict(tree["buffers"][0])
    data = base64.b64decode(buffer.pop("uri").split(",")[1])
    text = json.dumps({**tree, "buffers": [buffer]}).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def stl(points: np.ndarray = POINTS) -> bytes:
    rows = np.zeros(len(FACES), [("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("rest", "<u2")])
    rows["vertices"] = points[FACES]
    return b"\0" * 80 + struct.pack("<I", len(FACES)) + rows.tobytes()


def ascii_stl() -> str:
    def facet(face: np.ndarray) -> str:
        corners = "".join("vertex {:g} {:g} {:g}\n".format(*POINTS[i]) for i in face)
        return f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n"

    return "solid thing\n" + "".join(map(facet, FACES)) + "endsolid thing\n"


@pytest.fixture
def write(tmp_path: Path):
    def write(name: str, data: bytes | str | dict[str, Any]):
        data = json.dumps(data) if isinstance(data, dict) else data
        (tmp_path / name).write_bytes(data.encode() if isinstance(data, str) else data)
        return load(tmp_path / name)

    return write


EVERY: dict[str, Any] = {  # file name: content
    "a.obj": "".join("v {:g} {:g} {:g}\n".format(*p) for p in POINTS) + "".join("f {} {} {}\n".format(*(f + 1)) for f in FACES),
    "a.ply": PLY,
    "a.stl": stl(),
    "b.stl": ascii_stl(),
    "a.gltf": json.dumps(gltf()),
    "a.glb": glb(gltf()),
    "A.GLB": glb(gltf()),
}


@pytest.mark.parametrize("name", EVERY)
def test_each_format_gives_the_same_solid_with_face_normals(write, name):
    # a tetrahedron, outward: closed, 4 flat triangles; the slanted one's normal is (1 1 1)/√3
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
    assert (mesh.positions.dtype, mesh.normals.dtype, mesh.faces.dtype) == (np.float32, np.float32, np.int32)


# OBJ and its materials


def test_mtl_colours_group_the_faces(write, tmp_path):
    # Kd is clipped to 1, one value stands for three, Ke is emission; a name that the library lacks is 0.5
    (tmp_path / "m.mtl").write_text("# b\nnewmtl red one\nKd 1.5 0.2 0\nNs 10\nnewmtl lamp\nKd 0.25\nKe 3 2 1\n")
    text = EVERY["a.obj"].replace("f", "usemtl red one\nf", 1).replace("f 2 3 4", "usemtl lamp\nf 2 3 4\nusemtl other\nf 1 2 3")
    scene = write("a.obj", "mtllib m.mtl\nmtllib gone.mtl\n" + text)
    found = {mesh.name: (mesh.material.albedo, mesh.material.emission, len(mesh.faces)) for mesh in scene.meshes}
    assert found["red one"] == ((1.0, 0.2, 0.0), (0, 0, 0), 3)
    assert found["lamp"] == ((0.25, 0.25, 0.25), (3, 2, 1), 1)
    assert found["other"] == ((0.5, 0.5, 0.5), (0, 0, 0), 1)
    assert scene.sky == (0, 0, 0) and any("gone.mtl" in notice for notice in scene.notices)


# PLY


def test_ply_vertex_colours_become_linear(write):
    # sRGB 188 is linear 0.5 (0.5029); 10/255 lies on the straight part: /12.92
    mesh = write("a.ply", PLY).meshes[0]
    by_place = {tuple(p): c for p, c in zip(mesh.positions.tolist(), mesh.colors.tolist(), strict=True)}
    assert by_place[1, 0, 0] == [1, 1, 1] and by_place[0, 0, 0] == [0, 0, 0]
    assert by_place[0, 1, 0] == pytest.approx([0.5029, 0, 0], abs=1e-4)
    assert by_place[0, 0, 1] == pytest.approx([0, 0, 10 / 255 / 12.92])


def test_ply_normals_are_kept(write):
    text = PLY.replace("uchar red", "float nx").replace("uchar green", "float ny").replace("uchar blue", "float nz")
    rows = [" ".join(f"{x:g}" for x in (*p, *n)) for p, n in zip(POINTS, NORMALS, strict=True)]
    head, _, _ = text.partition("0 0 0 0 0 0")
    mesh = write("a.ply", head + "\n".join(rows) + "\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n").meshes[0]
    assert len(mesh.positions) == 4 and mesh.colors is None
    order = [int(np.flatnonzero((p == POINTS).all(1))[0]) for p in mesh.positions]
    np.testing.assert_array_equal(mesh.normals, NORMALS[order])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("3 1 2 3\n", "", "truncated|no PLY"),
        ("uchar red", "uchur red", "this is no line of a PLY header: 'property uchur red'"),
        ("format ascii 1.0\n", "", "no 'format' line"),
        ("float x", "float a", "no vertices"),
        ("ply", "plx", "no PLY"),
        ("element vertex 4", "element vertex 99999999999", "truncated"),
        ("element face 4", "element face 0", "no faces"),
        ("end_header", "", "no PLY"),
    ],
)  # fmt: skip
def test_a_damaged_ply_is_one_line(write, old, new, says):
    with pytest.raises(InputError, match=says) as caught:
        write("a.ply", PLY.replace(old, new))
    assert re.search(r"a\.ply(:\d+)?: ", str(caught.value)) and "\n" not in str(caught.value)


# glTF


def test_gltf_instances_and_primitives_keep_their_own_materials(write):
    tree = gltf({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}})
    tree["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}})
    tree["meshes"][0]["primitives"].append({**tree["meshes"][0]["primitives"][0], "material": 1})
    tree["nodes"] = [{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}]
    scene = write("a.gltf", tree)
    found = sorted((m.material.albedo, float(m.positions[:, 0].min())) for m in scene.meshes)
    assert found == [((0, 1, 0), 0.0), ((0, 1, 0), 5.0), ((1, 0, 0), 0.0), ((1, 0, 0), 5.0)]


def test_a_file_without_anything_to_show_says_so(write):
    tree = gltf({}, {"scale": [1, 1, 1]})
    hidden = {**tree, "nodes": [{"mesh": 0}, {"translation": [0, 0, 0]}], "scenes": [{"nodes": [1]}], "scene": 0}
    flat = {**tree, "nodes": [{"mesh": 0, "scale": [1, 0, 0]}], "scenes": [{"nodes": [0]}]}
    for name, data, says in (
        ("a.gltf", {"asset": {"version": "2.0"}}, "there are no meshes in this file; nothing"),
        ("a.gltf", hidden, "none of the 1 meshes in this file is in its scene; nothing"),
        ("a.gltf", flat, "scaled to nothing"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no triangle in this file has an area; nothing"),
    ):
        with pytest.raises(InputError, match=says) as caught:
            write(name, data)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"asset": {"version": "1.0"}}, "glTF 1.0"),
        ({"asset": None}, "no glTF"),
        ({"buffers": [{"byteLength": 10, "uri": "gone.bin"}]}, "gone.bin is missing"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 9}, "indices": 1}]}]}, "a.gltf: "),
        ({"meshes": [{"primitives": [{"attributes": {}}]}]}, "a.gltf: "),
        ({"nodes": [{"mesh": 7}]}, "a.gltf: "),
        ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "a.gltf: "),
    ],
)  # fmt: skip
def test_a_damaged_gltf_is_one_line(write, change, says):
    with pytest.raises(InputError, match=says) as caught:
        write("a.gltf", {**gltf(), **change})
    assert "a.gltf: " in str(caught.value) and "\n" not in str(caught.value)


# every format


@pytest.mark.parametrize("name", EVERY)
def test_degenerate_triangles_are_dropped_with_a_notice(write, name):
    if name == "a.obj":
        data: bytes | str = EVERY[name] + "f 1 1 2\n"
    elif name == "a.ply":
        data = PLY.replace("element face 4", "element face 5") + "3 1 1 2\n"
    elif name == "a.stl":
        flat = POINTS.copy()
        flat[3] = 0.5, 0.5, 0  # in the plane of the others, on the edge 1-2: the slanted face has no area
        data = stl(flat)
    elif name == "b.stl":
        data = ascii_stl().replace("vertex 0 0 1", "vertex 0.5 0.5 0")
    else:
        tree = gltf({}, {"scale": [1, 1, 1]})
        flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 0]], np.float32)
        raw = base64.b64decode(tree["buffers"][0]["uri"].split(",")[1])
        raw = flat.tobytes() + raw[flat.nbytes :]
        tree["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(raw).decode()
        data = json.dumps(tree) if name == "a.gltf" else glb(tree)
    scene = write(name, data)
    assert sum("1 degenerate triangle dropped" in notice for notice in scene.notices) == 1
    assert scene.triangles == (4 if name in ("a.obj", "a.ply") else 3)


@pytest.mark.parametrize("name", EVERY)
def test_half_a_file_is_an_error_and_never_half_a_scene(write, name):
    # cut anywhere: an error of one line; only a few bytes off the end (a last newline, padding) may go unnoticed
    data = EVERY[name].encode() if isinstance(EVERY[name], str) else EVERY[name]
    if name == "a.obj":
        pytest.skip("an .obj has no length to compare with; its grammar is tested with the .scene's")
    for size in range(1, len(data) - 2, max(1, len(data) // 40)):
        with pytest.raises(InputError) as caught:
            write(name, data[:size])
        assert f"{name}: " in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", EVERY)
def test_garbage_is_an_error_of_one_line(write, name, capfd, without_stand_ins):
    # random bytes, and true files with a few random bytes in them: loaded or refused, but never a traceback or a warning
    generator = random.Random(7)
    true = EVERY[name].encode() if isinstance(EVERY[name], str) else EVERY[name]
    for _ in range(20):
        with pytest.raises(InputError) as caught:
            write(name, generator.randbytes(300))
        assert "\n" not in str(caught.value)
    for _ in range(60):
        data = bytearray(true)
        for _ in range(generator.randrange(1, 4)):
            data[generator.randrange(len(data))] = generator.randrange(256)
        try:
            scene = write(name, bytes(data))
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert all(np.isfinite(mesh.positions).all() and np.isfinite(mesh.normals).all() for mesh in scene.meshes)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", EVERY)
def test_an_empty_file_is_an_error(write, name):
    with pytest.raises(InputError, match="the file is empty"):
        write(name, b"")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.ply", PLY.replace("0 0 1 0 0 10", "0 0 nan 0 0 10")),
        ("a.ply", PLY.replace("0 0 1 0 0 10", "0 inf 1 0 0 10")),
        ("a.ply", PLY.replace("3 0 1 3\n3 0 3 2\n3 1 2 3\n", "3 0 1 4\n3 0 -1 2\n2 1 2\n")),
        ("a.stl", stl(np.array([*POINTS[:3], [0, 0, np.inf]], np.float32))),
        ("a.stl", stl(np.array([*POINTS[:3], [0, np.nan, 0]], np.float32))),
    ],
)
def test_faces_that_cant_be_drawn_are_left_out_with_one_notice(write, name, data):
    # three of the four faces have the fourth vertex, which is bad, or not there
    scene = write(name, data)
    assert scene.triangles == 1 and sum("3 " in notice and "left out" in notice for notice in scene.notices) == 1


def test_nothing_but_bad_vertices_is_an_error(write):
    bad = PLY.replace("0 0 0 0 0 0", "nan 0 0 0 0 0").replace("3 1 2 3", "3 0 2 3")
    for name, data in (("a.stl", stl(POINTS * np.nan)), ("a.ply", bad)):
        with pytest.raises(InputError, match=rf"{name}: "):
            write(name, data)


# PLY as it is found

QUADS = """ply\nformat {format} 1.0\ncomment TextureFile {image}\nelement vertex 5
property float x\nproperty float y\nproperty float z
property float s\nproperty float t\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"""
ROWS = [(0, 0, 0, 0, 0), (1, 0, 0, 0.5, 0), (1, 1, 0, 0.5, 0.25), (0, 1, 0, 0, 0.25), (0.5, 2, 0, 0, 1)]


def quads(form: str, image: str = "gone.png") -> bytes:
    """A square and a triangle on it: rows of different lengths."""
    head = QUADS.format(format=form, image=image).encode()
    if form == "ascii":
        return (
            head + "".join(" ".join(map(str, row)) + "\n" for row in ROWS).encode() + b"4 0 1 2 3\ncomment odd\n\n3 3 2 4 9 9\n"
        )
    order = "<" if "little" in form else ">"
    return (
        head
        + b"".join(struct.pack(f"{order}5f", *row) for row in ROWS)
        + struct.pack(f"{order}B4iB3i", 4, 0, 1, 2, 3, 3, 3, 2, 4)
    )


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_polygons_of_several_sizes_wear_their_texture(write, tmp_path, form):
    # v runs downward from the image's top: t 0.25 is v 0.75
    from PIL import Image

    scene = write("a.ply", quads(form))
    assert scene.triangles == 3 and any("there is no image 'gone.png'" in notice for notice in scene.notices)
    Image.new("RGB", (4, 2), (255, 0, 0)).save(tmp_path / "My Skin.png")
    (mesh,) = write("a.ply", quads(form, "my%20skin.PNG")).meshes
    assert mesh.material.albedo == (1, 1, 1) and mesh.material.albedo_texture.image.pixels.shape == (2, 4, 4)
    by_place = {tuple(p[:2]): uv for p, uv in zip(mesh.positions.tolist(), mesh.uvs.tolist(), strict=True)}
    assert by_place == {
        (0, 0): [0, 1, 0, 0],
        (1, 0): [0.5, 1, 0, 0],
        (1, 1): [0.5, 0.75, 0, 0],
        (0, 1): [0, 0.75, 0, 0],
        (0.5, 2): [0] * 4,
    }
    data = quads(form)
    for cut in range(len(data) - 30, len(data) - (7 if form == "ascii" else 0), 3):
        with pytest.raises(InputError, match="truncated"):
            write("a.ply", data[:cut])


def test_ply_corners_may_have_coordinates_of_their_own(write, tmp_path):
    from PIL import Image

    Image.new("RGB", (2, 2)).save(tmp_path / "t.png")
    text = PLY.replace("comment", "").replace("format ascii 1.0\n", "format ascii 1.0\ncomment TextureFile t.png\n")
    text = text.replace("vertex_indices\n", "vertex_indices\nproperty list uchar float texcoord\n")
    for row in ("3 0 2 1", "3 0 1 3", "3 0 3 2", "3 1 2 3"):
        text = text.replace(f"\n{row}\n", f"\n{row} 6 0 0 1 0 0 1\n")
    mesh = write("a.ply", text).meshes[0]
    np.testing.assert_allclose(mesh.uvs[mesh.faces][:, :, :2], [[[0, 1], [1, 1], [0, 0]]] * 4)


def test_ply_strips_turn_every_other_triangle(write):
    # a strip 0 1 2 3, then a gap, then a strip 3 2 4: all are wound counter-clockwise seen from +z
    text = """ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z
element tristrips 1
property list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0.5 2 0\n8 0 1 2 3 -1 2 3 4\n"""
    (mesh,) = write("a.ply", text).meshes
    a, b, c = (mesh.positions[mesh.faces[:, i]] for i in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a)[:, 2], [1, 1, 1])


def test_colours_and_comments_of_an_stl_are_told_or_ignored(write):
    assert any("colours" in notice for notice in write("a.stl", b"COLOR=\xff\0\0\xff".ljust(80) + stl()[80:]).notices)
    assert write("a.stl", "# note\n" + ascii_stl().replace("\n", " # note\n")).triangles == 4


def test_an_stl_is_smooth_where_it_bends_a_little(write, tmp_path):
    # a drum of 32 sides (11.25° each): one normal at each place of its wall, and 32 more on each lid
    t = np.arange(33) * 2 * np.pi / 32
    x, y = np.cos(t).astype(np.float32), np.sin(t).astype(np.float32)
    x[-1], y[-1] = x[0], y[0]
    triangles = []
    for i in range(32):
        low, high, low2, high2 = ((x[k], y[k], z) for k in (i, i + 1) for z in (0, 1))
        triangles += [(low, low2, high2), (low, high2, high), ((0, 0, 0), low2, low), ((0, 0, 1), high, high2)]
    rows = np.zeros(len(triangles), [("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("rest", "<u2")])
    rows["vertices"] = triangles
    data = b"\0" * 80 + struct.pack("<I", len(rows)) + rows.tobytes()
    (mesh,) = write("a.stl", data).meshes
    assert len(mesh.positions) == 4 * 32 + 2 and mesh.closed
    wall = np.abs(mesh.normals[:, 2]) < 0.5
    np.testing.assert_allclose(mesh.normals[wall][:, :2], mesh.positions[wall][:, :2], atol=1e-5)
    assert len(load(tmp_path / "a.stl", crease_angle=0).meshes[0].positions) == 3 * len(rows)
