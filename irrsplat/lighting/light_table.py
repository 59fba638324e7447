"""Lights of a scene for shaders: a table of numbers, the tiles of their shadow maps, and defines for the kinds present.

A point light or luminaire inside the scene's bounding box, or a spot with a cone wider than 160°, has six tiles, a cube's faces.
A narrower cone, a light outside the box and a directional light have one. In a vast scene, a directional light also has
cascades: tiles with narrower texels around the eye.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from irrsplat.core.buffers import LIGHT_ROWS, LightRow
from irrsplat.core.color import LUMINANCE, LUMINOUS_EFFICACY
from irrsplat.core.glsl import CASCADE_RATIO, ROUNDING
from irrsplat.lighting.luminaire_table import halvings, photometries
from irrsplat.scene.model import Light, Scene

# right, up and forward of the cube faces +x -x +y -y +z -z, in the order in which lighting/lights.glsl numbers them;
# right × up = -forward as in any OpenGL view, so that triangles keep their winding
_X, _Y, _Z = np.eye(3)
_CUBE = np.array([[_Z, _Y, _X], [_Y, _Z, -_X], [_X, _Z, _Y], [_Z, _X, -_Y], [_Y, _X, _Z], [_X, _Y, -_Z]])
_WIDEST_CONE = 80.0  # degrees: the greatest half angle of a cone that one tile covers
_NARROWEST = 1e-6  # least tangent, for a scene of a single point, as with all meshes hidden
_TEXEL = 1.6e-3, 0.02  # of the diagonal, and metres: greatest width of texels around the eye; a wall is wider, or light leaks
_TEXELS = 1024  # along a tile, for the choice of the number of cascades
_MOST_CASCADES = 3  # greatest number of cascades of a directional light
_GUARD = 2  # texels around a tile, so that dithered samples stay inside it


def _axes(forward: np.ndarray) -> np.ndarray:
    """Return (3, 3) rows right, up, forward: an orthonormal frame about the unit vector `forward`."""
    helper = np.eye(3)[np.argmin(np.abs(forward))]
    right = np.cross(helper, forward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, forward), forward])


def _unit(v: np.ndarray) -> np.ndarray:
    return np.asarray(v / np.linalg.norm(v))


def _single(light: Light, scene: Scene) -> tuple[np.ndarray, float] | None:
    """Return axis and tangent of half the angle of one perspective tile that covers the light's reach; None: it takes six."""
    position = np.asarray(light.position, float)
    if light.spot_target is not None and light.has_cone and light.spot_cutoff <= _WIDEST_CONE:
        return _unit(np.subtract(light.spot_target, position)), float(np.tan(np.radians(light.spot_cutoff)))
    low, high = scene.bounds
    if (position >= low).all() and (position <= high).all():
        return None
    # outside the bounding box, a tile that covers the box's corners covers all of it
    axes = _axes(_unit(scene.bounds.mean(0) - position))
    corners = (scene.corners - position) @ axes.T
    if corners[:, 2].min() <= 0.0:
        return None
    tangent = max(float((np.abs(corners[:, :2]).max(1) / corners[:, 2]).max()), _NARROWEST)
    return (axes[2], 1.01 * tangent) if tangent <= np.tan(np.radians(_WIDEST_CONE)) else None


def parallel_frame(light: Light, scene: Scene) -> tuple[np.ndarray, float]:
    """Return rows (3, 4) right, up and forward of a directional light, and the radius of the scene's bounding box in metres.

    The rows are dotted with (p, 1): right and up are 0 in the middle of the box's shaded part, forward in the middle of the box.
    """
    axes, part = _axes(-_unit(np.asarray(light.position, float))), scene.shaded_bounds.mean(0)
    middles = np.stack([part, part, scene.bounds.mean(0)])
    return np.concatenate([axes, -(axes * middles).sum(1, keepdims=True)], axis=1), 0.5 * scene.diagonal * 1.001


