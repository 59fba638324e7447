"""glTF's geometry: accessors of every kind, nodes, instances, skins, morphs, animations; a bad part costs that part alone."""

from __future__ import annotations

import json
import math
import random
import sys
from pathlib import Path

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import Scene, load
from irrsplat.scene.io.gltf import reader
from irrsplat.scene.io.gltf.nodes import transforms
from tests.support.gltf_files import FACES, POINTS, TRIANGLE, GltfFile, f32, glb_bytes, typed

HALF = math.sqrt(0.5)
TURN_X = [HALF, 0, 0, HALF]  # a quarter turn about x: y becomes z
TURN_Z = [0, 0, HALF, HALF]  # about z: x becomes y


@pytest.fixture
def file() -> GltfFile:
    return GltfFile()


@pytest.fixture
def show(file: GltfFile, tmp_path: Path):
    """Loads the file, whose one scene holds all nodes that are no children."""

    def show(**options) -> Scene:
        return load(file.gltf(tmp_path / "a.gltf"), **options)

    return show


def corners(scene: Scene) -> np.ndarray:
    """(F, 3, 3): the corners of all triangles."""
    return np.concatenate([mesh.positions[mesh.faces] for mesh in scene.meshes])


def face_normals(scene: Scene) -> np.ndarray:
    edges = corners(scene)
    cross = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def remarks(scene: Scene) -> list[str]:
    return [notice for notice in scene.notices if not notice.endswith(("stands in", "stand in"))]


# accessors


@pytest.mark.parametrize(
    "quantized",
    [
        {"array": np.array([[0, 0], [0.25, 1], [1, 0.5]], np.float32)},
        {"array": np.array([[0, 0], [64, 255], [255, 128]], np.uint8), "normalized": True},
        {"array": np.array([[0, 0], [16384, 65535], [65535, 32768]], np.uint16), "normalized": True},
        {"array": np.array([[-128, 0], [32, 127], [127, 64]], np.int8), "normalized": True},
        {"array": np.array([[0, 0], [8192, 32767], [32767, 16384]], np.int16), "normalized": True, "stride": 8},
        {"array": np.array([[0, 0], [0, 1], [1, 0]], np.int16)},
    ],
    ids=lambda q: f"{q['array'].dtype} {'normalized' if q.get('normalized') else 'plain'}",
)
def test_texture_coordinates_of_every_type_are_read(file, show, quantized):
    # -128 of 127 counts as -1, as glTF 2.0 section 3.11 says
    array = quantized["array"]
    expected = array.astype(float)
    if quantized.get("normalized"):
        expected = np.maximum(array / float(np.iinfo(array.dtype).max), -1.0)
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": file.texture(np.zeros((1, 1, 3), np.uint8))}}}
    second = file.accessor(np.array([[5, 6], [7, 8], [9, 10]], np.float32))
    file.node(mesh=file.mesh(texture, None, POSITION=TRIANGLE, TEXCOORD_0=file.accessor(**quantized), TEXCOORD_1=second))
    (mesh,) = show().meshes
    order = [int(np.flatnonzero((p == TRIANGLE).all(1))[0]) for p in mesh.positions]
    np.testing.assert_allclose(mesh.uvs, np.hstack([expected, [[5, 6], [7, 8], [9, 10]]])[order], atol=1e-6)


