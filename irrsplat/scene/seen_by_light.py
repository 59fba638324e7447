"""Visibility of meshes to light: whole, cut out, or not at all; triangles are numbered in this order.

`Holes` has the cut-out parts for rays on the CPU, and shaders/lib/rays/cut_outs.glsl has them for rays in shaders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.vertex_layout import vertex_column
from irrsplat.scene.model import Mesh, Scene, Texture

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


class Holes:
    """The holes of a scene's cut-out triangles. first: the number of the first one; all lower numbers are of whole triangles.

    vertices, faces: as from `flatten`.
    """

    def __init__(self, scene: Scene, vertices: np.ndarray, faces: np.ndarray) -> None:
        counts = face_counts(scene)
        self.first = counts.solid
        corners = vertices[faces[counts.solid : counts.lit].ravel()]
        self._opacities, self._uvs = (vertex_column(corners, of).reshape(counts.cut_out, 3, -1) for of in ("opacity", "uv"))
        self._numbers = vertex_column(corners, "material")[::3, 0].astype(int)
        self._materials = [*scene.materials]

    def passed(self, triangles: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Return (N,) True where light passes: at points with these barycentric `shares` (N, 3) of cut-out `triangles` (N,)."""
        rows = triangles - self.first
        opacity, uv = ((shares[..., None] * values[rows]).sum(1) for values in (self._opacities, self._uvs))
        found, numbers = np.zeros(len(rows), bool), self._numbers[rows]
        for number in np.unique(numbers):
            material, here = self._materials[number], numbers == number
            texture = material.albedo_texture
            alpha = 1.0 if texture is None else _alpha(texture, uv[here])
            found[here] = opacity[here, 0] * alpha < material.light_cutoff
        return found


def _alpha(texture: Texture, uvs: np.ndarray) -> np.ndarray:
    """Return (N,) the alpha of a texture, 0..1, at both sets of coordinates `uvs` (N, 4)."""
    first = 2 * texture.uv_set
    at = uvs[:, first : first + 2] @ np.reshape(texture.transform, (2, 3))[:, :2].T + np.reshape(texture.transform, (2, 3))[:, 2]
    alpha = texture.image.pixels[..., 3]
    total, ways = np.zeros(len(at)), []
    for x, wrap, size in zip(at.T, texture.wrap, alpha.shape[::-1], strict=True):
        x = 1.0 - np.abs(x % 2.0 - 1.0) if wrap == "mirror" else x % 1.0 if wrap == "repeat" else np.clip(x, 0.0, 1.0)
        place = x * size - 0.5
        low = np.round(place) if texture.nearest else np.floor(place)
        share = place - low if not texture.nearest else np.zeros(len(x))
        both = (low.astype(int) + step for step in (0, 1))
        ends = [i % size if wrap == "repeat" else np.clip(i, 0, size - 1) for i in both]
        ways.append([(ends[0], 1.0 - share), (ends[1], share)])
    for column, across in ways[0]:
        for row, down in ways[1]:
            total += across * down * alpha[row, column]
    return total / 255.0