def across(rows: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return (2, 2), the least and greatest right and up of a box (2, 3) in the frame of these `rows`, metres."""
    middle, half = rows[:2, :3] @ box.mean(0) + rows[:2, 3], np.abs(rows[:2, :3]) @ (0.5 * np.ptp(box, axis=0))
    return np.stack([middle - half, middle + half])


def cascades(scene: Scene) -> int:
    """Return the number of cascades of directional lights, 0 without one: each has texels of 1/CASCADE_RATIO of the width."""
    if not any(light.directional for light in scene.lights):
        return 0
    texel, greatest = _extent(scene) / _TEXELS, min(_TEXEL[0] * scene.diagonal, _TEXEL[1])
    return min(math.ceil(math.log(max(texel / greatest, 1.0), CASCADE_RATIO)), _MOST_CASCADES)


def _extent(scene: Scene) -> float:
    """Return metres, the greatest width of a directional light's first tile, in any direction."""
    return float(np.linalg.norm(np.ptp(scene.shaded_bounds, axis=0)))


def focus_of(scene: Scene, eyes: np.ndarray) -> tuple[float, ...]:
    """Return the middle of the cascades, near the first of the `eyes` (N, 3), metres; empty without cascades.

    It stays until the eye has moved by about a quarter of the narrowest tile.
    """
    if not (count := cascades(scene)) or not len(eyes):
        return ()
    step = _extent(scene) / (8.0 * CASCADE_RATIO**count)
    return tuple((np.round(eyes[0] / step) * step).tolist())


def _tiles(light: Light, scene: Scene, side: int, focus: tuple[float, ...]) -> tuple[np.ndarray, float, float]:
    """Return the light's tiles (T, 3, 4) as rows dotted with (p, 1), the scale of the first one, and their depth in metres (0:
    perspective)."""
    position = np.asarray(light.position, float)
    grow = side / (side - 2 * _GUARD)
    if light.directional:
        rows, radius = parallel_frame(light, scene)
        scale = 1.0 / (1.001 * max(float(across(rows, scene.shaded_bounds).max()), _NARROWEST * radius) * grow)
        rows[:2] *= scale
        rows[2] = (rows[2] + [0, 0, 0, radius]) / (2 * radius)
        tiles = np.tile(rows, (1 + cascades(scene) if focus else 1, 1, 1))
        if focus:
            tiles[1:, :2, 3] -= rows[:2] @ [*focus, 1.0]
            tiles[1:, :2] *= CASCADE_RATIO ** np.arange(1.0, len(tiles))[:, None, None]
        return tiles, scale, 2 * radius
    single = _single(light, scene)
    axes, tangent = (_CUBE, 1.0) if single is None else (_axes(single[0])[None], single[1])
    scale = 1.0 / (tangent * grow)
    rows = np.concatenate([axes, -(axes @ position)[..., None]], axis=2)
    rows[:, :2] *= scale
    return rows, scale, 0.0


def depth_range(scene: Scene) -> float:
    """Return the metres of depth in perspective tiles: from any light to the farthest corner of the scene's bounding box."""
    places = np.array([light.position for light in scene.lights if not light.directional]).reshape(-1, 3)
    return float(np.linalg.norm(scene.corners - places[:, None], axis=-1).max(initial=0.0)) or scene.diagonal


def near_plane(scene: Scene) -> float:
    """Return the metres within which geometry touches a light, as far as float32 can resolve, and casts no shadow."""
    return ROUNDING * depth_range(scene)


@dataclass(frozen=True)
class LightTable:
    """The lights' numbers, and the tiles of their shadow maps.

    rows: (LIGHT_ROWS·lights, 4), LightRow names them; one light of zeros for none. tiles: (T, 3, 4) rows right·scale,
    up·scale and forward of every tile, dotted with (p, 1). parallel: (T,) bool, the tiles of directional lights. far: metres of
    depth in the others.
    """

    rows: np.ndarray
    tiles: np.ndarray
    parallel: np.ndarray
    far: float


def light_table(scene: Scene, side: int, focus: tuple[float, ...] = ()) -> LightTable:
    """Return the table of the scene's lights for shadow tiles of `side` texels. focus: of cascades, see `focus_of`."""
    table = np.zeros((max(len(scene.lights), 1), LIGHT_ROWS, 4))
    tiles: list[np.ndarray] = []
    parallel: list[bool] = []
    for light, row in zip(scene.lights, table, strict=False):
        matrices, scale, depth = _tiles(light, scene, side, focus)
        direction = np.asarray(light.position, float)
        row[LightRow.POSITION] = [*(_unit(direction) if light.directional else direction), light.directional]
        # OpenGL's light: E = π·diffuse·cosθ·spot/(k_c + k_l·d + k_q·d²); with an intensity I: E = I·cosθ·spot/d²;
        # I of a luminaire is its colour times its photometry
        cube = len(matrices) > 1 and not light.directional
        row[LightRow.COLOR] = [*(np.asarray(light.color) * (1.0 if light.physical else np.pi)), len(_CUBE) if cube else 1]
        row[LightRow.FALLOFF] = [*((0, 0, 1) if light.physical else light.attenuation), light.spot_exponent]
        if light.spot_target is not None and light.has_cone:
            row[LightRow.SPOT] = [*_unit(np.subtract(light.spot_target, light.position)), 1.0]
        row[LightRow.CONE] = [np.radians(light.spot_cutoff), np.radians(light.spot_inner), len(tiles), scale]
        if light.directional:
            row[LightRow.CONE, 0] = depth
            row[LightRow.FALLOFF, :3] = [*(matrices[0, :2] @ [*(focus or (0.0, 0.0, 0.0)), 1.0]), len(matrices) - 1]
        if not cube:
            row[LightRow.TILE :] = matrices[0]
        tiles += list(matrices)
        parallel += [light.directional] * len(matrices)
    return LightTable(table.reshape(-1, 4), np.array(tiles).reshape(-1, 3, 4), np.array(parallel, bool), depth_range(scene))


def _cubes(scene: Scene) -> list[bool]:
    """Return True for each light with six tiles, False for each with one."""
    return [not light.directional and _single(light, scene) is None for light in scene.lights]


def tile_count(scene: Scene) -> int:
    """Return the number of shadow tiles of the scene's lights."""
    parallel = sum(light.directional for light in scene.lights)
    return sum(6 if cube else 1 for cube in _cubes(scene)) + parallel * cascades(scene)


def sheet(count: int, side: int, limit: int) -> tuple[int, int, int]:
    """Return the side of `count` tiles, columns and rows in one texture of at most `limit` texels a side.

    The side is `side`, or the greatest that fits.
    """
    count = max(count, 1)
    side = min(side, limit // (math.isqrt(count - 1) + 1))
    most = limit // side
    columns = max(min(count, 8, most), -(-count // most))  # more than 8 only where so many rows would not fit
    return side, columns, -(-count // columns)


def light_defines(scene: Scene) -> dict[str, int]:
    """Return the defines of shaders/lighting/lights.glsl: number and kinds of the lights."""
    different, cubes = photometries(scene.lights), _cubes(scene)
    return {
        "LIGHTS": len(scene.lights),
        "LIGHTS_WITH_CUBE": int(any(cubes)),
        "LIGHTS_WITH_TILE": int(not all(cubes)),
        "LIGHTS_PARALLEL": int(any(light.directional for light in scene.lights)),
        "LIGHTS_CASCADED": int(cascades(scene) > 0),
        "LIGHTS_WITH_CONE": int(any(light.has_cone for light in scene.lights)),
        "LIGHTS_WITH_LUMINAIRE": int(bool(different)),
        **({"PHOTOMETRY_HALVINGS": halvings(different)} if different else {}),
    }


def unshadowed_luminance(scene: Scene) -> float:
    """Return the luminance in W/(m² sr) of a white surface that faces all lights and the sky of the scene, without any shadow.

    The surface is in the middle of the scene. No light counts as nearer than half of the diagonal.
    """
    low, high = scene.shaded_bounds
    total, nearest = float(LUMINANCE @ np.asarray(scene.sky)), max(0.5 * float(np.linalg.norm(high - low)), 1e-30)
    for light in scene.lights:
        distance = max(float(np.linalg.norm(np.subtract(light.position, 0.5 * (low + high)))), nearest)
        peak = light.output[1] / LUMINOUS_EFFICACY if light.photometry is not None else float(LUMINANCE @ np.asarray(light.color))
        total += peak * light.strength(distance) / np.pi
    return total
