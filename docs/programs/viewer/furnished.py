"""A furnished room for `first_minute.py`: a window with sky and sun, and clutter of 78 000 triangles."""

from __future__ import annotations

import numpy as np
import trimesh
from trimesh.creation import box, capsule, cylinder, icosphere, torus
from trimesh.transformations import rotation_matrix

import irrsplat
from irrsplat.scene.model import Mesh, Scene

Colour = tuple[float, float, float]
WOOD, FABRIC, WHITE, BRASS = (0.45, 0.28, 0.15), (0.16, 0.25, 0.33), (0.8, 0.78, 0.74), (0.5, 0.4, 0.2)


def block(*bounds: float) -> trimesh.Trimesh:
    """Return a box between x0, x1, y0, y1, z0 and z1."""
    return box(bounds=np.array(bounds).reshape(3, 2).T)


def rounded(*bounds: float) -> trimesh.Trimesh:
    """Return an ellipsoid of the fourth order, such as a cushion, between x0, x1, y0, y1, z0 and z1."""
    (low, high), ball = np.array(bounds).reshape(3, 2).T, icosphere(subdivisions=3)
    unit = ball.vertices / (np.abs(ball.vertices) ** 4).sum(1, keepdims=True) ** 0.25
    ball.vertices = 0.5 * (low + high) + 0.5 * (high - low) * unit
    return ball


def upright(shape: trimesh.Trimesh, x: float, y: float, z: float) -> trimesh.Trimesh:
    """Return a shape with its axis upright and its middle at x, y, z."""
    return shape.apply_transform(rotation_matrix(np.pi / 2.0, (1, 0, 0))).apply_translation((x, y, z))


def chair(x: float, z: float, back: float) -> list[trimesh.Trimesh]:
    """Return a chair. back: -1 or 1, the side of its back along z."""
    legs = [upright(cylinder(0.02, 0.45, 24), x + a, 0.225, z + b) for a in (-0.18, 0.18) for b in (-0.18, 0.18)]
    rungs = [upright(capsule(0.5, 0.015), x + a, 0.7, z + 0.19 * back) for a in (-0.16, -0.08, 0.0, 0.08, 0.16)]
    return [*legs, *rungs, rounded(x - 0.22, x + 0.22, 0.43, 0.49, z - 0.22, z + 0.22)]


def parts() -> list[tuple[str, Colour, list[trimesh.Trimesh]]]:
    """Return the name, the reflectance and the shapes of each object."""
    w, h, d, t = 5.0, 2.6, 4.0, 0.2  # metres: x, y, z, and the thickness of the walls; the window is in the wall at x = w
    frame = [block(w, w + t, *yz) for yz in ((0, 0.9, 0, d), (2.2, h, 0, d), (0.9, 2.2, 0, 1.0), (0.9, 2.2, 3.0, d))]
    bars = [block(w, w + 0.05, 0.9, 2.2, z, z + 0.05) for z in (1.0, 1.975, 2.95)]
    walls = [block(-t, 0, 0, h, 0, d), block(0, w, 0, h, -t, 0), block(0, w, 0, h, d, d + t), *frame]
    shelf = [block(2.8, 4.2, y, y + 0.03, 0, 0.3) for y in (0.1, 0.5, 0.9, 1.3, 1.7, 2.0)]
    shelf += [block(x, x + 0.03, 0, 2.03, 0, 0.3) for x in (2.77, 4.2)]
    sofa = [rounded(0.9 + 0.8 * i, 1.7 + 0.8 * i, 0.2, 0.48, 0.2, 0.95) for i in (0, 1)]
    sofa += [rounded(0.9 + 0.8 * i, 1.7 + 0.8 * i, 0.42, 0.85, 0.02, 0.3) for i in (0, 1)]
    sofa += [rounded(x, x + 0.2, 0.1, 0.62, 0.02, 0.95) for x in (0.72, 2.48)]
    table = [upright(cylinder(0.55, 0.04, 96), 3.4, 0.73, 2.0), upright(cylinder(0.05, 0.7, 48), 3.4, 0.36, 2.0)]
    dishes = [upright(torus(0.09, 0.015), 3.4 + a, 0.77, 2.0 + b) for a, b in ((-0.3, 0.1), (0.3, -0.1), (0.05, 0.3))]
    dice, books = np.random.default_rng(1), dict[Colour, list[trimesh.Trimesh]]()
    colours = (0.5, 0.12, 0.1), (0.1, 0.2, 0.4), (0.5, 0.42, 0.2), (0.15, 0.3, 0.15), (0.6, 0.58, 0.5)
    for y in (0.13, 0.53, 0.93, 1.33):
        x = 2.82
        while x < 4.1:
            thick, tall, deep = dice.uniform((0.02, 0.18, 0.16), (0.06, 0.32, 0.24))
            books.setdefault(colours[dice.integers(5)], []).append(block(x, x + thick, y, y + tall, 0.02, deep))
            x += thick + 0.004 + 0.2 * (dice.random() < 0.06)
    leaves = [rounded(*np.repeat(c, 2) + np.tile((-0.07, 0.07), 3)) for c in dice.normal((4.6, 0.95, 0.4), 0.12, (12, 3))]
    return [
        ("walls", (0.72, 0.68, 0.6), walls), ("floor", (0.38, 0.24, 0.14), [block(-t, w + t, -t, 0, -t, d + t)]),
        ("ceiling", WHITE, [block(-t, w + t, h, h + t, -t, d + t)]), ("window", WHITE, bars), ("shelf", WOOD, shelf),
        ("rug", (0.45, 0.12, 0.1), [block(0.9, 3.0, 0, 0.012, 1.1, 2.6)]), ("sofa", FABRIC, sofa), ("table", WOOD, table),
        ("chairs", WOOD, [*chair(3.4, 1.25, -1), *chair(3.4, 2.8, 1)]), ("dishes", WHITE, dishes),
        ("vase", FABRIC, [rounded(3.32, 3.48, 0.75, 1.0, 1.92, 2.08)]), ("pot", BRASS, [rounded(4.45, 4.85, 0, 0.4, 0.3, 0.7)]),
        ("plant", (0.12, 0.3, 0.08), leaves), *((f"books {i}", c, b) for i, (c, b) in enumerate(books.items())),
    ]  # fmt: skip


def room() -> Scene:
    """Return the room, in the evening sun."""
    meshes: list[Mesh] = []
    for name, colour, shapes in parts():
        whole = trimesh.util.concatenate(shapes)
        meshes.append(irrsplat.make_mesh(whole.vertices, whole.faces, irrsplat.Material(albedo=colour), name=name))
    camera = irrsplat.Camera((1.0, 1.6, 3.3), (2.9, 0.8, 1.0), fov=66.0)
    return irrsplat.make_scene(meshes, [], [camera], sky="cie clear sun 30 60")
