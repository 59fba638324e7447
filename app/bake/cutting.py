"""Conforming bisection of triangles at edge midpoints: no edge contains a vertex of a neighbour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.app.bake.places import Receivers


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of a Cut.

    ends: (E, 2) vertices. root, middle: (E,), (E, 3) a triangle of each midpoint and the barycentric coordinates there.
    length: (E,) metres. of_face: (F, 3) edges of each face, from corner k to the next. place: (E,) a number shared by
    coincident edges, for example at the rim of two meshes.
    """

    ends: np.ndarray
    root: np.ndarray
    middle: np.ndarray
    length: np.ndarray
    of_face: np.ndarray
    place: np.ndarray

    def conforming(self, marked: np.ndarray) -> np.ndarray:
        """Return the closure (E,) of the `marked` edges under conformity.

        The closure has coincident edges and the longest edge of every face with a marked edge. Bisection of longest edges
        avoids slivers (Rivara 1984).
        """
        longest = self.of_face[np.arange(len(self.of_face)), self.longest]
        while True:
            places = np.zeros(self.place.max(initial=0) + 1, bool)
            places[self.place[marked]] = True
            more = places[self.place]
            more[longest[more[self.of_face].any(1)]] = True
            if (more == marked).all():
                return marked
            marked = more

    @property
    def longest(self) -> np.ndarray:
        """Index (F,) of the longest edge of each face; the lowest place breaks ties, consistently for all faces."""
        length = np.round(self.length / max(float(self.length.max(initial=0.0)), 1e-30), 6)[self.of_face]
        return np.lexsort((self.place[self.of_face], -length), axis=1)[:, 0]

    @property
    def keys(self) -> np.ndarray:
        """Number (E,) of each edge, stable until the edge is cut."""
        return np.asarray(self.ends[:, 0] << 32 | self.ends[:, 1])


@dataclass(frozen=True, eq=False)
class Cut:
    """Subdivided triangles of receivers.

    faces: (F, 3) vertices. of: (F,) receiver triangle of each face. shares: (F, 3, 3) barycentric coordinates of each corner
    in that triangle. root, corner: (V,), (V, 3) a triangle of each vertex and the barycentric coordinates there.
    """

    faces: np.ndarray
    of: np.ndarray
    shares: np.ndarray
    root: np.ndarray
    corner: np.ndarray

    @staticmethod
    def whole(receivers: Receivers) -> Cut:
        """Return the receivers' triangles without cuts."""
        faces = receivers.surfaces.faces
        used, number = np.unique(faces, return_inverse=True)
        number = number.reshape(-1, 3)
        root, corner = np.zeros(len(used), np.int64), np.zeros((len(used), 3))
        for k in range(3):
            root[number[:, k]] = np.arange(len(faces))
            corner[number[:, k]] = np.eye(3)[k]
        return Cut(number, np.arange(len(faces)), np.broadcast_to(np.eye(3), (len(faces), 3, 3)), root, corner)

    def positions(self, receivers: Receivers) -> np.ndarray:
        """Return the positions (V, 3) of the vertices."""
        surfaces = receivers.surfaces
        return np.asarray((surfaces.positions[surfaces.faces[self.root]].astype(float) * self.corner[..., None]).sum(1))

    def edges(self, receivers: Receivers) -> Edges:
        """Return the edges of all faces, each once."""
        following = [1, 2, 0]
        pairs = np.sort(np.stack([self.faces, self.faces[:, following]], axis=2).reshape(-1, 2), axis=1)
        ends, first, number = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
        face, k = first // 3, first % 3
        middle = 0.5 * (self.shares[face, k] + self.shares[face, (k + 1) % 3])
        position = self.positions(receivers)
        length = np.linalg.norm(position[ends[:, 0]] - position[ends[:, 1]], axis=1)
        scale = max(float(np.ptp(position, axis=0).max()), 1e-30)
        _, spot = np.unique(np.round(position / (1e-6 * scale)).astype(np.int64), axis=0, return_inverse=True)
        _, place = np.unique(np.sort(spot.ravel()[ends], axis=1), axis=0, return_inverse=True)
        return Edges(ends, self.of[face], middle, length, number.reshape(-1, 3), place.ravel())

    def divided(self, edges: Edges, marked: np.ndarray) -> Cut:
        """Return the triangles with the conforming `marked` edges cut; new vertices come last, in edge order."""
        vertex = np.where(marked, len(self.root) + np.cumsum(marked) - 1, -1)[edges.of_face]  # midpoint vertex of each edge
        six = np.concatenate([self.faces, vertex], axis=1)  # corners 0..2, edge midpoints 3..5
        shares = np.concatenate([self.shares, 0.5 * (self.shares + self.shares[:, [1, 2, 0]])], axis=1)
        cut, longest = vertex >= 0, edges.longest
        made = [(np.flatnonzero(~cut.any(1)), [0, 1, 2])]
        for k in range(3):  # the longest edge first, then the remaining edge of each half
            a, b, c = k, (k + 1) % 3, (k + 2) % 3
            mine = cut.any(1) & (longest == k)
            for edge, whole, halves in (
                (b, [3 + k, b, c], ([3 + k, b, 3 + b], [3 + k, 3 + b, c])),
                (c, [a, 3 + k, c], ([a, 3 + k, 3 + c], [3 + c, 3 + k, c])),
            ):
                made.append((np.flatnonzero(mine & ~cut[:, edge]), whole))
                made += [(np.flatnonzero(mine & cut[:, edge]), half) for half in halves]
        return Cut(
            np.concatenate([six[some][:, corners] for some, corners in made]),
            np.concatenate([self.of[some] for some, _ in made]),
            np.concatenate([shares[some][:, corners] for some, corners in made]),
            np.concatenate([self.root, edges.root[marked]]),
            np.concatenate([self.corner, edges.middle[marked]]),
        )
