"""Comparison of frames with the path-traced references in tests/reference, by the project's error measures.

A reference holds some thousand pixels of a 400×400 image of a bundled scene. `python -m tests.reference.make` makes them
(needs the extra `reference`); reading and comparison need numpy alone.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.reference import camera_view
from irrsplat.reference.surfaces import Surfaces
from irrsplat.scene.model import Camera, Light, Scene

SIZE = 400  # pixels; references are square images of this side
FOLDER = Path(__file__).resolve().parents[1] / "reference"
FAR_FROM_EDGES = 3  # pixels: direct light is compared farther from shadow edges than this


@dataclass(frozen=True)
class Reference:
    """Reference at N pixels of a SIZE×SIZE image from the scene's default camera.

    pixels: (N, 2) row and column, top row first. position, normal: (N, 3) world space, the shading normal towards the
    camera. irradiance: (N, 3) one-bounce indirect irradiance in W/m². direct: (N, 3) ρ/π·E_direct in W/(m² sr). edge: (N,)
    distance in pixels to the nearest edge of a shadow, a cone or a surface. noise: (N, 3) standard error of irradiance in
    W/m². agreement: relative RMS difference of two independent halves. samples: rays of each kind per pixel.
    irradiance_all, noise_all, agreement_all, samples_all: the same values for all bounces.
    """

    scene: str
    hash: str
    diagonal: float
    camera: np.ndarray
    samples: int
    agreement: float
    pixels: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    irradiance: np.ndarray
    direct: np.ndarray
    edge: np.ndarray
    noise: np.ndarray
    irradiance_all: np.ndarray
    noise_all: np.ndarray
    agreement_all: float
    samples_all: int

    def of(self, bounces: int | str) -> tuple[np.ndarray, float]:
        """Return irradiance (N, 3) and the agreement of its halves, for 1 or "all" bounces."""
        return {1: (self.irradiance, self.agreement), "all": (self.irradiance_all, self.agreement_all)}[bounces]


def load_reference(scene_name: str) -> Reference:
    """Return the reference of a bundled scene; raise FileNotFoundError without one."""
    with np.load(FOLDER / f"{scene_name}.npz") as data:
        values = {k: data[k] if data[k].ndim else data[k].item() for k in data.files}
    for name in ("position", "normal", "irradiance", "direct", "noise", "irradiance_all", "noise_all"):
        values[name] = values[name].astype(np.float32)
    values["pixels"] = values["pixels"].astype(np.intp)
    return Reference(**values)


def scene_hash(scene: Scene) -> str:
    """Return a hash of the reference's inputs: geometry, materials, lights, sky and the default camera.

    Coordinates count to 1e-4 of the scene's diagonal, other numbers to four digits, normals in sum. The hash is independent
    of the last bit of a machine's sine.
    """
    digest = hashlib.sha256()

    def add(values: Any, step: float) -> None:
        # the offset keeps round numbers, which are frequent in scenes, away from rounding boundaries
        digest.update(np.floor(np.asarray(values, np.float64) / step + 0.381966).astype(np.int64).tobytes())

    length = 1e-4 * float(f"{scene.diagonal:.3g}")
    for mesh in scene.meshes:
        add(mesh.positions, length)
        add(mesh.faces, 1.0)
        add(np.asarray(mesh.normals, np.float64).mean(axis=0) if len(mesh.normals) else 0.0, 1e-2)
        add(mesh.material.albedo if mesh.colors is None else mesh.colors, 1e-4)
        _add_numbers(digest, mesh.material.emission)
    for light in scene.lights:
        _add_numbers(digest, _light_numbers(light))
    _add_numbers(digest, scene.sky)
    _add_numbers(digest, camera_numbers(scene.cameras[0]))
    return digest.hexdigest()[:16]


def _add_numbers(digest: Any, values: Any) -> None:
    digest.update(" ".join(f"{float(v) + 0.0:.4g}" for v in np.ravel(values)).encode())


def _light_numbers(light: Light) -> list[float]:
    target = light.spot_target or (0.0, 0.0, 0.0)
    cone = (light.spot_cutoff, light.spot_inner, light.spot_exponent) if light.spot_target else (180.0, 180.0, 0.0)
    falloff = (0.0, 0.0, 0.0) if light.physical or light.directional else light.attenuation
    return [light.directional, light.physical, *light.position, *light.color, *falloff, *target, *cone]


def camera_numbers(camera: Camera) -> np.ndarray:
    """Return eye, target, up and vertical field of view in degrees (10,)."""
    return np.array([*camera.eye, *camera.target, *camera.up, camera.fov], np.float64)


def compare(frame: Any, reference: Reference, bounces: int | str = 1) -> dict[str, float]:
    """Return the errors of a frame of SIZE×SIZE pixels against the reference of 1 or "all" `bounces`.

    A frame may also have SIZE/k pixels per side, k odd: its pixel centres are those of every k-th pixel of SIZE×SIZE.

    `rmse`: √mean((E−E_ref)²)/mean(E_ref), over pixels and channels. `bias`: mean(E)/mean(E_ref) − 1. `outliers`: share of
    pixels with an error above 30 % of the mean in any channel. `direct_rms`, `direct_max`: error of direct over its mean,
    away from shadow edges; `direct_off`: share of those pixels with an error above 2 % of the mean. `misplaced`: share of
    pixels whose position is off by more than 0.2 % of the scene's diagonal. 0 is always perfect.
    """
    height, width = frame.irradiance.shape[:2]
    step = SIZE // height
    if width != height or step * height != SIZE or step % 2 == 0:
        raise ValueError(f"references are for {SIZE}×{SIZE} images and an odd part of that, not {width}×{height}")
    known = (reference.pixels % step == step // 2).all(axis=1)
    row, column = reference.pixels[known].T // step
    E_ref = reference.of(bounces)[0][known].astype(np.float64)
    error = frame.irradiance[row, column] - E_ref
    clear = reference.edge[known] > FAR_FROM_EDGES
    L_ref = reference.direct[known][clear].astype(np.float64)
    off = frame.direct[row, column][clear] - L_ref
    L_mean = L_ref.mean() if clear.any() and L_ref.any() else 1.0
    moved = np.linalg.norm(frame.position[row, column] - reference.position[known], axis=1)
    return {
        "rmse": float(np.sqrt(np.mean(error**2)) / E_ref.mean()),
        "bias": float(error.mean() / E_ref.mean()),
        "outliers": float(np.mean(np.abs(error).max(axis=1) > 0.3 * E_ref.mean())),
        "direct_rms": float(np.sqrt(np.mean(off**2)) / L_mean) if clear.any() else 0.0,
        "direct_max": float(np.abs(off).max() / L_mean) if clear.any() else 0.0,
        "direct_off": float(np.mean(np.abs(off).max(axis=1) > 0.02 * L_mean)) if clear.any() else 0.0,
        "misplaced": float(np.mean(moved > 0.002 * reference.diagonal)),
    }


def cast(scene: Scene, camera: Camera, size: tuple[int, int]) -> camera_view.Visible:
    """Return the surfaces at the centres of the pixels of a picture of this size (W, H), found by Embree."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore import EmbreeDevice
    from embreex.rtcore_scene import EmbreeScene

    surfaces, directions = Surfaces.of(scene), camera_view.camera_rays(camera, size)
    tree = EmbreeScene(EmbreeDevice(), robust=True)
    TriangleMesh(tree, surfaces.positions, surfaces.faces)

    def nearest(pixel: np.ndarray, beyond: np.ndarray) -> Any:
        starts = np.asarray(camera.eye) + beyond[:, None] * directions[pixel]
        hit = tree.run(starts.astype("f4"), directions[pixel].astype("f4"), output=True)
        triangle, u, v, way = (hit[name] for name in ("primID", "u", "v", "tfar"))
        return triangle >= 0, triangle.astype(np.int64), u.astype(float), v.astype(float), beyond + way

    return camera_view.seen(surfaces, directions, nearest, camera_view.epsilon_of(scene)).image(size)
