"""Triangles of a glTF primitive in its node's space: indices, attributes, morph targets and skins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from irrsplat.scene.io.gltf import accessors
from irrsplat.scene.io.gltf.document import Damaged, Document, extension
from irrsplat.scene.io.gltf.packed import DRACO, draco
from irrsplat.scene.io.mesh_builder import Part

_MODES = {0: "points", 1: "lines", 2: "lines", 3: "lines"}
_STRIP, _FAN = 5, 6


class Attributes:
    """Vertex attributes of one primitive, for the vertices that its triangles use.

    rows: (V,) their numbers. corners: (F, 3) into them. invalid_faces: number of triangles with invalid vertices, which are left
    out. shapes: cached geometry by morph weights.
    """

    def __init__(self, document: Document, primitive: Mapping[str, Any]) -> None:
        self._document = document
        self._primitive = primitive
        self._given: Mapping[str, Any] = primitive["attributes"]
        self._unpacked: dict[str, np.ndarray] = {}
        corners = self._corners()
        number = len(self._unpacked["POSITION"]) if self._unpacked else accessors.count(document, self._given["POSITION"])
        there = np.asarray((corners < number).all(1))
        self.invalid_faces = int(np.count_nonzero(~there))
        if self.invalid_faces == len(corners) > 0:
            raise Damaged(f"a face refers to vertex {corners.max()} (from 0), but there are {number} vertices")
        if self.invalid_faces:
            corners = corners[there]
        self.shapes: dict[bytes, Part] = {}
        used = np.zeros(number if corners.size else 0, bool)
        used[corners] = True
        self.rows = np.flatnonzero(used)
        self.corners = (np.cumsum(used) - 1)[corners] if corners.size else corners

    def _corners(self) -> np.ndarray:
        """Return (F, 3) int64: the triangles."""
        packed = extension(self._primitive, DRACO)
        if packed is not None:
            try:
                faces, self._unpacked = draco(self._document, packed)
                return faces.astype(np.int64)
            except Damaged:
                if "bufferView" not in self._document.entry("accessors", self._given["POSITION"]):
                    raise  # otherwise the file has them uncompressed as well
        if "indices" in self._primitive:
            indices = accessors.integers(self._document, self._primitive["indices"])[:, 0]
        else:
            indices = np.arange(accessors.count(self._document, self._given["POSITION"]))
        if len(indices) and indices.min() < 0:
            raise Damaged(f"a face refers to vertex {indices.min()}")
        return triangles(indices, self._primitive.get("mode", 4))

    def floats(self, name: str, widths: tuple[int, ...]) -> np.ndarray | None:
        """Return (V, n) float32: an attribute, or None if missing."""
        if name not in self._given:
            return None
        shares = name.startswith(("COLOR", "WEIGHTS"))  # always: some files omit the flag
        if name in self._unpacked:
            array = self._unpacked[name][self.rows]
            if array.shape[1] not in widths:
                raise Damaged(f"its {name} has an unexpected type")
            accessor = self._document.entry("accessors", self._given[name])
            return accessors.as_floats(array, shares or accessor.get("normalized") is True)
        return accessors.values(self._document, self._given[name], widths, self.rows, shares)

    def integers(self, name: str) -> np.ndarray | None:
        """Return (V, 4) int64: an attribute, or None if missing."""
        if name not in self._given:
            return None
        if name in self._unpacked:
            return self._unpacked[name][self.rows].astype(np.int64)
        return accessors.integers(self._document, self._given[name], (4,), self.rows)

    def morph_offset(self, name: str, weights: np.ndarray) -> np.ndarray | float:
        """Return the displacement of an attribute by morph targets: the weighted sum (V, n), or 0."""
        total: np.ndarray | float = 0.0
        targets = self._document.entries("targets", self._primitive)
        for weight, target in zip(weights.tolist(), targets, strict=False):
            if weight and name in target:
                total = total + np.float32(weight) * accessors.values(self._document, target[name], (2, 3, 4), self.rows)
        return total


def triangles(indices: np.ndarray, mode: object) -> np.ndarray:
    """Return (F, 3): the triangles of a list, a strip or a fan of indices; surplus indices are ignored."""
    if mode == _STRIP:
        i = np.arange(max(len(indices) - 2, 0))
        odd = i % 2
        corners = indices[np.stack([i, i + 1 + odd, i + 2 - odd], 1)]
        flat = (corners == np.roll(corners, 1, 1)).any(1)  # links between strips
        return np.asarray(corners[~flat])
    if mode == _FAN:
        i = np.arange(1, max(len(indices) - 1, 1))
        return indices[np.stack([i, i + 1, np.zeros_like(i)], 1)]
    if mode != 4:
        raise Damaged("its mode is damaged")
    return indices[: len(indices) // 3 * 3].reshape(-1, 3)


def kind_without_triangles(primitive: Mapping[str, Any]) -> str | None:
    """Return the kind of a primitive without triangles, in a word; None for one with triangles."""
    mode = primitive.get("mode", 4)
    return _MODES.get(mode) if isinstance(mode, int) else None


def read(attributes: Attributes, uv_sets: tuple[int, int], weights: np.ndarray) -> Part:
    """Return the triangles at the given morph weights (W,), before any skin; colors: (V, 3 or 4) linear. Raise Damaged."""
    positions = attributes.floats("POSITION", (3,))
    if positions is None:
        raise Damaged("it has no positions")
    normals, colors = attributes.floats("NORMAL", (3,)), attributes.floats("COLOR_0", (3, 4))
    pairs = [attributes.floats(f"TEXCOORD_{number}", (2,)) for number in uv_sets]
    uvs = None
    if any(pair is not None for pair in pairs):
        uvs = np.concatenate([np.zeros((len(positions), 2), np.float32) if pair is None else pair for pair in pairs], axis=1)
    if weights.any():
        positions = positions + attributes.morph_offset("POSITION", weights)
        normals = None if normals is None else normals + attributes.morph_offset("NORMAL", weights)
        colors = None if colors is None else colors + attributes.morph_offset("COLOR_0", weights)
    return Part(positions, attributes.corners, normals, colors=colors, uvs=uvs)


def skinned(geometry: Part, attributes: Attributes, joints: np.ndarray) -> Part:
    """Return the triangles in world space, deformed by a skin, with the same winding.

    joints: (J, 4, 4) world_from_vertex of each joint, its inverse bind matrix included. Raises Damaged.
    """
    blend = np.zeros((len(geometry.positions), 3, 4))
    total = np.zeros(len(geometry.positions))
    for i in range(2):
        numbers, weights = attributes.integers(f"JOINTS_{i}"), attributes.floats(f"WEIGHTS_{i}", (4,))
        if numbers is None or weights is None:
            continue
        for k in range(4):
            some = weights[:, k] != 0.0
            if some.any() and not 0 <= numbers[some, k].min() <= numbers[some, k].max() < len(joints):
                raise Damaged("it refers to joints that its skin does not have")
            blend[some] += weights[some, k, None, None] * joints[numbers[some, k], :3]
            total += weights[:, k]
    if not (total > 0.0).any():
        raise Damaged("it has no weights for its skin")
    blend[total > 0.0] /= total[total > 0.0, None, None]
    blend[total <= 0.0] = joints[0, :3]
    positions = np.einsum("vij,vj->vi", blend[:, :, :3], geometry.positions) + blend[:, :, 3]
    corners, normals = geometry.corners, geometry.normals
    turned = cofactors(blend[:, :, :3])
    if normals is not None:
        normals = np.einsum("vij,vj->vi", turned, normals)
    if len(blend) and np.median((turned[:, 0] * blend[:, 0, :3]).sum(1)) < 0.0:  # mirrored
        corners, normals = corners[:, ::-1], None if normals is None else -normals
    return replace(geometry, positions=positions, corners=corners, normals=normals)


def cofactors(matrices: np.ndarray) -> np.ndarray:
    """Return (N, 3, 3): the matrices that transform normals where (N, 3, 3) transform points, up to length, with mirrored signs.

    They are transposed inverses times determinants, and exist for singular matrices as well.
    """
    a, b, c = (matrices[:, i] for i in range(3))
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
