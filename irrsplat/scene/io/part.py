"""Triangles of one material before their transform."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.scene.model import Material


@dataclass(frozen=True)
class Part:
    """Triangles of one material in object space, as a file has them.

    positions: (V, 3). corners: (F, 3) into positions. normals: (N, 3), of any length, or None. corner_normals: (F, 3) into
    normals, -1 for none; None: one normal a position. matrix: (4, 4) world_from_object, affine; None: identity. colors: (V, 3)
    or None. uvs: (T, 4), two sets u v u v, or None. corner_uvs: (F, 3) into uvs, -1 for none (0 0 0 0); None: one row a
    position. opacities: (V,) or None. files: read for it, apart from the main one. source: place in the file, for messages.
    """

    positions: np.ndarray
    corners: np.ndarray
    normals: np.ndarray | None = None
    corner_normals: np.ndarray | None = None
    matrix: np.ndarray | None = None
    material: Material = Material()
    colors: np.ndarray | None = None
    name: str = ""
    files: tuple[Path, ...] = ()
    uvs: np.ndarray | None = None
    corner_uvs: np.ndarray | None = None
    opacities: np.ndarray | None = None
    source: Any = None


def corner_problem(corners: np.ndarray, count: int) -> str:
    """Return the problem with corners (F, 3) that are to refer to `count` vertices; "" where there is none."""
    if not len(corners) or 0 <= corners.min() <= corners.max() < count:
        return ""
    wrong = corners.min() if corners.min() < 0 else corners.max()
    return f"a face refers to vertex {wrong} (from 0), but there are {count} vertices"
