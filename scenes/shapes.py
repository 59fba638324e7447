"""The shapes that `generate.py` builds scenes from, and the writer that turns them into `.scene` and `.obj` files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Array = np.ndarray
Vector = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Shape:
    """Quads (Q, 4) and triangles (T, 3) over positions and normals (N, 3), counter-clockwise seen from outside."""

    positions: Array
    normals: Array
    quads: Array
    triangles: Array

    def write(self, path: Path, comment: str) -> None:
        v, n = self.positions, np.round(self.normals, 3) + 0.0
        text = [f"# {comment}\n"]
        text.append(("v %.7g %.7g %.7g\n" * len(v)) % tuple(v.reshape(-1).tolist()))
        text.append(("vn %.3g %.3g %.3g\n" * len(n)) % tuple(n.reshape(-1).tolist()))
        for faces in (self.quads, self.triangles):
            line = "f" + " %d//%d" * faces.shape[1] + "\n"
            text.append((line * len(faces)) % tuple(np.repeat(faces + 1, 2).tolist()))
        path.write_text("".join(text), encoding="utf-8", newline="\n")


def surface(
    f: Callable[[Array, Array], Sequence[Array]], rows: int, columns: int, ring: bool = True, tube: bool = False
) -> Shape:
    """The surface f(u, v) for u, v in 0..1 as rows x columns quads, facing along df/du x df/dv; smooth normals.

    ring: v is periodic. tube: u is periodic as well. Quads that a pole collapses become triangles.
    """

    u, v = np.meshgrid(np.arange(rows + (not tube)) / rows, np.arange(columns + (not ring)) / columns, indexing="ij")
    decimals = 4 if u.size < 1_000 else 6  # 0.1 mm keeps the bundled files small; a fine mesh would collapse at its poles
    positions = np.round(np.stack(np.broadcast_arrays(*f(u, v)), axis=-1).reshape(-1, 3), decimals) + 0.0  # + 0: no -0
    index = np.arange(u.size).reshape(u.shape)
    index = np.concatenate([index, index[:1]]) if tube else index
    index = np.concatenate([index, index[:, :1]], axis=1) if ring else index
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    a, b, c, d = (positions[quads[:, i]] for i in range(4))

    across = np.cross(c - a, d - b)  # twice the area times the quad's normal
    sums = [np.bincount(quads.reshape(-1), np.repeat(across[:, i], 4), len(positions)) for i in range(3)]
    normals: Array = np.stack(sums, axis=-1)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)

    first, last = (a == d).all(1), (b == c).all(1)  # collapsed at the start of u, at its end
    triangles = np.concatenate([quads[first & ~last][:, :3], quads[last & ~first][:, [0, 1, 3]]])
    return Shape(positions, normals, quads[~first & ~last], triangles)


def curve(points: Sequence[Vector]) -> Callable[[Array], Array]:
    """The Catmull-Rom curve through `points`, by a parameter in 0..1; the last axis is the point's."""
    p = np.asarray(points, float)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])

    def at(t: Array) -> Array:
        x = np.clip(t, 0.0, 1.0) * (len(p) - 3)
        i = np.minimum(x.astype(int), len(p) - 4)
        x = (x - i)[..., None]
        a, b, c, d = p[i], p[i + 1], p[i + 2], p[i + 3]
        point: Array = b + 0.5 * x * (c - a + x * (2 * a - 5 * b + 4 * c - d + x * (3 * (b - c) + d - a)))
        return point

    return at


def lathe(profile: Sequence[Vector], rows: int, columns: int) -> Shape:
    """The profile of (radius, height), bottom to top outside, turned about the y axis; a radius of 0 closes it."""
    at = curve(profile)
    points = np.asarray(profile, float)
    heads = points[[0, -1], 0] == 0.0
    low, high = points[:, 1].min(), points[:, 1].max()  # the curve may overshoot; a foot must not sink in

    def f(u: Array, v: Array) -> tuple[Array, Array, Array]:
        r, y = np.moveaxis(at(u), -1, 0)
        y = np.clip(y, low, high)
        r = np.where((heads[0] & (u <= 0.0)) | (heads[1] & (u >= 1.0)), 0.0, np.maximum(r, 0.0))
        return r * np.cos(2 * np.pi * v), y, r * np.sin(2 * np.pi * v)

    return surface(f, rows, columns)


def ball(rows: int, columns: int, bump: Callable[[Array, Array, Array], Array | float] = lambda x, y, z: 0.0) -> Shape:
    """The unit sphere, pushed out by `bump` of the direction."""

    def f(u: Array, v: Array) -> tuple[Array, Array, Array]:
        s = np.sin(np.pi * u)
        x, y, z = s * np.cos(2 * np.pi * v), -np.cos(np.pi * u), s * np.sin(2 * np.pi * v)
        r = 1.0 + bump(x, y, z)
        return r * x, r * y, r * z

    return surface(f, rows, columns)


