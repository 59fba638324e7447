"""A scene as plain, immutable numpy data: meshes, materials, lights, cameras and sky; nothing of OpenGL."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from irrsplat.core.errors import InputError


@dataclass(frozen=True)
class Material:
    """A two-sided Lambertian surface: `albedo` (3,) in 0..1 linear, `emission` (3,) emitted radiance in W/(m² sr)."""

    albedo: tuple[float, float, float] = (0.5, 0.5, 0.5)
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)  # compared by identity: arrays have no single answer to ==, and a moved mesh is a new one
class Mesh:
    """Triangles in world space; each mesh is equal only to itself.

    positions: (V, 3) float32, metres. normals: (V, 3) float32, unit shading normals. faces: (F, 3) int32.
    colors: (V, 3) float32 linear reflectance that replaces material.albedo, or None.
    closed: True only where the surface is watertight and wound outward (in world space).
    """

    positions: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Material)
    colors: np.ndarray | None = None
    closed: bool = False
    name: str = ""


@dataclass(frozen=True)
class Light:
    """A delta light: a point, a spot or a directional one.

    position: (3,) world space; for a directional light the direction *towards* the light (need not be unit).
    color: (3,) OpenGL's `diffuse`, or the radiant intensity in W/sr where `physical`.
    attenuation: OpenGL's (constant, linear, quadratic); not used where `physical` (then 1/d²).
    spot_target: the point that a spot looks at, or None (no cone). spot_cutoff, spot_inner: half angles in degrees;
    full intensity inside spot_inner, falling linearly in the angle to 0 at spot_cutoff; equal: a hard edge.
    spot_exponent: OpenGL's cos^exponent inside the cone.
    """

    position: tuple[float, float, float]
    color: tuple[float, float, float]
    directional: bool = False
    physical: bool = False
    attenuation: tuple[float, float, float] = (1.0, 0.0, 0.0)
    spot_target: tuple[float, float, float] | None = None
    spot_cutoff: float = 180.0
    spot_inner: float = 180.0
    spot_exponent: float = 0.0
    name: str = ""

    @property
    def kind(self) -> str:
        """Its kind in a word, for people: directional, spot or point."""
        return "directional" if self.directional else "point" if self.spot_target is None else "spot"


@dataclass(frozen=True)
class Camera:
    """A pinhole: `eye`, `target` and `up` as gluLookAt (world space), `fov` vertical in degrees."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov: float = 45.0
    name: str = ""

    def __post_init__(self) -> None:
        if not np.isfinite((*self.eye, *self.target, *self.up, self.fov)).all():
            raise InputError("camera: every number must be finite")
        if not 0.0 < self.fov < 180.0:
            raise InputError(f"field of view must lie between 0 and 180 degrees, not {self.fov:g}")
        forward = np.subtract(self.target, self.eye)
        if not np.linalg.norm(forward) > 0.0:
            raise InputError("the camera's eye lies at its target; move one of them")
        sine = np.linalg.norm(np.cross(forward / np.linalg.norm(forward), self.up))
        if not sine > 1e-9 * max(float(np.linalg.norm(self.up)), 1e-300):
            raise InputError("the camera's up vector is parallel to its view; give another up")

    @property
    def screen(self) -> float:
        """The height of the image at distance 1 from the eye, in metres."""
        return 2.0 * math.tan(math.radians(self.fov) / 2.0)

    @cached_property
    def axes(self) -> np.ndarray:
        """(3, 3) rows: right, up and backward, unit, world space."""
        backward = np.subtract(self.eye, self.target)
        backward = backward / np.linalg.norm(backward)
        right = np.cross(self.up, backward)
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(backward, right), backward])

    @cached_property
    def view_from_world(self) -> np.ndarray:
        """(4, 4) float64: right-handed view space that looks down -z, as gluLookAt."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.axes
        matrix[:3, 3] = -self.axes @ np.asarray(self.eye)
        return matrix

    def clip_from_view(self, aspect: float, near: float, far: float) -> np.ndarray:
        """(4, 4) float64, as gluPerspective with this camera's vertical field of view."""
        f = 1.0 / np.tan(np.radians(self.fov) / 2.0)
        return np.array(
            [
                [f / aspect, 0.0, 0.0, 0.0],
                [0.0, f, 0.0, 0.0],
                [0.0, 0.0, (far + near) / (near - far), 2.0 * far * near / (near - far)],
                [0.0, 0.0, -1.0, 0.0],
            ]
        )


@dataclass(frozen=True)
class Scene:
    """All that is lit and seen. `cameras[0]` is the default one; `sky` (3,) is a uniform environment radiance.

    notices: one-line remarks of the loader (degenerate triangles dropped, a sky invented, …), for a user to read.
    files: the paths of all files that it was read from.
    """

    meshes: tuple[Mesh, ...]
    lights: tuple[Light, ...]
    cameras: tuple[Camera, ...]
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = "scene"
    path: str = ""
    notices: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) float64: the least and greatest corner of the geometry; zeros where there is none."""
        corners = [c for m in self.meshes if len(m.positions) for c in (m.positions.min(0), m.positions.max(0))]
        return np.array([np.min(corners, 0), np.max(corners, 0)], float) if corners else np.zeros((2, 3))

    @property
    def corners(self) -> np.ndarray:
        """(8, 3) float64: the corners of the bounding box."""
        return np.array(np.meshgrid(*self.bounds.T)).reshape(3, -1).T

    @cached_property
    def diagonal(self) -> float:
        """The length of the bounding box's diagonal in metres; 1 where there is no geometry."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0])) or 1.0

    @property
    def triangles(self) -> int:
        """The number of triangles."""
        return sum(len(m.faces) for m in self.meshes)

    def camera(self, name: str | Camera | None = None) -> Camera:
        """The camera called `name` (None: the default one; a Camera: itself); raises InputError with the names there are."""
        if name is None:
            return self.cameras[0]
        if isinstance(name, Camera):
            return name
        if not isinstance(name, str):
            raise InputError(f"a camera is a Camera or the name of one of the scene's, not {type(name).__name__}")
        for camera in self.cameras:
            if camera.name == name:
                return camera
        names = ", ".join(repr(c.name) for c in self.cameras if c.name) or "none"
        raise InputError(f"there is no camera '{name}'; the named cameras here: {names}")