def test_quantized_interleaved_positions_and_normals_are_read(file, show):
    # int16 positions scaled by the node, int8 normals, in one interleaved view of 12 bytes a vertex
    rows = np.zeros(3, [("p", "<i2", 3), ("", "<i2"), ("n", "i1", 3), ("", "i1")])
    rows["p"], rows["n"] = [[0, 0, 0], [2000, 0, 0], [0, 3000, 0]], [[0, 0, 127]] * 3
    view = file.view(rows.tobytes(), byteStride=12)
    kind = {"bufferView": view, "count": 3, "type": "VEC3"}
    position = file.add("accessors", {**kind, "componentType": 5122})
    normal = file.add("accessors", {**kind, "componentType": 5120, "normalized": True, "byteOffset": 8})
    file.node(mesh=file.mesh(None, None, POSITION=position, NORMAL=normal), scale=[0.001, 0.001, 0.001])
    scene = show()
    np.testing.assert_allclose(scene.bounds, [[0, 0, 0], [2, 3, 0]], atol=1e-6)
    np.testing.assert_allclose(scene.meshes[0].normals, [[0, 0, 1]] * 3, atol=1e-6)


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
    ("mode", "indices", "faces"),
    [
        (4, [0, 1, 2, 0, 2, 3, 1], [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 2, 3], [[0, 1, 2], [1, 3, 2]]),
        (5, [0, 1, 2, 2, 3, 3, 1, 0], [[0, 1, 2], [3, 0, 1]]),  # two strips with links
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ],
)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32])
def test_lists_strips_and_fans_make_the_triangles_that_the_standard_says(file, show, mode, indices, faces, kind):
    file.node(mesh=file.mesh(None, np.array(indices, kind)))
    file.tree["meshes"][0]["primitives"][0]["mode"] = mode
    turned = {tuple(map(tuple, np.roll(c, -int(np.lexsort(c.T)[0]), 0).tolist())) for c in POINTS[np.array(faces)]}
    assert {tuple(map(tuple, np.roll(c, -int(np.lexsort(c.T)[0]), 0).tolist())) for c in corners(show())} == turned


def test_points_and_lines_are_told_and_the_triangles_beside_them_shown(file, show):
    file.node(mesh=file.mesh())
    first = file.tree["meshes"][0]["primitives"][0]
    file.tree["meshes"][0]["primitives"] += [{**first, "mode": 0}, {**first, "mode": 3}, {**first, "mode": 1}]
    scene = show()
    assert scene.triangles == 4 and remarks(scene) == [f"{scene.path}: not shown: points, lines"]
    file.tree["meshes"][0]["primitives"] = [{**first, "mode": 0}]
    with pytest.raises(InputError, match="there are no triangles in this file, only points; nothing is left to show"):
        show()


# nodes


def test_nodes_stand_where_their_parents_matrices_put_them(file, show):
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
    # normals of the sphere about the middle: they point outward after the mirror, and so do the faces
    normals = (POINTS - POINTS.mean(0)).astype(np.float32)
    file.node(mesh=file.mesh(**({"NORMAL": normals} if smooth else {})), scale=[-1, 1, 1])
    scene = show()
    (mesh,) = scene.meshes
    assert mesh.closed
    middle = POINTS.mean(0) * [-1, 1, 1]
    assert ((corners(scene).mean(1) - middle) * face_normals(scene)).sum(1).min() > 0
    assert ((mesh.positions - middle) * mesh.normals).sum(1).min() > 0


def test_instances_stand_at_each_of_their_places(file, show):
    # rotations as normalised int16; a mirrored instance is wound outward as well
    file.used("EXT_mesh_gpu_instancing")
    quarter = round(HALF * 32767)
    attributes = {
        "TRANSLATION": file.accessor(f32([[0, 0, 0], [10, 0, 0], [20, 0, 0]])),
        "ROTATION": file.accessor(
            typed(np.int16, [[0, 0, 0, 32767], [0, 0, quarter, quarter], [0, 0, 0, 32767]]), normalized=True
        ),
        "SCALE": file.accessor(f32([[1, 1, 1], [2, 2, 2], [-1, 1, 1]])),
    }
    file.node(mesh=file.mesh(), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}}, translation=[0, 5, 0])
    scene = show()
    found = corners(scene).reshape(3, 12, 3)
    np.testing.assert_allclose(found[0].min(0), [0, 5, 0], atol=1e-4)
    np.testing.assert_allclose([found[1].min(0), found[1].max(0)], [[8, 5, 0], [10, 7, 2]], atol=1e-3)
    np.testing.assert_allclose([found[2].min(0), found[2].max(0)], [[19, 5, 0], [20, 6, 1]], atol=1e-4)
    assert scene.meshes[0].closed and remarks(scene) == []


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


