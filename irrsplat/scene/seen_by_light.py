"""Visibility of meshes to light: whole, cut out, or not at all; triangles are numbered in this order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.scene.model import Mesh, Scene

CLOSED, OPEN, CUT_OUT, UNSEEN = range(4)


@dataclass(frozen=True)
class FaceCounts:
    """Numbers of a scene's triangles of each kind, in the order of the triangles' numbers.

    closed: of closed meshes that are wholly visible to light. open: of other wholly visible meshes. cut_out: of meshes whose
    opacity varies across the cutoff. unseen: of meshes that light passes everywhere.
    """

    closed: int
    open: int
    cut_out: int = 0
    unseen: int = 0

    @property
    def solid(self) -> int:
        """Number of triangles that are wholly visible to light."""
        return self.closed + self.open

    @property
    def lit(self) -> int:
        """Number of triangles that are at least partly visible to light; their numbers are the lowest."""
        return self.solid + self.cut_out


def sort_of(mesh: Mesh) -> int:
    """Return CLOSED, OPEN, CUT_OUT or UNSEEN for a mesh, by Material.light_cutoff and the range of its opacities."""
    material = mesh.material
    cutoff = material.light_cutoff
    if cutoff > 0.0:
        opacities = np.array([material.opacity]) if mesh.opacities is None else mesh.opacities
        texture = material.albedo_texture
        low, high = (1.0, 1.0) if texture is None else texture.image.alpha_range
        if high * float(opacities.max(initial=0.0)) < cutoff:
            return UNSEEN
        if low * float(opacities.min(initial=1.0)) < cutoff:
            return CUT_OUT
    return CLOSED if mesh.closed else OPEN


def face_counts(scene: Scene) -> FaceCounts:
    """Return the numbers of the triangles of `flatten` by kind."""
    counts = [0] * 4
    for mesh in scene.meshes:
        counts[sort_of(mesh)] += len(mesh.faces)
    return FaceCounts(*counts)
