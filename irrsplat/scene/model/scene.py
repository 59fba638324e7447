"""The scene: meshes, lights, cameras and sky."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from irrsplat.core.errors import InputError, did_you_mean
from irrsplat.core.vectors import box, corners, near_origin
from irrsplat.scene.model.camera import Camera
from irrsplat.scene.model.checks import check_type, checked, put
from irrsplat.scene.model.lights import Light
from irrsplat.scene.model.surfaces import Material, Mesh
from irrsplat.sky.environment import Environment

_DISTANT = 5.0  # from this ratio of sizes on, a room stands on a ground whose extent is of no interest


@dataclass(frozen=True)
class Scene:
    """A scene. `cameras[0]` is the default camera.

    sky: (3,) mean radiance of the environment. sky_gradient: (3,) additional radiance straight up: the radiance from the unit
    direction d is sky + sky_gradient·dot(d, up), or that of `environment`, if there is one. Its suns are among the lights.
    up: (3,) unit, world space. own_sky: True for a sky from the file; a default sky is not shown as background.
    notices: one-line remarks of the loader for users, for example on dropped triangles or a default sky.
    files: the paths of all files that were read.
    origin: (3,) world space, float64: positions of meshes are relative to it. It is not 0 0 0 for a scene far from there, where
    float32 would be too coarse; lights and cameras are in world space.
    Lists become tuples. Raises InputError for values of another kind.
    """

    meshes: tuple[Mesh, ...]
    lights: tuple[Light, ...]
    cameras: tuple[Camera, ...]
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = "scene"
    path: str = ""
    notices: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    sky_gradient: tuple[float, float, float] = (0.0, 0.0, 0.0)
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    own_sky: bool = True
    environment: Environment | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name, kind in (("meshes", Mesh), ("lights", Light), ("cameras", Camera)):
            given = getattr(self, name)
            if not isinstance(given, Iterable):
                raise InputError(f"a scene's {name} are a sequence of {kind.__name__}, not one {type(given).__name__}")
            put(self, **{name: tuple(given)})
            for one in getattr(self, name):
                check_type(f"one of a scene's {name}", one, kind)
        put(self, sky=checked("a scene's sky", self.sky, 3, 0.0))
        put(self, sky_gradient=checked("a scene's sky_gradient", self.sky_gradient, 3))
        put(self, up=checked("a scene's up", self.up, 3), origin=checked("a scene's origin", self.origin, 3))
        if not any(self.up):
            raise InputError("a scene's up is 0 0 0; give the direction that points up")
        check_type("a scene's environment", self.environment, Environment, None)

    def __repr__(self) -> str:
        """Return one line without arrays, for notebooks."""
        triangles = sum(len(mesh.faces) for mesh in self.meshes)
        counts = {"meshes": len(self.meshes), "triangles": triangles, "lights": len(self.lights), "cameras": len(self.cameras)}
        return f"<Scene {self.name!r}, " + ", ".join(f"{what}: {count}" for what, count in counts.items()) + ">"

    @cached_property
    def local(self) -> Scene:
        """The scene with lights and cameras relative to its origin as well, as renderers use it."""
        return self._shifted(np.negative(self.origin), (0.0, 0.0, 0.0)) if any(self.origin) else self

    def placed(self, origin: tuple[float, float, float]) -> Scene:
        """Return the scene with this origin, whose `local` state this is."""
        return self._shifted(origin, origin) if any(origin) else self

    def _shifted(self, by: npt.ArrayLike, origin: tuple[float, float, float]) -> Scene:
        lights = tuple(light.shifted(by) for light in self.lights)
        return replace(self, lights=lights, cameras=tuple(camera.shifted(by) for camera in self.cameras), origin=origin)

    def relative_to(self, origin: tuple[float, float, float]) -> Scene:
        """Return the scene relative to another origin."""
        if tuple(origin) == tuple(self.origin):
            return self
        by = np.subtract(self.origin, origin)
        meshes = (replace(mesh, positions=(mesh.positions + by).astype(np.float32)) for mesh in self.meshes)
        return replace(self, meshes=tuple(meshes), origin=origin)

    @property
    def recentred(self) -> Scene:
        """The scene relative to a nearby origin, if it lies far from 0 0 0 and has none; else unchanged."""
        origin = self.origin if any(self.origin) else near_origin(*self.bounds)
        return self.relative_to(origin)

    @property
    def sky_parts(self) -> tuple[object, ...]:
        """All values that the sky's radiance depends on."""
        return self.sky, self.sky_gradient, self.up if any(self.sky_gradient) else None, self.own_sky, self.environment

    @property
    def uniform_sky(self) -> bool:
        """True if the radiance of the sky is equal in all directions."""
        return self.environment is None and not any(self.sky_gradient)

    @cached_property
    def materials(self) -> dict[Material, int]:
        """The distinct materials of its meshes, with their numbers."""
        return {material: i for i, material in enumerate(dict.fromkeys(mesh.material for mesh in self.meshes))}

    @cached_property
    def emissive(self) -> bool:
        """True if a surface emits light."""
        return any(any(material.emission) for material in self.materials)

    def sky_radiance(self, directions: np.ndarray, solid: np.ndarray | float = 0.0) -> np.ndarray:
        """Return (…, 3) radiance of the visible sky in unit directions (…, 3) of `solid` steradians each."""
        if self.environment is not None:
            return self.environment.seen(directions, solid)
        rise = directions @ np.asarray(self.up)
        return np.asarray(np.asarray(self.sky) + rise[..., None] * np.asarray(self.sky_gradient))

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) float64, world space: the least and greatest corner of the geometry; zeros for an empty scene."""
        boxes = [mesh.bounds for mesh in self.meshes if len(mesh.positions)]
        if not boxes:
            return np.zeros((2, 3))
        found = box(np.concatenate(boxes)).astype(float)
        return found + self.origin if any(self.origin) else found

    @cached_property
    def shaded_bounds(self) -> np.ndarray:
        """(2, 3) float64, world space: the part of `bounds` whose projection along parallel light has all shadows of that light.

        If the largest mesh is a ground, these are the bounds of the others. A ground is flat, or convex and apart from them.
        """
        boxes = {mesh: mesh.bounds.astype(float) + self.origin for mesh in self.meshes if len(mesh.positions)}
        if len(boxes) < 2:
            return self.bounds
        ground = max(boxes, key=lambda mesh: float(np.linalg.norm(np.ptp(boxes[mesh], axis=0))))
        low, high = boxes.pop(ground)
        rest = box(np.concatenate([*boxes.values()]))
        apart = bool(((rest[0] >= high) | (rest[1] <= low)).any())
        return rest if ground.form == "flat" or (ground.form == "convex" and apart) else self.bounds

    @cached_property
    def near_bounds(self) -> np.ndarray:
        """(2, 3) float64, world space: `shaded_bounds` without a ground that is _DISTANT times as large, else `bounds`."""
        near = self.shaded_bounds
        return near if _DISTANT * float(np.linalg.norm(near[1] - near[0])) < self.diagonal else self.bounds

    @property
    def corners(self) -> np.ndarray:
        """(8, 3) float64: the corners of the bounding box."""
        return corners(self.bounds)

    @cached_property
    def diagonal(self) -> float:
        """The length of the bounding box's diagonal in metres; 1 for an empty scene."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0])) or 1.0

    @property
    def triangles(self) -> int:
        """The number of triangles."""
        return sum(len(m.faces) for m in self.meshes)

    def camera(self, name: str | Camera | None = None) -> Camera:
        """Return the camera called `name` (None: the default one; a Camera: itself); raise InputError with the existing names."""
        if name is None:
            if not self.cameras:
                raise InputError("the scene has no camera; give one")
            return self.cameras[0]
        if isinstance(name, Camera):
            return name
        if not isinstance(name, str):
            raise InputError(f"a camera is a Camera or the name of one of the scene's, not {type(name).__name__}")
        for camera in self.cameras:
            if camera.name == name:
                return camera
        names = [c.name for c in self.cameras if c.name]
        meant, listed = did_you_mean(name, names), ", ".join(map(repr, names)) or "none"
        raise InputError(f"there is no camera '{name}'{meant}; the named cameras here: {listed}")
