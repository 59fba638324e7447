"""Weight of a record at a point, and radii of records in a view, in numpy; shaders/records has the same formulas in GLSL."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.color import LUMINANCE
from irrsplat.core.glsl import BRIGHT
from irrsplat.scene.model import Camera
from irrsplat.settings import IN_FRONT, LEAST_ERROR, Settings

LUNES = 0.75  # of (1 - n·n_k)·E: missing part of n·M on a surface turned away from the record's (docs/METHOD.md, 4.1)


def record_defines(gradients: bool) -> dict[str, object]:
    """Return the defines of shaders/records/weight.glsl and record.glsl, for records with derivatives or without."""
    return {"GRADIENTS": int(gradients), "LEAST_ERROR": LEAST_ERROR, "IN_FRONT": IN_FRONT, "LUNES": LUNES}


def record_uniforms(settings: Settings) -> Uniforms:
    """Return the uniforms of shaders/records/weight.glsl and record.glsl that depend on the settings."""
    return {"a": settings.a, "hessian": settings.hessian}


def error_scale(Y: np.ndarray, luminance_floor: float) -> np.ndarray:
    """Return (N,) W/m²: the luminance that errors are relative to, where the luminance is Y (N,), as in error_scale.glsl."""
    bright = BRIGHT * luminance_floor if luminance_floor > 0.0 else 1e30
    return np.asarray(np.where(bright < Y, np.sqrt(bright * np.maximum(Y, 0.0)), np.maximum(Y, max(luminance_floor, 1e-20))))


def own_radii(columns: Mapping[str, np.ndarray], luminance_floor: float, settings: Settings) -> np.ndarray:
    """Return (N, 2) metres: R along the axis of records and across it, before limits and before the factor a.

    Formula of record_ellipse in shaders/records/record.glsl. columns: (N, …), of record_layout.COLUMNS.
    """
    R = columns["radius"]
    if settings.gradients:  # R <= E/|∇E|
        slope = np.linalg.norm(np.einsum("ncx,c->nx", columns["gradient"], LUMINANCE), axis=1)
        Y = columns["irradiance"] @ LUMINANCE
        E = np.maximum(Y, max(luminance_floor, 1e-20))
        R = np.where(slope * R > E, E / np.where(slope > 0.0, slope, 1.0), R)
    radii: np.ndarray = np.stack([R, R], axis=1)
    if settings.gradients and settings.hessian:
        known = columns["axis"].any(axis=1)
        curvature = np.maximum(np.abs(columns["curvature"]), 1e-14)
        square = (2.0 * error_scale(Y, luminance_floor) / np.maximum(Y, 1e-20))[:, None] / curvature
        radii[known] = np.minimum(np.sqrt(square), columns["max_radius"][:, None])[known]
    return radii


def record_weight(
    distance: np.ndarray, apart: np.ndarray, n: np.ndarray, n_k: np.ndarray, R: np.ndarray | float, in_front: bool
) -> np.ndarray:
    """Return w = 1/(distance + √(1 - n·n_k)) (Ward et al. 1988), of one record at many points or of many records at one point.

    distance: (…,) from the record in radii. apart: (…, 3) p - p_k, metres. n, n_k: unit normals of the point and of the record,
    (…, 3) and (3,), the other way round, or (N, 3) both for pairs. R: the radius, metres. in_front: 0 for records that face away,
    or lie in front of the point's surface or behind it.
    """
    cosine = (n * n_k).sum(-1) if n.ndim == n_k.ndim else n @ n_k if n_k.ndim == 1 else n_k @ n
    w: np.ndarray = 1.0 / np.maximum(distance + np.sqrt(np.maximum(0.0, 1.0 - cosine)), np.float32(LEAST_ERROR))
    if in_front:
        aside = np.abs((apart * (n + n_k)).sum(-1)) * 0.5
        w = np.where((cosine > 0.0) & (aside <= IN_FRONT * R), w, np.zeros_like(w))
    return w


def bounded(radii: np.ndarray | float, screen: np.ndarray | float, settings: Settings) -> np.ndarray:
    """Return radii a·R in metres, clamped to radius_min and radius_max of an image that is `screen` metres high at the record.

    screen = 0: no bounds.
    """
    percent = screen / 100.0
    least, most = settings.radius_min * percent, settings.radius_max * percent
    found: np.ndarray = np.maximum(radii, least)
    return np.where(most > 0.0, np.minimum(found, most), found)


def reach(
    columns: Mapping[str, np.ndarray], floor: float, camera: Camera, size: tuple[int, int], settings: Settings
) -> np.ndarray:
    """Return (N, 2) the radii a·R in metres along `axis` and across it, with all limits by the settings and a view of `size`.

    floor: the luminance floor of the records. shaders/records/view_radius.glsl has an equal formula.
    """
    share, most = limits_of(columns)
    radii = own_radii(columns, floor, settings) * share
    screen = camera.measure(size) * np.linalg.norm(columns["position"] - np.asarray(camera.eye), axis=1)
    return np.asarray(np.minimum(bounded(settings.a * radii, screen[:, None], settings), most))


def limits_of(columns: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the greatest share (N, 1) of its radii that each record covers, and its greatest radius (N, 1) in metres."""
    limit = columns["limit"][:, None]
    return np.where(limit < 0.0, 1.0, limit), np.where(limit < 0.0, -limit, np.inf)


def weights(columns: Mapping[str, np.ndarray], radii: np.ndarray, p: np.ndarray, n: np.ndarray, settings: Settings) -> np.ndarray:
    """Return (N,) the raw weight w of records at a point p with unit normal n, (3,) or (N, 3) each; 0 without contribution.

    radii: (N, 2) from `reach`.
    """
    radii, apart = radii / settings.a, p - columns["position"]
    along = (apart * columns["axis"]).sum(-1)
    across = np.sqrt(np.maximum((apart**2).sum(-1) - along**2, 0.0))
    distance = np.linalg.norm(np.stack([along, across], axis=-1) / np.maximum(radii, 1e-30), axis=-1)  # in radii
    w = record_weight(distance, apart, n, columns["normal"], radii[:, 1], settings.hessian)
    return np.where(w > 1.0 / settings.a, w, 0.0)


def view_radius_uniforms(camera: Camera, size: tuple[int, int], settings: Settings) -> Uniforms:
    """Return the uniforms of shaders/records/view_radius.glsl that depend on the view of `size` (width, height) and settings."""
    measure = camera.measure(size)
    return {
        "eye": camera.eye,
        **record_uniforms(settings),
        "radius_bounds": (settings.radius_min / 100.0 * measure, settings.radius_max / 100.0 * measure),
    }