# skins, morph targets, animations


def bent(file: GltfFile, places: int = 1) -> list[int]:
    """Two joints, the second 1 above the first and turned a quarter about x; a triangle that hangs on both."""
    second = file.node(translation=[0, 1, 0], rotation=TURN_X, name="second")
    first = file.node(children=[second], name="first")
    binds = f32([np.eye(4), transforms(np.array([[0, -1, 0]]), np.array([[0, 0, 0, 1]]), np.ones((1, 3)))[0]])
    skin = file.add(
        "skins", {"joints": [first, second], "inverseBindMatrices": file.accessor(binds.transpose(0, 2, 1).reshape(2, 16))}
    )
    joints = {"JOINTS_0": typed(np.uint8, [[1, 0, 0, 0]] * 3), "WEIGHTS_0": f32([[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0]])}
    if places == 2:  # the same weights, in the second set
        joints = {"JOINTS_1": joints["JOINTS_0"], "WEIGHTS_1": joints["WEIGHTS_0"], "JOINTS_0": typed(np.uint16, [[0] * 4] * 3)}
        joints["WEIGHTS_0"] = typed(np.uint8, [[0] * 4] * 3)
    points = f32([[0, 2, 0], [1, 0, 0], [0, 2, 2]])
    mesh = file.mesh(None, None, POSITION=points, NORMAL=f32([[0, 1, 0]] * 3), **joints)
    return [file.node(mesh=mesh, skin=skin, translation=[100, 0, 0])]


@pytest.mark.parametrize("places", [1, 2])
def test_a_skin_moves_vertices_with_their_joints_and_not_with_their_node(file, show, places):
    # (0 2 0) is 1 above the second joint: turned it is (0 1 1), its normal z; (1 0 0) stays; (0 2 2) goes half way to (0 -1 1)
    bent(file, places)
    scene = show()
    np.testing.assert_allclose(corners(scene)[0], np.array([[0, 1, 1], [1, 0, 0], [0, 0.5, 1.5]]), atol=1e-6)
    normals = scene.meshes[0].normals[scene.meshes[0].faces[0]]
    np.testing.assert_allclose(normals, np.array([[0, 0, 1], [0, 1, 0], [0, HALF, HALF]]), atol=1e-6)


def test_a_damaged_skin_leaves_the_mesh_as_it_is(file, show):
    bent(file)
    file.tree["skins"][0]["joints"] = [0, 77]
    scene = show()
    np.testing.assert_allclose(corners(scene)[0, 0], [100, 2, 0])
    assert any("the skin of node 2 is left out" in notice for notice in scene.notices)


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


def animate(file: GltfFile, node: int, path: str, keys: list[float], values: np.ndarray, interpolation: str = "LINEAR") -> None:
    sampler = {
        "input": file.accessor(f32(keys)),
        "output": file.accessor(f32(values)),
        "interpolation": interpolation,
    }
    file.add("animations", {"channels": [{"sampler": 0, "target": {"node": node, "path": path}}], "samplers": [sampler]})


@pytest.mark.parametrize(
    ("interpolation", "time", "x"),
    [
        ("LINEAR", None, 1),
        ("LINEAR", 0, 1),
        ("LINEAR", 2.5, 1.5),
        ("LINEAR", 99, 3),
        ("STEP", 2.9, 1),
        ("STEP", 3, 2),
        ("CUBICSPLINE", 2, 1),
        ("CUBICSPLINE", 2.5, 1.5),
        ("CUBICSPLINE", 4, 2.25),
    ],
)
def test_animations_interpolate_between_keys_and_hold_at_their_ends(file, show, interpolation, time, x):
    # keys at 2, 3 and 5 with x = 1, 2, 3; the spline's out-tangent of the second key is 1, the in-tangent of the third 2:
    # half way through 2 s: 1/2·2 + 1/2·3 + 2·(1/8·1 - 1/8·2) = 2.25
    values = np.array([[1, 0, 0], [2, 0, 0], [3, 0, 0]])
    if interpolation == "CUBICSPLINE":
        zero = [0, 0, 0]
        values = np.array([[zero, values[0], zero], [zero, values[1], [1, 0, 0]], [[2, 0, 0], values[2], zero]]).reshape(-1, 3)
    node = file.node(mesh=file.mesh())
    animate(file, node, "translation", [2, 3, 5], values, interpolation)
    scene = show(time=time)
    assert scene.bounds[0, 0] == pytest.approx(x, abs=1e-6)
    assert any("--time" in notice for notice in scene.notices) == (time is None)


