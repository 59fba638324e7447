"""Odd and damaged parts of a glTF file: each costs itself and a notice, and the tetrahedron remains visible."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.support.gltf_files import FACES, POINTS, GltfFile, f32, typed

pytestmark = pytest.mark.usefixtures("without_stand_ins")

JOINTS, WEIGHTS = typed(np.uint8, [[0, 0, 0, 0]] * 4), f32([[1, 0, 0, 0]] * 4)


def oddity(
    f: GltfFile, indices: np.ndarray | None = FACES, more: dict[str, Any] | None = None, **attributes: Any
) -> dict[str, Any]:
    """Add a node `odd` with a new mesh, and return its primitive, which has `more`."""
    mesh = f.mesh(None, indices, **attributes)
    f.node(mesh=mesh, name="odd", **(more or {}))
    return f.tree["meshes"][mesh]["primitives"][0]


def sparse(f: GltfFile) -> int:
    """Return an accessor that replaces its ninth element of four."""
    at, new = f.view(b"\x08"), f.view(f32([0, 0, 0]).tobytes())
    kinds = {"indices": {"bufferView": at, "componentType": 5121}, "values": {"bufferView": new}}
    return f.accessor(POINTS, sparse={"count": 1, **kinds})


def bomb(f: GltfFile, add: Callable[..., object], *args: Any) -> None:
    """Add an object whose last accessor declares many elements without bytes."""
    add(f, *args)
    f.tree["accessors"][-1]["count"] = 10**8
    del f.tree["accessors"][-1]["bufferView"]


def draco(f: GltfFile, kind: int, flags: int = 0) -> None:
    """Compress the node `odd` by Draco, with a header of this kind that declares a count of 2²⁷ first."""
    data = b"DRACO\2\2" + bytes((kind, 0, 0, flags)) + b"\x80\x80\x80\x40" + b"\1" * 99
    packed = {"bufferView": f.view(data), "attributes": {"POSITION": 0}}
    oddity(f)["extensions"] = {"KHR_draco_mesh_compression": packed}
    del f.tree["accessors"][-2]["bufferView"]


def instanced(f: GltfFile, attributes: object) -> None:
    """Give the node `odd` these instances."""
    oddity(f, more={"extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}})


def skinned(f: GltfFile, joints: list[int], numbers: np.ndarray = JOINTS) -> None:
    """Bind the node `odd` to a skin with these joints."""
    oddity(f, more={"skin": f.add("skins", {"joints": joints})}, JOINTS_0=numbers, WEIGHTS_0=WEIGHTS)


def add_light(f: GltfFile, **light: Any) -> None:
    """Add a node `odd` with a light."""
    f.tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot", **light}]}}
    f.node(name="odd", extensions={"KHR_lights_punctual": {"light": 0}})


def add_camera(f: GltfFile, kind: str, **values: float) -> None:
    """Add a node `odd` with a camera."""
    f.node(name="odd", camera=f.add("cameras", {"type": kind, kind: values}))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: oddity(f, FACES + 9), "node 'odd' is left out: a face refers to vertex 12 (from 0), but there are 4 vertices"),
        (lambda f: oddity(f, FACES + typed(np.uint32, [[0], [0], [0], [9]])), "they refer to vertices that do not exist"),
        (lambda f: oddity(f, typed(np.int8, [0, 1, -1])), "node 'odd' is left out: a face refers to vertex -1"),
        (lambda f: oddity(f).update(mode="x"), "node 'odd' is left out: its mode is damaged"),
        (lambda f: oddity(f, f32([0, 1, 2])), "accessor 3 holds no integers"),
        (lambda f: oddity(f, POSITION=f32([[0, 0]] * 4)), "accessor 2 has an unexpected type"),
        (lambda f: oddity(f, NORMAL=POINTS[:2]), "has 2 elements, and 4 are needed"),
        (lambda f: oddity(f, NORMAL=f.add("accessors", {"componentType": 5126, "count": 10**8, "type": "VEC3"})), "in a file of"),
        (lambda f: bomb(f, oddity), "accessor 3 declares 100000000 elements in a file of"),
        (lambda f: draco(f, 1), "node 'odd' is left out: its compressed data declare more than they can hold"),
        (lambda f: draco(f, 0), "node 'odd' is left out: its compressed data are damaged"),  # points alone
        (lambda f: draco(f, 1, 0x80), "node 'odd' is left out: its compressed data begin with metadata"),
        (lambda f: f.node(mesh=9, name="odd"), "node 'odd' is left out: there is no mesh 9"),
        (lambda f: oddity(f, POSITION=sparse(f)), "accessor 2 replaces elements that it does not have"),
        (lambda f: oddity(f, POSITION=POINTS * f32([1, 0, 0])), "4 degenerate triangles dropped"),
        (lambda f: oddity(f, more={"matrix": [1] * 16}), "node 'odd' is left out: its matrix is not affine"),
        (lambda f: instanced(f, 5), "node 'odd' is left out: its instances are damaged"),
        (lambda f: instanced(f, {}), "node 'odd' is left out: its instances are damaged"),
        (lambda f: skinned(f, []), "the skin of node 'odd' is left out: it has no joints"),
        (lambda f: skinned(f, [0], JOINTS + 7), "it refers to joints that its skin does not have"),
        (lambda f: add_light(f, intensity=-1), "the light of node 'odd' is left out: its intensity is negative"),
        (lambda f: add_light(f, spot={"innerConeAngle": 1.0}), "the light of node 'odd' is left out: its cone is damaged"),
        (lambda f: add_light(f, intensity=1e10, color=[1e10] * 3), "its place or intensity exceeds"),
        (lambda f: add_camera(f, "perspective", yfov=4.0), "the camera of node 'odd' is left out: its field of view is damaged"),
        (lambda f: add_camera(f, "orthographic"), "the camera of node 'odd' is left out: its field of view is damaged"),
    ],
)  # fmt: skip
def test_a_damaged_part_costs_itself_and_a_notice(
    file: GltfFile, show: Callable[..., Any], damage: Callable[[GltfFile], object], message: str
) -> None:
    """The first node is intact, and keeps its four triangles."""
    file.node(mesh=file.mesh())
    damage(file)
    scene = show()
    assert sum(message in notice for notice in scene.notices) == 1, scene.notices
    assert len(scene.meshes[0].faces) == 4 and "odd" not in [light.name for light in scene.lights]


def test_a_mirrored_joint_and_mirrored_instances_keep_their_outside_outside(file: GltfFile, show: Callable[..., Any]) -> None:
    """The skin has no normals; the instances have normals, and only SCALE. White vertex colours change nothing."""
    joint = file.node(scale=[-1, 1, 1])
    skinned(file, [joint])
    place = {"attributes": {"SCALE": file.accessor(f32([[1, 1, 1], [-1, 1, 1]]))}}
    points = POINTS + f32([1, 0, 0])
    more = {"NORMAL": f32(points - points.mean(0)), "COLOR_0": f32([[1] * 3] * 4)}
    oddity(file, more={"extensions": {"EXT_mesh_gpu_instancing": place}}, POSITION=points, **more)
    skin, two = show().meshes
    assert skin.closed and skin.positions[:, 0].min() == -1.0
    assert two.closed and len(two.faces) == 8 and two.colors is None
    middle = points.mean(0) * np.where(two.positions[:, :1] < 0, [[-1, 1, 1]], 1)
    assert ((two.positions - middle) * two.normals).sum(1).min() > 0
