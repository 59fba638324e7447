"""Triangles that are cut at the middles of their edges, so that no edge has a vertex of a neighbour in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.app.bake.places import Receivers


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a Cut. ends: (E, 2) vertices; root, middle: (E,), (E, 3) a triangle on which the middle lies, and where;
    length: (E,) metres. of_face: (F, 3) the edges of the faces, from corner k to the next. place: (E,) a number for each, the
    same for those that lie in one place, at the rim of two meshes say."""

    ends: np.ndarray
    root: np.ndarray
    middle: np.ndarray
    length: np.ndarray
    of_face: np.ndarray
    place: np.ndarray

    def conforming(self, marked: np.ndarray) -> np.ndarray:
        """(E,) bool: the `marked` edges, and those that are to be cut as well: in the same place, and the longest one of every
        face that is cut at all, so that no slivers come of it (Rivara 1984)."""
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
        """(F,) which of its three edges is the longest of each face; of equal ones that of the lowest place, for all faces
        alike."""
        length = np.round(self.length / max(float(self.length.max(initial=0.0)), 1e-30), 6)[self.of_face]
        found: np.ndarray = np.lexsort((self.place[self.of_face], -length), axis=1)[:, 0]
        return found

    @property
    def keys(self) -> np.ndarray:
        """(E,) a number of each edge, by which it is known as long as it is not cut."""
        found: np.ndarray = self.ends[:, 0] << 32 | self.ends[:, 1]
        return found


@dataclass(frozen=True, eq=False)
class Cut:
    """Triangles of receivers, cut. faces: (F, 3) vertices; of: (F,) the receivers' triangle that each is a part of; shares:
    (F, 3, 3) of that one's corners, where each corner lies. root, corner: (V,), (V, 3) the same of each vertex, on one of its
    triangles."""

    faces: np.ndarray
    of: np.ndarray
    shares: np.ndarray
    root: np.ndarray
    corner: np.ndarray

    @staticmethod
    def whole(receivers: Receivers) -> Cut:
        """The receivers' triangles as they are."""
        faces = receivers.surfaces.faces
        used, number = np.unique(faces, return_inverse=True)
        number = number.reshape(-1, 3)
        root, corner = np.zeros(len(used), np.int64), np.zeros((len(used), 3))
        for k in range(3):
            root[number[:, k]] = np.arange(len(faces))
            corner[number[:, k]] = np.eye(3)[k]
        return Cut(number, np.arange(len(faces)), np.broadcast_to(np.eye(3), (len(faces), 3, 3)), root, corner)

    def positions(self, receivers: Receivers) -> np.ndarray:
        """(V, 3) where the vertices lie."""
        surfaces = receivers.surfaces
        found: np.ndarray = (surfaces.positions[surfaces.faces[self.root]].astype(float) * self.corner[..., None]).sum(1)
        return found

    def edges(self, receivers: Receivers) -> Edges:
        """The edges of all faces, each once."""
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
        """The same with the `marked` edges cut, which conform; the new vertices come last, in the order of the edges."""
        vertex = np.where(marked, len(self.root) + np.cumsum(marked) - 1, -1)[edges.of_face]  # in the middle of each edge
        six = np.concatenate([self.faces, vertex], axis=1)  # corners 0..2, middles of edges 3..5
        shares = np.concatenate([self.shares, 0.5 * (self.shares + self.shares[:, [1, 2, 0]])], axis=1)
        cut, longest = vertex >= 0, edges.longest
        made = [(np.flatnonzero(~cut.any(1)), [0, 1, 2])]
        for k in range(3):  # across the longest edge, and then each half across its own old edge
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