def test_rotations_take_the_short_arc_at_constant_speed_and_weights_are_animated(file, show):
    # a third of the way from none to a quarter turn, whose quaternion is given with the wrong sign: 30 degrees
    mesh = file.mesh()
    file.tree["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": file.accessor(f32([[0, 0, 6]] * 4))}]
    node = file.node(mesh=mesh)
    animate(file, node, "rotation", [0, 3], np.array([[0, 0, 0, 1], [0, 0, -HALF, -HALF]]))
    animate(file, node, "weights", [0, 3], np.array([0, 1]))
    points = np.unique(show(time=1.0).meshes[0].positions, axis=0)
    angle = math.radians(30)
    expected = np.array([[0, 0, 0], [math.cos(angle), math.sin(angle), 0], [-math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
    np.testing.assert_allclose(sorted(points.tolist()), sorted(np.add(expected, [0, 0, 2]).tolist()), atol=1e-6)


def test_of_several_animations_the_first_that_moves_a_property_does(file, show):
    node, other = file.node(mesh=file.mesh()), file.node(mesh=file.mesh())
    for target, x in ((node, 1), (node, 7), (other, 3)):
        animate(file, target, "translation", [0], np.array([[x, 0, 0]]))
    assert [mesh.positions[:, 0].min() for mesh in show().meshes] == [1, 3]


# what is damaged


def test_a_node_that_is_scaled_to_nothing_costs_only_itself(file, show):
    mesh = file.mesh()
    file.node(mesh=mesh)
    file.node(mesh=mesh, scale=[0, 0, 0], name="dot")
    file.node(mesh=mesh, scale=[1, 0, 1], name="sheet")  # flat, and still there
    scene = show()
    assert [m.name for m in scene.meshes] == ["node 0", "sheet"]
    assert f"{scene.path}: node 'dot' is left out: it is scaled to nothing" in scene.notices


def test_vertices_that_are_not_finite_cost_their_triangles(file, show):
    wrong = POINTS.copy()
    wrong[3, 1] = np.nan
    file.node(mesh=file.mesh(POSITION=wrong))
    scene = show()
    np.testing.assert_array_equal(corners(scene)[0], POINTS[FACES[0]])
    assert scene.triangles == 1 and "3 triangles of node 0 is left out: its vertices are not finite" in scene.notices[0]


def test_a_missing_buffer_is_named(file, show, tmp_path):
    file.node(mesh=file.mesh())
    file.tree["buffers"] = [{"byteLength": len(file.data), "uri": "my%20kitchen.bin"}]
    (tmp_path / "a.gltf").write_text(json.dumps(file.tree))
    with pytest.raises(InputError, match=r"a\.gltf: node 0 is left out: my kitchen\.bin is missing; nothing is left"):
        load(tmp_path / "a.gltf")
    (tmp_path / "My kitchen.bin").write_bytes(file.data)
    scene = load(tmp_path / "a.gltf")
    assert scene.triangles == 4 and str(tmp_path / "My kitchen.bin") in scene.files
    file.tree["buffers"].append({"byteLength": 9, "uri": "gone.bin"})
    file.node(mesh=file.mesh(POSITION=file.add("accessors", {**file.tree["accessors"][0], "bufferView": 99})), name="b")
    (tmp_path / "My kitchen.bin").write_bytes(file.data)
    (tmp_path / "a.gltf").write_text(json.dumps(file.tree))
    assert load(tmp_path / "a.gltf").triangles == 4


def test_nodes_in_a_circle_are_left_out(file, show):
    file.node(mesh=file.mesh())
    file.node(mesh=0, children=[2])
    file.node(mesh=0, children=[1])
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    assert show().triangles == 4


def test_what_a_file_asks_for_and_is_not_shown_is_one_line(file, show):
    file.node(mesh=file.mesh())
    file.used("KHR_materials_clearcoat", "KHR_texture_transform", "VENDOR_magic")
    scene = show()
    assert remarks(scene) == [f"{scene.path}: not shown: KHR_materials_clearcoat, VENDOR_magic"]


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
    with pytest.raises(InputError, match="its packed data are damaged"):
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


def rich() -> GltfFile:
    """A file with a part of nearly every kind."""
    file = GltfFile()
    (skinned,) = bent(file)
    texture = {
        "index": file.texture(np.full((2, 2, 4), 99, np.uint8), wrapS=33071),
        "extensions": {"KHR_texture_transform": {"scale": [2, 2]}},
    }
    mesh = file.mesh(
        {"pbrMetallicRoughness": {"baseColorTexture": texture}, "alphaMode": "BLEND", "emissiveFactor": [1, 0, 0]},
        TEXCOORD_0=np.zeros((4, 2), np.float32),
        COLOR_0=np.full((4, 4), 200, np.uint8),
    )
    file.tree["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": file.accessor(POINTS)}]
    place = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": file.accessor(POINTS)}}}
    file.node(mesh=mesh, weights=[0.5], extensions=place)
    file.node(mesh=mesh, scale=[1, -1, 1])
    file.node(camera=file.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}))
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}, "intensity": 3}]}}
    file.node(extensions={"KHR_lights_punctual": {"light": 0}})
    animate(file, skinned, "translation", [0, 1], np.array([[0, 0, 0], [1, 0, 0]]))
    return file


