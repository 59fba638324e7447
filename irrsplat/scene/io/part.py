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

    positions: (V, 3), finite. corners: (F, 3) into positions. normals: (N, 3), of any length, or None. corner_normals: (F, 3)
    into normals, -1 for none; None: one normal a position. matrix: (4, 4) world_from_object, affine; None: identity. colors:
    (V, 3) or None. uvs: (T, 4), two sets u v u v, or None. corner_uvs: (F, 3) into uvs, -1 for none (0 0 0 0); None: one row a
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
