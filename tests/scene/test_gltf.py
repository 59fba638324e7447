"""glTF's geometry: all kinds of accessors, nodes, instances, skins, morphs; a damaged part costs only itself."""

from __future__ import annotations

import json
import math
import sys

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import Scene, load
from irrsplat.scene.io.gltf.nodes import transforms
from tests.support.gltf_files import FACES, POINTS, TRIANGLE, GltfFile, f32, typed

pytestmark = pytest.mark.usefixtures("without_stand_ins")

HALF = math.sqrt(0.5)
TURN_X = [HALF, 0, 0, HALF]  # a quarter turn about x: y becomes z
TURN_Z = [0, 0, HALF, HALF]  # about z: x becomes y


def corners(scene: Scene) -> np.ndarray:
    """Return (F, 3, 3) the corners of all triangles."""
    return np.concatenate([mesh.positions[mesh.faces] for mesh in scene.meshes])


@pytest.mark.parametrize(
    ("kind", "most", "rows", "stride"),
    [
        (np.uint8, 255, [[0, 0], [64, 255], [255, 128]], None),
        (np.int8, 127, [[-128, 0], [32, 127], [127, 64]], None),  # -128 counts as -1, glTF 2.0 section 3.11
        (np.int16, 32767, [[0, 0], [8192, 32767], [32767, 16384]], 8),
        (np.int16, None, [[0, 0], [0, 1], [1, 0]], None),
    ],
)
def test_texture_coordinates_of_every_type_are_read(file, show, kind, most, rows, stride):
    expected = np.maximum(np.array(rows) / (most or 1), -1.0)
    first = file.accessor(typed(kind, rows), stride, normalized=most is not None)
    second = file.accessor(f32([[5, 6], [7, 8], [9, 10]]))
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": file.texture(np.zeros((1, 1, 3), np.uint8))}}}
    file.node(mesh=file.mesh(texture, None, POSITION=TRIANGLE, TEXCOORD_0=first, TEXCOORD_1=second))
    (mesh,) = show().meshes
    order = [int(np.flatnonzero((p == TRIANGLE).all(1))[0]) for p in mesh.positions]
    np.testing.assert_allclose(mesh.uvs, np.hstack([expected, [[5, 6], [7, 8], [9, 10]]])[order], atol=1e-6)


