"""The path-traced reference of a view, cached in the cache folder, and a frame's errors relative to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from irrsplat.core import files
from irrsplat.core.color import LUMINANCE
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.image.frame import Frame
from irrsplat.reference import disk_cache, worker
from irrsplat.reference.disk_cache import folder
from irrsplat.scene.model import Camera, Scene

VERSION = 7  # of content and method; older files in the cache are ignored
MOST_BOUNCES = 1024  # a room of reflectance 0.99 has 3e-5 of its light beyond them; paths end earlier by Russian roulette
MOST_SAMPLES = 131_072  # limits the memory of samples in flight
NOTHING = "the camera sees no smooth surface, so there is nothing to compare; give another camera or a larger size"
SAMPLES = 2048  # rays of each kind per pixel
OUTLIER = 0.3  # of the mean: a larger error is clearly visible
SPOT = 0.2  # of the local reference: a pixel with a larger error is a spot, which an RMSE weighs by size, not by visibility
_AROUND = 9  # pixels: side of the square whose mean is the local reference


@dataclass(frozen=True)
class Traced:
    """The reference of a view of W×H pixels, top row first, float32.

    halves: (2, H, W, 3) indirect irradiance in W/m², by two independent halves of the samples. direct: (H, W, 3) ρ/π·E_direct,
    emission: (H, W, 3) of the surface, or of the scene's own sky, in W/(m² sr). albedo: (H, W, 3). normal: (H, W, 3) with normal
    map, turned to the camera; irradiance refers to it. tint: (H, W, 3) transmittance of filters in front; glow: (H, W, 3) their
    radiance. opacity: (H, W) of the nearest filter, or 1 for a surface. The following are (H, W) bool. seen: True for a surface.
    valid: it also reflects light and is smooth in 3×3 pixels; irradiance is compared there. clear: also no shadow's edge is near;
    direct light is compared there.
    """

    halves: np.ndarray
    direct: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    normal: np.ndarray
    tint: np.ndarray
    glow: np.ndarray
    opacity: np.ndarray
    seen: np.ndarray
    valid: np.ndarray
    clear: np.ndarray

    @property
    def irradiance(self) -> np.ndarray:
        """(H, W, 3) indirect irradiance, by all samples."""
        return np.asarray(self.halves.mean(axis=0))

    @property
    def picture(self) -> np.ndarray:
        """(H, W, 3) radiance: direct, indirect and emitted light, through the filters in front."""
        radiance = self.direct + self.albedo / np.float32(np.pi) * self.irradiance + self.emission
        return np.asarray(self.tint * radiance + self.glow)

    @property
    def noise(self) -> float | None:
        """Standard error of `irradiance` over its mean, RMS over the valid pixels, from its halves."""
        return noise(self.halves, self.valid)


def noise(halves: np.ndarray, where: np.ndarray) -> float | None:
    """Return the standard error of the mean of `halves` (2, H, W, 3) over that mean, RMS over the pixels `where`; None in the
    dark."""
    # variance of the mean = var(half)/2 = var(difference)/4, since the halves are independent
    E = halves[:, where].astype(float)
    return float(np.sqrt(np.mean((E[1] - E[0]) ** 2)) / 2.0 / E.mean()) if E.any() else None


def errors(E: np.ndarray, E_ref: np.ndarray) -> dict[str, float | None]:
    """Return errors of irradiance E (N, 3) relative to the reference E_ref (N, 3), both in W/m²; None without light.

    `rmse`: √mean((E−E_ref)²)/mean(E_ref), over pixels and channels. `bias`: mean(E)/mean(E_ref) − 1. `outliers`: share of pixels
    with an error of any channel above 30 % of the mean.
    """
    E_ref = E_ref.astype(float)
    error, mean = E - E_ref, E_ref.mean() if E_ref.size else 0.0
    if not mean:
        return {"rmse": None, "bias": None, "outliers": None}
    return {
        "rmse": float(np.sqrt(np.mean(error**2)) / mean),
        "bias": float(error.mean() / mean),
        "outliers": float(np.mean(np.abs(error).max(axis=1) > OUTLIER * mean)),
    }


def compare(frame: Frame, truth: Traced) -> dict[str, float | None]:
    """Return the errors of a frame.

    `errors` of its irradiance in the valid pixels; `net`: `rmse` without the reference's noise; `direct`: relative RMSE of direct
    light in the clear pixels; `albedo`: median difference of its channels, and `normal`: median angle between the normals in
    degrees, in the valid pixels; `spots`: see the function. Raises InputError without a valid pixel, or for different sizes.
    """
    if frame.irradiance.shape != truth.direct.shape:
        raise InputError(f"the frame is of shape {frame.irradiance.shape}, but the truth of shape {truth.direct.shape}")
    if not truth.valid.any():
        raise InputError(NOTHING)
    found = errors(frame.irradiance[truth.valid], truth.irradiance[truth.valid])
    rmse, noise = found["rmse"], truth.noise
    net = None if rmse is None or noise is None else math.sqrt(max(rmse**2 - noise**2, 0.0))
    albedo = float(np.median(np.abs(frame.albedo[truth.valid] - truth.albedo[truth.valid])))
    # from the chord: an arc cosine in float32 does not resolve angles below 0.02°
    half = np.linalg.norm(frame.normal[truth.valid].astype(float) - truth.normal[truth.valid], axis=1) / 2.0
    return found | {
        "net": net,
        "spots": spots(frame.irradiance, truth.irradiance, truth.valid),
        "direct": errors(frame.direct[truth.clear], truth.direct[truth.clear])["rmse"],
        "albedo": albedo,
        "normal": float(np.degrees(np.median(2.0 * np.arcsin(np.minimum(half, 1.0))))),
    }


def spots(E: np.ndarray, E_ref: np.ndarray, valid: np.ndarray) -> float | None:
    """Return the share of valid pixels whose luminance error exceeds SPOT of the local reference; None for a dark reference.

    The local reference is the mean of the reference's luminance over the valid pixels of the 9×9 pixels around. E, E_ref: (H, W,
    3) irradiance in W/m². valid: (H, W) bool, at least one pixel.
    """
    from scipy import ndimage

    Y, Y_ref = (one.astype(float) @ LUMINANCE.astype(float) for one in (E, E_ref))
    if not Y_ref[valid].any():
        return None

    def square(values: np.ndarray) -> np.ndarray:
        return np.asarray(ndimage.uniform_filter(values, _AROUND, mode="constant"))

    local = square(np.where(valid, Y_ref, 0.0))[valid] / square(valid.astype(float))[valid]
    return float(np.mean(np.abs(Y - Y_ref)[valid] > SPOT * local))


def side_of(samples: int) -> int:
    """Return the side of each half's stratified grid: 2·side² samples are at least `samples`; InputError beyond 2..131072."""
    if not 2 <= samples <= MOST_SAMPLES:
        raise InputError(f"samples lie between 2 and {MOST_SAMPLES}, not {samples}")
    return math.isqrt((samples + 1) // 2 - 1) + 1


def vertices(bounces: int | str) -> int:
    """Return the traced number of bounces for the setting `bounces`: the number, or MOST_BOUNCES for "all"."""
    return MOST_BOUNCES if isinstance(bounces, str) else bounces


def in_words(bounces: int | str) -> str:
    """Return the setting `bounces` in words, such as "one indirect bounce"."""
    return "all bounces" if isinstance(bounces, str) else "one indirect bounce" if bounces == 1 else f"{bounces} bounces"


def traced(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    bounces: int | str,
    samples: int = SAMPLES,
    progress: Callable[[float], object] | None = None,
    notice: Callable[[str], object] | None = None,
) -> Traced:
    """Return the reference of a view of size (W, H), traced with `samples` rays of each kind per pixel, or read from the cache.

    bounces: of indirect light, a number or "all". progress: called with the finished share during tracing. notice: called with a
    line if a file of the cache is damaged or cannot be written. Raises InputError for a scene without surfaces, IrrsplatError if
    tracing is impossible here.
    """
    side = side_of(samples)
    if not scene.triangles:
        raise InputError("the scene has no surfaces, so there is nothing to trace")

    def trace() -> Traced:
        return Traced(**worker.call("trace", (scene, camera, size, side, vertices(bounces)), progress))

    name = f"truth-{key_of(scene, camera, size, side, bounces)}.npz"
    return disk_cache.kept(name, lambda path: _read(path, size), trace, notice or (lambda line: None))


# ---- the cache folder ----------------------------------------------------------------------------------------------------


def key_of(scene: Scene, camera: Camera, size: tuple[int, int], side: int, bounces: int | str) -> str:
    """Return a hash of all inputs of a view's reference; names do not matter, every bit of a number does."""
    return disk_cache.key_of(scene, camera, VERSION, size, side, vertices(bounces))


def kept(scene: Scene, camera: Camera, size: tuple[int, int], bounces: int | str, samples: int = SAMPLES) -> Traced | None:
    """Return the cached reference of a view, see `traced`; None if it is missing or damaged."""
    try:
        return _read(folder() / f"truth-{key_of(scene, camera, size, side_of(samples), bounces)}.npz", size)
    except (IrrsplatError, *files.DAMAGE):
        return None


def _read(path: Path, size: tuple[int, int]) -> Traced:
    """Return the reference in a file; raises FileNotFoundError for a missing file, one of files.DAMAGE for any other file."""
    arrays = disk_cache.read(path)
    truth = Traced(**{field.name: arrays[field.name] for field in fields(Traced)})
    pixels = size[1], size[0]
    for field in fields(Traced):
        array = getattr(truth, field.name)
        flag = field.name in ("seen", "valid", "clear")
        shape = pixels if flag or field.name == "opacity" else (2, *pixels, 3) if field.name == "halves" else (*pixels, 3)
        if array.shape != shape or array.dtype != (bool if flag else np.float32) or not np.isfinite(array).all():
            raise ValueError(f"'{field.name}' is not what irrsplat writes")
    return truth
