"""Triangles on the GPU: one vertex buffer and one index buffer for a whole scene, made from plain arrays."""

from __future__ import annotations

import moderngl
import numpy as np


class Geometry:
    """An indexed triangle list.

    vertices: (V, 12) float32 rows of position, normal, albedo, emission. faces: (F, 3) int32.
    The first `closed` faces belong to closed, outward wound meshes: `parts` names the ranges "all", "closed" and "open"
    as (first index, number of indices).
    """

    FORMAT = "3f 3f 3f 3f"
    ATTRIBUTES = ("in_position", "in_normal", "in_albedo", "in_emission")

    def __init__(self, ctx: moderngl.Context, vertices: np.ndarray, faces: np.ndarray, closed: int = 0) -> None:
        # OpenGL has no empty buffers: no geometry is one vertex and one index that no draw reaches
        self.vertices = ctx.buffer(np.ascontiguousarray(vertices if len(vertices) else np.zeros((1, 12)), "f4").tobytes())
        self.indices = ctx.buffer(np.ascontiguousarray(faces if len(faces) else np.zeros((1, 3)), "i4").tobytes())
        total, split = 3 * len(faces), 3 * closed
        self.parts = {"all": (0, total), "closed": (0, split), "open": (split, total - split)}

    def release(self) -> None:
        """Free both buffers."""
        self.vertices.release()
        self.indices.release()