@pytest.mark.parametrize("base", [True, False])
def test_sparse_values_replace_those_of_the_view_or_zeros(file, show, base):
    position = file.accessor(f32([[9, 9, 9], [1, 0, 0], [0, 1, 0]]) if base else POINTS[:3])
    accessor = file.tree["accessors"][position]
    new = f32([[0, 0, 5]] if base else [[0, 0, 5], [1, 0, 0], [0, 1, 0]])
    accessor["sparse"] = {
        "count": len(new),
        "indices": {"bufferView": file.view(np.arange(len(new), dtype=np.uint8).tobytes()), "componentType": 5121},
        "values": {"bufferView": file.view(new.tobytes())},
    }
    if not base:
        del accessor["bufferView"]
    file.node(mesh=file.mesh(None, None, POSITION=position))
    np.testing.assert_array_equal(corners(show())[0], [[0, 0, 5], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("mode", "indices", "kind", "faces"),
    [
        (4, [0, 1, 2, 0, 2, 3, 1], np.uint8, [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 2, 3], np.uint16, [[0, 1, 2], [1, 3, 2]]),
        (5, [0, 1, 2, 2, 3, 3, 1, 0], np.uint32, [[0, 1, 2], [3, 0, 1]]),  # two strips with links
        (6, [0, 1, 2, 3], np.uint8, [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_lists_strips_and_fans_make_the_triangles_of_the_standard(file, show, mode, indices, kind, faces):
    file.node(mesh=file.mesh(None, np.array(indices, kind)))
    file.tree["meshes"][0]["primitives"][0]["mode"] = mode
    turned = {tuple(map(tuple, np.roll(c, -int(np.lexsort(c.T)[0]), 0).tolist())) for c in POINTS[np.array(faces)]}
    assert {tuple(map(tuple, np.roll(c, -int(np.lexsort(c.T)[0]), 0).tolist())) for c in corners(show())} == turned


@pytest.mark.parametrize("name", ["a.glb", "a.gltf"])
def test_a_mesh_may_have_as_many_indices_as_its_data_hold(file, tmp_path, name):
    file.node(mesh=file.mesh(None, np.tile(FACES, (30000, 1))))  # 120 000 triangles
    path = file.glb(tmp_path / "a.glb")
    if name == "a.gltf":  # the data lie in a file of their own
        (tmp_path / "a.bin").write_bytes(file.data)
        path = tmp_path / name
        path.write_text(json.dumps({**file.tree, "buffers": [{"uri": "a.bin", "byteLength": len(file.data)}]}))
    assert len(load(path).meshes[0].faces) == 120000


def test_nodes_are_placed_by_their_parents_matrices(file, show):
    # parent: translate (0 0 3), quarter turn about z; child: scale (2 1 1); (1 0 0) -> (2 0 0) -> (0 2 0) -> (0 2 3)
    normals = f32([[-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    child = file.node(mesh=file.mesh(NORMAL=normals), matrix=np.diag([2.0, 1, 1, 1]).reshape(-1).tolist(), name="child")
    file.node(children=[child], rotation=TURN_Z, translation=[0, 0, 3])
    (mesh,) = show().meshes
    assert mesh.name == "child"
    at = int(np.argmax(mesh.positions[:, 1]))
    np.testing.assert_allclose(mesh.positions[at], [0, 2, 3], atol=1e-6)
    np.testing.assert_allclose(mesh.normals[at], [0, 1, 0], atol=1e-6)
    assert mesh.closed


@pytest.mark.parametrize("smooth", [True, False])
def test_a_mirroring_node_keeps_its_outside_outside(file, show, smooth):
    """Normals of the sphere about the centre, or of the faces, point outward after the mirror."""
    normals = (POINTS - POINTS.mean(0)).astype(np.float32)
    file.node(mesh=file.mesh(**({"NORMAL": normals} if smooth else {})), scale=[-1, 1, 1])
    (mesh,) = show().meshes
    assert mesh.closed and ((mesh.positions - POINTS.mean(0) * [-1, 1, 1]) * mesh.normals).sum(1).min() > 0


def test_instances_stand_at_each_of_their_places(file, show):
    # rotations as normalized int16; a mirrored instance is wound outward as well
    file.used("EXT_mesh_gpu_instancing")
    quarter = round(HALF * 32767)
    turns = typed(np.int16, [[0, 0, 0, 32767], [0, 0, quarter, quarter], [0, 0, 0, 32767]])
    attributes = {
        "TRANSLATION": file.accessor(f32([[0, 0, 0], [10, 0, 0], [20, 0, 0]])),
        "ROTATION": file.accessor(turns, normalized=True),
        "SCALE": file.accessor(f32([[1, 1, 1], [2, 2, 2], [-1, 1, 1]])),
    }
    file.node(mesh=file.mesh(), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}}, translation=[0, 5, 0])
    scene = show()
    found = corners(scene).reshape(3, 12, 3)
    np.testing.assert_allclose(found[0].min(0), [0, 5, 0], atol=1e-4)
    np.testing.assert_allclose([found[1].min(0), found[1].max(0)], [[8, 5, 0], [10, 7, 2]], atol=1e-3)
    np.testing.assert_allclose([found[2].min(0), found[2].max(0)], [[19, 5, 0], [20, 6, 1]], atol=1e-4)
    assert scene.meshes[0].closed and not any("not shown" in notice for notice in scene.notices)


def test_only_the_default_scene_is_shown_and_of_it_what_is_visible(file, show):
    mesh = file.mesh()
    below = file.node(mesh=mesh, name="below")
    for name in ("first", "second"):
        file.node(mesh=mesh, name=name)
    file.node(mesh=mesh, name="hidden", children=[below], extensions={"KHR_node_visibility": {"visible": False}})
    assert {m.name for m in show().meshes} == {"first", "second"}
    file.tree["scenes"] = [{"nodes": [1]}, {"nodes": [2, 3]}]
    assert {m.name for m in show().meshes} == {"first"}
    file.tree["scene"] = 1
    assert {m.name for m in show().meshes} == {"second"}


def bent(file: GltfFile, places: int) -> None:
    """Add two joints, the second 1 above the first and turned a quarter about x, and a triangle bound to both."""
    second = file.node(translation=[0, 1, 0], rotation=TURN_X, name="second")
    first = file.node(children=[second], name="first")
    binds = f32([np.eye(4), transforms(np.array([[0, -1, 0]]), np.array([[0, 0, 0, 1]]), np.ones((1, 3)))[0]])
    matrices = file.accessor(binds.transpose(0, 2, 1).reshape(2, 16))
    skin = file.add("skins", {"joints": [first, second], "inverseBindMatrices": matrices})
    joints = {"JOINTS_0": typed(np.uint8, [[1, 0, 0, 0]] * 3), "WEIGHTS_0": f32([[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0]])}
    if places == 2:  # the same weights, in the second set
        joints = {"JOINTS_1": joints["JOINTS_0"], "WEIGHTS_1": joints["WEIGHTS_0"], "JOINTS_0": typed(np.uint16, [[0] * 4] * 3)}
        joints["WEIGHTS_0"] = typed(np.uint8, [[0] * 4] * 3)
    points = f32([[0, 2, 0], [1, 0, 0], [0, 2, 2]])
    mesh = file.mesh(None, None, POSITION=points, NORMAL=f32([[0, 1, 0]] * 3), **joints)
    file.node(mesh=mesh, skin=skin, translation=[100, 0, 0])


@pytest.mark.parametrize("places", [1, 2])
def test_a_skin_moves_vertices_with_their_joints_and_not_with_their_node(file, show, places):
    # (0 2 0) is 1 above the second joint: turned it is (0 1 1), its normal z; (1 0 0) stays; (0 2 2) moves halfway to (0 -1 1)
    bent(file, places)
    scene = show()
    np.testing.assert_allclose(corners(scene)[0], np.array([[0, 1, 1], [1, 0, 0], [0, 0.5, 1.5]]), atol=1e-6)
    normals = scene.meshes[0].normals[scene.meshes[0].faces[0]]
    np.testing.assert_allclose(normals, np.array([[0, 0, 1], [0, 1, 0], [0, HALF, HALF]]), atol=1e-6)


def test_morph_targets_add_up_by_the_weights_of_node_then_mesh(file, show):
    mesh = file.mesh(None, None, POSITION=TRIANGLE)
    moves = [f32([[0, 0, 2]] * 3), f32([[4, 0, 0]] * 3)]
    file.tree["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": file.accessor(m)} for m in moves]
    file.tree["meshes"][mesh]["weights"] = [0.5, 0]
    file.node(mesh=mesh)
    file.node(mesh=mesh, weights=[0, 0.25])
    first, second = corners(show())
    np.testing.assert_allclose(first, np.add(TRIANGLE, [0, 0, 1]))
    np.testing.assert_allclose(second, np.add(TRIANGLE, [1, 0, 0]))


def test_an_animated_node_is_where_the_file_stores_it(file, show):
    node = file.node(mesh=file.mesh())
    sampler = {"input": file.accessor(f32([0, 1])), "output": file.accessor(f32([[7, 0, 0]] * 2))}
    channels = [{"sampler": 0, "target": {"node": node, "path": "translation"}}]
    file.add("animations", {"channels": channels, "samplers": [sampler]})
    scene = show()
    assert scene.bounds[0, 0] == 0.0 and any("not shown: animations" in notice for notice in scene.notices)


def test_a_damaged_node_costs_only_itself(file, show):
    """A mesh of scale 0, nodes in a cycle, and a vertex that is not a number, used by three triangles."""
    wrong = POINTS.copy()
    wrong[3, 1] = np.nan
    mesh = file.mesh()
    file.node(mesh=mesh)
    file.node(mesh=mesh, scale=[0, 0, 0], name="dot")
    file.node(mesh=mesh, scale=[1, 0, 1], name="sheet")  # flat, but visible
    file.node(mesh=mesh, children=[4])
    file.node(mesh=mesh, children=[3])
    file.node(mesh=file.mesh(POSITION=wrong), name="torn")
    first = file.tree["meshes"][mesh]["primitives"][0]
    file.tree["meshes"][mesh]["primitives"] += [{**first, "mode": 0}, {**first, "mode": 3}]
    file.tree["scenes"] = [{"nodes": [0, 1, 2, 3, 5]}]
    scene = show()
    assert {m.name: len(m.faces) for m in scene.meshes} == {"node 0": 4, "sheet": 2, "torn": 1}
    assert f"{scene.path}: node 'dot' is left out: its scale is 0" in scene.notices
    assert f"{scene.path}: node 3 and 1 more part are left out: its parents form a cycle" in scene.notices
    assert f"{scene.path}: not shown: points, lines" in scene.notices
    assert any("3 triangles of node 'torn' is left out: its vertices are not finite" in notice for notice in scene.notices)
    np.testing.assert_array_equal(corners(scene)[-1], POINTS[FACES[0]])


@pytest.mark.parametrize(("module", "name"), [("DracoPy", "KHR_draco_mesh_compression"), ("meshopt", "EXT_meshopt_compression")])
def test_packed_geometry_without_its_package_is_a_line_that_names_the_extra(file, show, monkeypatch, module, name):
    monkeypatch.setitem(sys.modules, module, None)
    file.node(mesh=file.mesh())
    packed = {"bufferView": 0, "attributes": {"POSITION": 0}, "buffer": 0, "byteLength": 4, "byteStride": 12, "count": 4}
    if module == "DracoPy":
        file.tree["meshes"][0]["primitives"][0]["extensions"] = {name: packed}
        del file.tree["accessors"][0]["bufferView"]
    else:
        file.tree["bufferViews"][0]["extensions"] = {name: {**packed, "mode": "ATTRIBUTES"}}
    with pytest.raises(InputError, match=rf"{name}; to read it: pip install 'irrsplat\[gltf\]'; nothing"):
        show()


def test_draco_gives_the_triangles_that_were_packed(file, show):
    draco = pytest.importorskip("DracoPy")
    packed = draco.encode(POINTS, FACES, quantization_bits=14)
    file.node(mesh=file.mesh())
    primitive = file.tree["meshes"][0]["primitives"][0]
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": file.view(packed), "attributes": {"POSITION": 0}}}
    for accessor in file.tree["accessors"]:
        del accessor["bufferView"]
    (mesh,) = show().meshes
    assert mesh.closed and len(mesh.faces) == 4
    np.testing.assert_allclose(np.unique(mesh.positions.round(3), axis=0), np.unique(POINTS, axis=0), atol=1e-3)
    file.tree["bufferViews"][-1]["byteLength"] = 20
    with pytest.raises(InputError, match="its compressed data are damaged"):
        show()


def test_meshopt_gives_the_values_that_were_packed(file, show):
    meshopt = pytest.importorskip("meshopt")
    file.node(mesh=file.mesh())
    for view, (array, mode) in enumerate(((POINTS, "ATTRIBUTES"), (FACES.reshape(-1), "TRIANGLES"))):
        rows = array.reshape(len(array), -1)
        at = file.view(bytes(meshopt.encode_gltf_buffer(rows if mode == "ATTRIBUTES" else array, mode)))
        entry = file.tree["bufferViews"][at]
        packed = {**entry, "count": len(array), "byteStride": rows.shape[1] * 4, "mode": mode}
        file.tree["bufferViews"][view]["extensions"] = {"EXT_meshopt_compression": packed}
    (mesh,) = show().meshes
    assert mesh.closed
    np.testing.assert_array_equal(np.unique(mesh.positions, axis=0), np.unique(POINTS, axis=0))
