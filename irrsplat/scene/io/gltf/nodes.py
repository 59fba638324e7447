"""Visible nodes of a glTF file's scene, and their world transforms in float64."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from irrsplat.scene.io.gltf import accessors
from irrsplat.scene.io.gltf.document import Damaged, Document, extension, numbers, printable

_TRS: dict[str, tuple[float, ...]] = {
    "translation": (0.0, 0.0, 0.0),
    "rotation": (0.0, 0.0, 0.0, 1.0),
    "scale": (1.0, 1.0, 1.0),
}


@dataclass(frozen=True)
class Node:
    """A visible node. world: (4, 4) float64, world_from_node; name: "" if missing."""

    index: int
    name: str
    entry: Mapping[str, Any]
    world: np.ndarray


def worlds(document: Document) -> list[np.ndarray | None]:
    """Return (4, 4) float64 world_from_node of every node of the file; None for a damaged one and its descendants."""
    entries = document.entries("nodes")
    parents = [-1] * len(entries)
    for i, entry in enumerate(entries):
        with document.part(name(document, i)):
            for child in document.entries("children", entry):
                document.entry("nodes", child)
                parents[child] = i
    found: list[np.ndarray | None] = [None] * len(entries)
    below: list[list[int]] = [[] for _ in entries]
    for i, parent in enumerate(parents):
        if parent >= 0:
            below[parent].append(i)
    given: dict[int, np.ndarray | list[float]] = {}  # parents before children
    pending, unreached = [i for i, parent in enumerate(parents) if parent < 0], set(range(len(parents)))
    while pending:
        i = pending.pop()
        unreached.remove(i)
        pending += below[i]
        if parents[i] < 0 or parents[i] in given:
            with document.part(name(document, i)):
                given[i] = _local_transform(document.entry("nodes", i))
    for i in sorted(unreached):
        document.leave_out(name(document, i), "its parents form a cycle")
    apart = [i for i, one in given.items() if isinstance(one, list)]
    columns = np.array([given[i] for i in apart], float).reshape(-1, 10)
    given |= zip(apart, transforms(*np.split(columns, [3, 7], axis=1)), strict=True)
    top = np.eye(4)
    for i, matrix in given.items():
        above = found[parents[i]] if parents[i] >= 0 else None
        found[i] = (top if above is None else above) @ matrix
    return found


def visible(document: Document, world: list[np.ndarray | None]) -> list[Node]:
    """Return the visible nodes of the default scene, else of the first, else all; parents before children."""
    entries, scenes, default = document.entries("nodes"), document.entries("scenes"), document.tree.get("scene")
    if scenes:
        chosen = scenes[default if isinstance(default, int) and 0 <= default < len(scenes) else 0]
        pending = list(document.entries("nodes", chosen)) if isinstance(chosen, dict) else []
    else:
        children = {child for entry in entries for child in document.entries("children", entry) if isinstance(child, int)}
        pending = [i for i in range(len(entries)) if i not in children]
    pending.reverse()
    nodes, visited = [], set()
    while pending:
        i = pending.pop()
        with document.part(f"node {i}"):
            entry = document.entry("nodes", i)
            if i in visited:
                continue
            visited.add(i)
            if (extension(entry, "KHR_node_visibility") or {}).get("visible") is False:
                continue
            matrix = world[i]
            if matrix is not None:
                nodes.append(Node(i, printable(entry.get("name") or ""), entry, matrix))
            pending += reversed(document.entries("children", entry))
    return nodes


def name(document: Document, index: int) -> str:
    """Return the name of a node for messages."""
    entry = document.entries("nodes")[index]
    named = entry.get("name") if isinstance(entry, dict) else None
    return f"node '{printable(named)}'" if named else f"node {index}"


def _local_transform(entry: Mapping[str, Any]) -> np.ndarray | list[float]:
    """Return (4, 4) parent_from_node, or the ten numbers of its translation, rotation and scale."""
    if "matrix" in entry:
        matrix: np.ndarray = np.reshape(numbers(entry, "matrix", tuple(np.eye(4).reshape(-1))), (4, 4)).T
        if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=1e-4):
            raise Damaged("its matrix is not affine")
        return matrix
    return [value for path, default in _TRS.items() for value in numbers(entry, path, default)]


def transforms(translations: np.ndarray, rotations: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Return (N, 4, 4): translations (N, 3) after rotations by quaternions x y z w (N, 4), after scales (N, 3)."""
    length = np.linalg.norm(rotations, axis=1, keepdims=True)
    x, y, z, w = np.where(length > 0.0, rotations / np.where(length > 0.0, length, 1.0), (0.0, 0.0, 0.0, 1.0)).T
    turn = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    matrices = np.zeros((len(translations), 4, 4))
    matrices[:, :3, :3] = np.moveaxis(np.array(turn), -1, 0) * scales[:, None, :]
    matrices[:, :3, 3] = translations
    matrices[:, 3, 3] = 1.0
    return matrices


def instances(document: Document, node: Node) -> np.ndarray:
    """Return (N, 4, 4) the places of the node's mesh: one, or those of EXT_mesh_gpu_instancing; raise Damaged."""
    instancing = extension(node.entry, "EXT_mesh_gpu_instancing")
    if instancing is None:
        return node.world[None]
    attributes = instancing.get("attributes")
    if not isinstance(attributes, dict):
        raise Damaged("its instances are damaged")
    given = {key: attributes[key.upper()] for key in _TRS if key.upper() in attributes}
    numbers_of = {accessors.count(document, index) for index in given.values()}
    if len(numbers_of) != 1:
        raise Damaged("its instances are damaged")
    number = numbers_of.pop()
    columns = []
    for key, default in _TRS.items():
        if key in given:
            columns.append(accessors.values(document, given[key], (len(default),)).astype(float))
        else:
            columns.append(np.tile(default, (number, 1)))
    return np.asarray(node.world @ transforms(*columns))
