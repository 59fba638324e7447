"""Detection of frames with no view of the scene, or only of back faces: behind a wall, or inside one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.app.common.terminal import say
from irrsplat.core.vectors import sphere
from irrsplat.reference.camera_view import camera_rays
from irrsplat.scene import ray_caster
from irrsplat.scene.model import Camera, Scene

if TYPE_CHECKING:
    from irrsplat.app.film.flight import Flight

_ACROSS = 24  # rays per row of a frame
_THROUGH = 8  # one-sided back faces that a ray passes, at most
_AROUND, _FEW = 200, 0.3  # directions around an eye; share of them that counts as few
_FRONT, _BACK = 1, 2


def warn(scene: Scene, flight: Flight, size: Sequence[int], turntable: bool) -> None:
    """Print the number of frames that show nothing or only back faces, if any.

    size: (width, height) of a frame. turntable: True for a turntable, for the remedy.
    """
    if flight.path.motions or not scene.triangles or not ray_caster.available():
        return
    found = lost(scene, [flight.path.camera(number) for number in flight.numbers], (size[0], size[1]))
    if not found.any():
        return
    first = flight.numbers[int(np.argmax(found))]
    which = f"{int(found.sum())} of {len(found)} frames see nothing of the scene, or only backs of its surfaces"
    remedy = "move those keys of the path, or leave the frames out by --frames"
    if turntable:
        remedy = "give --eye and --target nearer to one another, so that the circle stays where --eye is"
    say(f"notice: {which}, the first of them frame {first}; {remedy}")


def lost(scene: Scene, cameras: Sequence[Camera], size: tuple[int, int]) -> np.ndarray:
    """Return a mask (N,) of cameras that see no visible side, and hardly any around them.

    Files are unreliable about the visible side: the side more visible to the scene's first camera is used. size: (width,
    height) of the pictures.
    """
    scene = scene.recentred
    origin, scene = np.negative(scene.origin), scene.local
    grid = (_ACROSS, max(round(_ACROSS * size[1] / size[0]), 1))
    sight = _Sight(scene)
    first = sight.sides(scene.camera(), camera_rays(scene.camera(), grid))
    shown = _BACK if (first == _BACK).sum() > (first == _FRONT).sum() else _FRONT

    def is_lost(camera: Camera) -> bool:
        if (sight.sides(camera, camera_rays(camera, grid)) == shown).any():
            return False
        return bool((sight.sides(camera, sphere(_AROUND)) == shown).mean() < _FEW)  # else it faces inverted surfaces

    return np.array([is_lost(camera.shifted(origin)) for camera in cameras])


class _Sight:
    """Ray tests of cameras against a scene's triangles."""

    def __init__(self, scene: Scene) -> None:
        meshes = [mesh for mesh in scene.meshes if len(mesh.faces)]
        corners = np.concatenate([mesh.positions[mesh.faces] for mesh in meshes])
        self.caster = ray_caster.RayCaster(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        self.corner = corners[:, 0].astype(float)
        self.normal = np.cross(corners[:, 1] - self.corner, corners[:, 2] - self.corner)
        self.one_sided = np.repeat([not mesh.material.double_sided for mesh in meshes], [len(mesh.faces) for mesh in meshes])
        self.step = 1e-6 * scene.diagonal

    def sides(self, camera: Camera, rays: np.ndarray) -> np.ndarray:
        """Return the hits (R,) of `rays` (R, 3) from the camera's eye: 0 nothing, 1 a front, 2 a back."""
        at, seen = np.tile(np.asarray(camera.eye, float), (len(rays), 1)), np.zeros(len(rays), np.intp)
        left = np.arange(len(rays))
        for _ in range(_THROUGH):
            frames = np.zeros((len(left), 3, 3))
            frames[:, 2] = rays[left]
            hit = self.caster.first_hits(at[left], frames, np.array([[0.0, 0.0, 1.0]]))[:, 0]
            left, hit = left[hit >= 0], hit[hit >= 0]
            slope = (rays[left] * self.normal[hit]).sum(1)
            through = self.one_sided[hit] & (slope > 0.0)
            seen[left[~through]] = np.where(slope < 0.0, _FRONT, _BACK)[~through]
            left, hit, slope = left[through], hit[through], slope[through]
            away = ((self.corner[hit] - at[left]) * self.normal[hit]).sum(1) / slope
            at[left] += (away + self.step)[:, None] * rays[left]
        return seen
