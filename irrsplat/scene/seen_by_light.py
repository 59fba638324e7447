"""What a mesh is to light: all there, there in parts, or not there; the triangles of a scene are numbered in this order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.scene.model import Mesh, Scene

CLOSED, OPEN, CUT_OUT, UNSEEN = range(4)


@dataclass(frozen=True)
class FaceCounts:
    """How many triangles of a scene are of which sort; they are numbered in this order.

    closed: of closed meshes that light sees all of. open: of others that it sees all of. cut_out: of meshes whose opacity decides
    from place to place. unseen: of those that light passes everywhere, as if they were not there.
    """

    closed: int
    open: int
    cut_out: int = 0
    unseen: int = 0

    @property
    def solid(self) -> int:
        """Those that light sees all of."""
        return self.closed + self.open

    @property
    def lit(self) -> int:
        """Those that it sees something of: their numbers are the lowest."""
        return self.solid + self.cut_out


def sort_of(mesh: Mesh) -> int:
    """What the mesh is to light: CLOSED, OPEN, CUT_OUT or UNSEEN, by Material.light_cutoff and all opacities that it has."""
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
    """How many of the triangles that `flatten` gives are of which sort."""
    counts = [0] * 4
    for mesh in scene.meshes:
        counts[sort_of(mesh)] += len(mesh.faces)
    return FaceCounts(*counts)