def mutated(tree: object, generator: random.Random) -> None:
    """Changes one value somewhere in a JSON tree."""
    places: list[tuple] = []

    def walk(value: object) -> None:
        keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
        for key in list(keys):
            places.append((value, key))
            walk(value[key])  # type: ignore[index]

    walk(tree)
    holder, key = generator.choice(places)
    new: list[object] = [None, -1, 0, 10**6, 10**12, 1e308, -0.5, math.nan, "x", "", [], {}, [1], [[]], {"a": 1}, True, 3, 5126]
    if generator.random() < 0.2 and isinstance(holder, dict):
        del holder[key]
    else:
        holder[key] = generator.choice(new)


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_no_mutation_of_a_file_makes_a_traceback(tmp_path, capfd, monkeypatch):
    # 150 changes of the JSON, 60 of the bytes: each loads with finite numbers, or is refused in one line
    generator = random.Random(3)
    file = rich()
    tree = json.dumps({**file.tree, "buffers": [{"byteLength": len(file.data)}]})
    path, loaded = tmp_path / "a.glb", 0
    for i in range(210):
        if i == 15:  # what stands in for a light and a camera takes longer than all the rest
            monkeypatch.setattr(reader, "finish", lambda path, meshes, *rest, **more: Scene(tuple(meshes), (), ()))
        changed, data = json.loads(tree), bytearray(file.data)
        for _ in range(generator.randrange(1, 3)):
            if i < 150:
                mutated(changed, generator)
            else:
                for _ in range(20):
                    data[generator.randrange(len(data))] = generator.randrange(256)
        whole = bytearray(glb_bytes(changed, bytes(data)))
        if i >= 195:
            whole[generator.randrange(len(whole))] = generator.randrange(256)
        path.write_bytes(whole)
        try:
            scene = load(path, time=0.5)
        except InputError as error:
            assert "\n" not in str(error) and "a.glb: " in str(error)
        else:
            loaded += 1
            assert all("\n" not in notice for notice in scene.notices)
            for mesh in scene.meshes:
                for array in (mesh.positions, mesh.normals, mesh.colors, mesh.uvs, mesh.opacities):
                    assert array is None or np.isfinite(array).all()
    assert loaded > 150
    assert capfd.readouterr() == ("", "")
