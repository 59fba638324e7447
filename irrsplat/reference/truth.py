"""The path-traced truth of a view, read from the cache folder where it was traced before, and a frame's errors against it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from irrsplat.core import files
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.image.frame import Frame
from irrsplat.reference import blemishes, disk_cache, worker
from irrsplat.reference.disk_cache import folder
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import preset

VERSION = 6  # of what is traced and how; older files in the cache are not read
MOST_BOUNCES = preset(bounces="all").most_bounces  # what a surface of reflectance ρ adds after N is ρ^N of the first one's
MOST_SAMPLES = 131_072  # what is in flight at once fits into memory
NOTHING = "the camera sees no smooth surface, so there is nothing to compare; give another camera or a larger size"
SAMPLES = 2048  # rays of each kind per pixel
OUTLIER = 0.3  # of the mean: a larger error is plain to see


@dataclass(frozen=True)
class Traced:
    """The truth of a view of W×H pixels, top row first, float32.

    halves: (2, H, W, 3) indirect irradiance in W/m², by two independent halves of the samples. direct: (H, W, 3) ρ/π·E_direct,
    emission: (H, W, 3) of the surface, or of the sky where the scene has its own, in W/(m² sr). albedo: (H, W, 3). normal:
    (H, W, 3) bent by the normal map, turned to the camera; irradiance is about it. tint: (H, W, 3) what filters in front leave
    of all that; glow: (H, W, 3) the radiance that they add.
    opacity: (H, W) of the nearest filter, or 1 of a surface. The rest are (H, W) bool:
    seen: there is a surface. valid: and it reflects light, and is smooth in the 3×3 pixels around: irradiance is compared there.
    clear: and no shadow's edge is near: direct light is compared there.
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
        mean: np.ndarray = self.halves.mean(axis=0)
        return mean

    @property
    def picture(self) -> np.ndarray:
        """(H, W, 3) radiance: direct, indirect and emitted light together, through the filters in front."""
        radiance: np.ndarray = self.direct + self.albedo / np.float32(np.pi) * self.irradiance + self.emission
        radiance = self.tint * radiance + self.glow
        return radiance

    @property
    def noise(self) -> float | None:
        """The standard error of `irradiance` over its mean, RMS over the valid pixels, as its halves tell."""
        return noise(self.halves, self.valid)


def noise(halves: np.ndarray, where: np.ndarray) -> float | None:
    """The standard error of the mean of `halves` (2, H, W, 3) over that mean, RMS over the pixels `where` (H, W); None in the
    dark."""
    # the halves are independent and alike, so their mean has half the variance of one: that of half their difference
    E = halves[:, where].astype(float)
    return float(np.sqrt(np.mean((E[1] - E[0]) ** 2)) / 2.0 / E.mean()) if E.any() else None


def errors(E: np.ndarray, E_ref: np.ndarray) -> dict[str, float | None]:
    """How far irradiance E (N, 3) is from the truth E_ref (N, 3), both in W/m²; None where there is no light to compare with.

    `rmse`: √mean((E−E_ref)²)/mean(E_ref), over pixels and channels. `bias`: mean(E)/mean(E_ref) − 1. `outliers`: share of the
    pixels where any channel is off by more than 30 % of the mean.
    """
    E_ref = E_ref.astype(float)
    error, mean = E - E_ref, E_ref.mean()
    if not mean:
        return {"rmse": None, "bias": None, "outliers": None}
    return {
        "rmse": float(np.sqrt(np.mean(error**2)) / mean),
        "bias": float(error.mean() / mean),
        "outliers": float(np.mean(np.abs(error).max(axis=1) > OUTLIER * mean)),
    }


def compare(frame: Frame, truth: Traced) -> dict[str, float | None]:
    """The `errors` of a frame's irradiance in the valid pixels; `net`: the `rmse` without the truth's own noise; `direct`: the
    relative RMSE of its direct light in the clear ones; `albedo`: the median difference of its channels from the truth's, and
    `normal`: the median angle between the normals in degrees, both in the valid pixels; `spots`: as blemishes.spots has it;
    `fine`: the RMS of the error's fine part over the truth's mean, without the truth's own noise.

    Raises InputError where no pixel is valid, or the sizes differ.
    """
    if frame.irradiance.shape != truth.direct.shape:
        raise InputError(f"the frame is of shape {frame.irradiance.shape}, but the truth of shape {truth.direct.shape}")
    if not truth.valid.any():
        raise InputError(NOTHING)
    L_ref = truth.direct[truth.clear].astype(float)
    off = frame.direct[truth.clear] - L_ref
    direct = float(np.sqrt(np.mean(off**2)) / L_ref.mean()) if L_ref.any() else None
    found = errors(frame.irradiance[truth.valid], truth.irradiance[truth.valid])
    rmse, noise = found["rmse"], truth.noise
    net = None if rmse is None or noise is None else math.sqrt(max(rmse**2 - noise**2, 0.0))
    E, valid, fine = truth.irradiance, truth.valid, None
    if rmse is not None:
        noisy = blemishes.fine(frame.irradiance - E, valid), blemishes.fine(np.diff(truth.halves, axis=0)[0] / 2.0, valid)
        fine = math.sqrt(max(noisy[0] ** 2 - noisy[1] ** 2, 0.0)) / float(E[valid].mean(dtype=float))
    albedo = float(np.median(np.abs(frame.albedo[truth.valid] - truth.albedo[truth.valid])))
    return found | {
        "net": net,
        "spots": blemishes.spots(frame.irradiance, E, valid),
        "fine": fine,
        "direct": direct,
        "albedo": albedo,
        "normal": median_angle(frame.normal, truth.normal, truth.valid),
    }


