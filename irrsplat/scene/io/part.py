"""Triangles of one material as a file has them, and the mesh that they become."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.scene.io.mesh_builder import build_mesh
from irrsplat.scene.model import Material, Mesh


@dataclass(frozen=True)
class Part:
    """Triangles of one material before their transform: what `build_mesh` takes, by its names."""

    positions: np.ndarray
    corners: np.ndarray
    normals: np.ndarray | None = None
    corner_normals: np.ndarray | None = None
    matrix: np.ndarray | None = None
    material: Material = Material()
    colors: np.ndarray | None = None
    name: str = ""
    files: tuple[Path, ...] = ()  # read for it, apart from the main one
    uvs: np.ndarray | None = None
    corner_uvs: np.ndarray | None = None
    opacities: np.ndarray | None = None

    def mesh(self, path: Path, origin: tuple[float, float, float]) -> tuple[Mesh, int]:
        """The mesh, relative to `origin`, and how many degenerate triangles were dropped; raises InputError for what cannot be
        drawn."""
        corners = self.corners.astype(np.int64)
        check_corners(corners, len(self.positions), path)
        if not np.isfinite(self.positions).all():
            raise InputError("a vertex is not finite (NaN or infinity); expected finite coordinates", path)
        normals = np.zeros((0, 3)) if self.normals is None else np.nan_to_num(self.normals.astype(float), posinf=0.0, neginf=0.0)
        corner_normals = self.corner_normals
        if corner_normals is None and self.normals is None:
            corner_normals = np.full_like(corners, -1)
        try:
            return build_mesh(
                self.positions.astype(float),
                corners,
                normals,
                corner_normals,
                np.eye(4) if self.matrix is None else self.matrix,
                self.material,
                self.colors,
                self.name,
                uvs=self.uvs,
                corner_uvs=self.corner_uvs,
                opacities=self.opacities,
                origin=origin,
            )
        except InputError as error:
            raise InputError(str(error), path) from None


def check_corners(corners: np.ndarray, count: int, path: Path | str) -> None:
    """Raises InputError, which names `path`, where one of the corners (F, 3) is none of so many vertices."""
    if len(corners) and not 0 <= corners.min() <= corners.max() < count:
        bad = corners.min() if corners.min() < 0 else corners.max()
        raise InputError(f"a face refers to vertex {bad} (from 0), but there are {count} vertices", path)
