"""Scenes for light leaks: two rooms, a table and a ball; their views, and references at pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.indirect.paper_scan import Seen, read_back
from irrsplat.scene.model import Camera, Material, Mesh, Scene
from tests.support.worlds import box, gather, material, point_light, quad, scene, sphere

SIZE = (160, 120)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
UP = (0.0, 1.0, 0.0)
GREY, RED, WHITE = material(0.5), material((0.7, 0.2, 0.15)), material(0.8)
X, Y, Z = 4.0, 2.5, 2.0  # metres: each room is X wide, Y high and 2·Z deep; the wall is at x = 0, the lit room where x < 0
WALL = 0.01  # metres


def rooms(wall: float = WALL, without: str = "") -> Scene:
    """Return two rooms with a common ceiling and floor, separated by a `wall` of this thickness (0: a sheet); one is lit.

    The light is in the room where x < 0. without: the missing part, "ceiling", "end" (the wall at z = Z) or "".
    """
    part = quad((0, 0, -Z), (0, 0, 2 * Z), (0, Y, 0), WHITE)
    if wall:
        part = box((-wall / 2, 0, -Z), (wall / 2, Y, Z), WHITE)
    parts = {
        "floor": quad((-X, 0, Z), (2 * X, 0, 0), (0, 0, -2 * Z), GREY),
        "ceiling": quad((-X, Y, -Z), (2 * X, 0, 0), (0, 0, 2 * Z), WHITE),
        "back": quad((-X, 0, -Z), (2 * X, 0, 0), (0, Y, 0), RED),
        "end": quad((X, 0, Z), (-2 * X, 0, 0), (0, Y, 0), WHITE),
        "left": quad((-X, 0, Z), (0, 0, -2 * Z), (0, Y, 0), WHITE),
        "right": quad((X, 0, -Z), (0, 0, 2 * Z), (0, Y, 0), WHITE),
        "part": part,
    }
    return scene(*(mesh for name, mesh in parts.items() if name != without), lights=(point_light((-1.5, 2.0, 0.3), 20.0),))


def in_the_dark(position: np.ndarray, normal: np.ndarray, wall: float = WALL) -> np.ndarray:
    """Return a mask (…,) of points (…, 3) in the dark room; normals point towards the eye."""
    return (position[..., 0] > wall / 2 + 1e-4) | ((position[..., 0] > wall / 2 - 1e-4) & (normal[..., 0] > 0.5))


def table() -> Scene:
    """Return a room with a table of 1.6 by 0.9 m, its top 2 cm thick at 70 cm on four legs, and a light above it."""
    legs = [box((x, 0, z), (x + 0.05, 0.68, z + 0.05), RED) for x in (-0.75, 0.70) for z in (-0.4, 0.35)]
    return scene(room(), box((-0.8, 0.68, -0.45), (0.8, 0.70, 0.45), RED), *legs, lights=(point_light((0.3, 2.0, 0.2), 20.0),))


def resting() -> Scene:
    """Return a room with a ball of 40 cm radius on its floor."""
    return scene(room(), sphere((0.0, 0.4, 0.0), 0.4, RED), lights=(point_light((1.2, 2.2, 0.9), 20.0),))


def room() -> Mesh:
    """Return a room of four by four metres, Y high, facing inward."""
    return box((-2, 0, -2), (2, Y, 2), Material((0.6, 0.6, 0.6)), outward=False)


# ---- views -------------------------------------------------------------------------------------------------------------


def camera(eye: Sequence[float], target: Sequence[float], fov: float = 60.0) -> Camera:
    """Return an upright camera, or one straight down."""
    down = np.hypot(eye[0] - target[0], eye[2] - target[2]) < 1e-3
    return Camera(tuple(eye), tuple(target), (0.0, 0.0, -1.0) if down else UP, fov)  # type: ignore[arg-type]


def random_cameras(low: Sequence[float], high: Sequence[float], count: int, seed: int = 3) -> list[Camera]:
    """Return random cameras in a box with random targets in it."""
    rng = np.random.default_rng(seed)
    return [camera(*rng.uniform(low, high, (2, 3))) for _ in range(count)]


@dataclass(frozen=True)
class Look:
    """View: visible surfaces of the g-buffer, and the renderer's irradiance (H, W, 3)."""

    seen: Seen
    irradiance: np.ndarray
    records: int

    def where(self, some: np.ndarray, count: int, seed: int = 1) -> np.ndarray:
        """Return rows and columns (≤ count, 2) of random pixels in the mask `some` (H, W)."""
        return np.random.default_rng(seed).permutation(np.argwhere(some & self.seen.mask))[:count]

    def sites(self, pixels: np.ndarray) -> Sites:
        """Return the points at pixels (N, 2)."""
        at = tuple(pixels.T)
        seen = self.seen
        assert seen.triangle is not None
        return Sites(seen.position[at], seen.normal[at], seen.geometric[at], seen.triangle[at])


def look(
    ctx: moderngl.Context, world: Scene, cameras: Sequence[Camera], how: str, size: tuple[int, int] = SIZE, **rest: Any
) -> list[Look]:
    """Render the views from `cameras` in turn with the gather `how` and one common cache."""
    out = []
    with irrsplat.Renderer(world, size, ctx=ctx, gather=how, **({"bounces": 1} | rest)) as renderer:
        for one in cameras:
            frame = renderer.render(one)
            view, _ = renderer.frame(one, gather=False)
            out.append(Look(read_back(view.gbuffer), frame.irradiance, frame.stats["records"]))
    return out


def truth(ctx: moderngl.Context, world: Scene, views: Sequence[Look], pixels: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return E (N, 3) at pixels (N, 2) of each view, by 12 thousand rays per pixel, without interpolation.

    The result is within 1 % of four times as many rays.
    """
    parts = [view.sites(at) for view, at in zip(views, pixels, strict=True)]
    joined = Sites(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("position", "normal", "geometric", "triangle"))
    )
    E = gather(ctx, world, joined, 112, "trace", 32, 1024).E
    return np.split(E, np.cumsum([len(p) for p in parts])[:-1])