def median_angle(normals: np.ndarray, others: np.ndarray, where: np.ndarray) -> float:
    """The median angle in degrees between unit vectors (H, W, 3) in the pixels `where` (H, W)."""
    # by half the distance of their ends: the arc cosine knows nothing finer than 0.02° in float32
    half = np.linalg.norm(normals[where].astype(float) - others[where], axis=1) / 2.0
    return float(np.degrees(np.median(2.0 * np.arcsin(np.minimum(half, 1.0)))))


def side_of(samples: int) -> int:
    """The side of the stratified grid of each half: 2·side² samples are at least `samples`; InputError beyond 2..131072."""
    if not 2 <= samples <= MOST_SAMPLES:
        raise InputError(f"samples lie between 2 and {MOST_SAMPLES}, not {samples}")
    return math.isqrt((samples + 1) // 2 - 1) + 1


def vertices(bounces: int | str) -> int:
    """How many bounces of light are traced for the setting `bounces`: that number itself, or for "all" MOST_BOUNCES."""
    return MOST_BOUNCES if isinstance(bounces, str) else bounces


def in_words(bounces: int | str) -> str:
    """The setting `bounces` in a sentence, such as "one indirect bounce"."""
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
    """The truth of a view of size (W, H), traced with `samples` rays of each kind per pixel, or read from the cache folder.

    bounces: of indirect light, a number or "all". progress: called with the share done while it is traced. notice: called with
    a line where a file of the cache is damaged or cannot be written. Raises InputError for a scene without surfaces,
    IrrsplatError where nothing can be traced here.
    """
    side = side_of(samples)
    if not scene.triangles:
        raise InputError("the scene has no surfaces, so there is nothing to trace")
    notice = notice or (lambda line: None)
    path, key = None, key_of(scene, camera, size, side, bounces)
    try:
        path = folder() / f"truth-{key}.npz"
        if (truth := _read(path, size)) is not None:
            return truth
    except files.DAMAGE:
        notice(f"{path}: damaged; the truth is traced again")
    except IrrsplatError as error:
        notice(str(error))
    truth = Traced(**worker.trace(scene, camera, size, side, vertices(bounces), progress))
    try:
        if path is not None:
            disk_cache.write(path, {field.name: getattr(truth, field.name) for field in fields(Traced)})
    except IrrsplatError as error:
        notice(f"{error}; the truth is not kept for the next time")
    return truth


# ---- the cache folder ----------------------------------------------------------------------------------------------------


def key_of(scene: Scene, camera: Camera, size: tuple[int, int], side: int, bounces: int | str) -> str:
    """A hash of all that the truth of a view depends on; names do not count, every bit of a number does."""
    return disk_cache.key_of(scene, camera, VERSION, size, side, vertices(bounces))


def kept(scene: Scene, camera: Camera, size: tuple[int, int], bounces: int | str, samples: int = SAMPLES) -> Traced | None:
    """The truth of a view as `traced` has it where it was traced before; None elsewhere, and where its file is damaged."""
    try:
        return _read(folder() / f"truth-{key_of(scene, camera, size, side_of(samples), bounces)}.npz", size)
    except (IrrsplatError, *files.DAMAGE):
        return None


def _read(path: Path, size: tuple[int, int]) -> Traced | None:
    """The truth in a file, None where there is no file; raises one of files.DAMAGE for any other file."""
    arrays = disk_cache.read(path)
    if arrays is None:
        return None
    truth = Traced(**{field.name: arrays[field.name] for field in fields(Traced)})
    pixels = size[1], size[0]
    for field in fields(Traced):
        array = getattr(truth, field.name)
        flag = field.name in ("seen", "valid", "clear")
        shape = pixels if flag or field.name == "opacity" else (2, *pixels, 3) if field.name == "halves" else (*pixels, 3)
        if array.shape != shape or array.dtype != (bool if flag else np.float32) or not np.isfinite(array).all():
            raise ValueError(f"'{field.name}' is not what irrsplat writes")
    return truth
