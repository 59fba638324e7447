"""The mesh of a triangle, its name and its bounds, and the place of points on the screen."""

from __future__ import annotations

import numpy as np

from irrsplat.core.vectors import box
from irrsplat.scene.appearance import order
from irrsplat.scene.model import Camera, Mesh, Scene


def object_name(scene: Scene, number: int) -> str:
    return scene.meshes[number].name or f"mesh {number + 1}"


def bounds_of(mesh: Mesh) -> np.ndarray:
    """Return (2, 3) float64 the ends of a mesh's bounding box; 0 0 0 for a mesh without points."""
    return box(mesh.positions).astype(float) if len(mesh.positions) else np.zeros((2, 3))


def meshes_of(scene: Scene, triangles: np.ndarray) -> np.ndarray:
    """Return (N,) the number of the mesh of each triangle, -1 for none. triangles: (N,) numbers in the order of drawing."""
    numbers = np.array([*order(scene), -1])
    ends = np.cumsum([len(scene.meshes[i].faces) for i in numbers[:-1]])
    found: np.ndarray = np.where(triangles < 0, -1, numbers[np.searchsorted(ends, triangles, side="right")])
    return found


def on_screen(camera: Camera, size: tuple[float, float], point: tuple[float, float, float]) -> tuple[float, float] | None:
    """Return the place of a world point in a picture of `size` (width, height), from the upper left; None behind the eye."""
    x, y, z = camera.axes @ (np.asarray(point) - np.asarray(camera.eye))
    if z >= 0.0:
        return None
    per_metre = size[1] / camera.screen / -z
    return 0.5 * size[0] + x * per_metre, 0.5 * size[1] - y * per_metre


def pixel_of(camera: Camera, size: tuple[int, int], point: tuple[float, float, float]) -> tuple[int, int] | None:
    """Return the pixel of a picture that contains a world point; None for a point outside of the picture."""
    place = on_screen(camera, size, point)
    inside = place is not None and all(0.0 <= at < most for at, most in zip(place, size, strict=True))
    return (int(place[0]), int(place[1])) if place is not None and inside else None