def torus(radius: float, tube: float, rows: int, columns: int) -> Shape:
    """A ring about the y axis; `radius` runs to the tube's centre."""

    def f(u: Array, v: Array) -> tuple[Array, Array, Array]:
        r = radius + tube * np.cos(2 * np.pi * u)
        return r * np.cos(2 * np.pi * v), tube * np.sin(2 * np.pi * u), r * np.sin(2 * np.pi * v)

    return surface(f, rows, columns, tube=True)


def pipe(path: Sequence[Vector], rows: int, columns: int) -> Shape:
    """A tube along a curve in the plane z = 0; `path` holds (x, y, radius), and it is open at both ends."""
    at = curve(path)

    def f(u: Array, v: Array) -> tuple[Array, Array, Array]:
        x, y, r = np.moveaxis(at(u), -1, 0)
        tangent = at(np.minimum(u + 1e-4, 1.0)) - at(np.maximum(u - 1e-4, 0.0))
        side = r * np.cos(2 * np.pi * v) / np.hypot(tangent[..., 0], tangent[..., 1])
        return x + side * tangent[..., 1], y - side * tangent[..., 0], r * np.sin(2 * np.pi * v)

    return surface(f, rows, columns)


def sheet(points: Sequence[Vector], width: float, rows: int) -> Shape:
    """The curve through `points` (y, z), drawn `width` wide along x, centred; it faces up where z falls."""
    at = curve(points)
    return surface(lambda u, v: ((v - 0.5) * width, at(u)[..., 0], at(u)[..., 1]), rows, 1, ring=False)


def cube() -> Shape:
    """The unit cube from 0 0 0 to 1 1 1."""
    corner = np.array([[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]], float)
    positions, normals = [], []
    for axis in range(3):
        low = np.roll(corner, axis, axis=1)
        high = low[::-1] + np.eye(3)[axis]
        positions += [low, high]
        normals += [np.tile(-np.eye(3)[axis], (4, 1)), np.tile(np.eye(3)[axis], (4, 1))]
    return Shape(np.concatenate(positions), np.concatenate(normals), np.arange(24).reshape(6, 4), np.zeros((0, 3), int))


class Writer:
    """Writes one scene: shapes once each as .obj files, and the lines of the .scene that place them."""

    def __init__(self, folder: Path, name: str, detail: float, comment: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.name, self.detail = folder, name, detail
        self.lines = [f"# {line}" for line in comment.split("\n")]
        self.lines.append(f"# Made by scenes/generate.py {name} --detail {detail:g}: change it there.")

    def n(self, count: int) -> int:
        """A number of rows or columns, scaled so that triangles grow with `detail`."""
        return max(3, round(count * math.sqrt(self.detail)))

    def say(self, *lines: str) -> None:
        self.lines.extend(lines)

    def light(self, name: str, *lines: str) -> None:
        (self.folder / f"{name}.light").write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
        self.say(f"light {name}.light")

    def shape(self, name: str, shape: Shape) -> None:
        shape.write(self.folder / f"{name}.obj", f"{name}, made by scenes/generate.py {self.name} --detail {self.detail:g}")

    def color(self, r: float, g: float, b: float, comment: str = "") -> None:
        self.say("", *([f"# {comment}"] if comment else []), f"brdf diffuse {r:g} {g:g} {b:g} 1")

    def draw(self, name: str, at: Vector = (0, 0, 0), *, size: Vector = (1, 1, 1), turn: Sequence[Vector] = ()) -> None:
        """Places a shape: scaled by `size`, then turned by each (degrees, x, y, z), the last one first, then moved."""
        self.say("push", "trans " + _words(at), *("rotate " + _words(t) for t in turn))
        self.say(*(["scale " + _words(size)] if tuple(size) != (1, 1, 1) else []), f"obj {name}.obj", "pop")

    def box(self, x: Vector, y: Vector, z: Vector) -> None:
        """An upright box from one corner to the other; each axis as (low, high)."""
        self.draw("cube", (x[0], y[0], z[0]), size=(x[1] - x[0], y[1] - y[0], z[1] - z[0]))

    def done(self) -> None:
        (self.folder / f"{self.name}.scene").write_text("\n".join(self.lines) + "\n", encoding="utf-8", newline="\n")


def _words(values: Vector) -> str:
    return " ".join(f"{value:.6g}" for value in np.round(values, 6) + 0.0)
