"""A scene as plain, immutable numpy data: meshes, materials, lights, cameras and sky; nothing of OpenGL."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from irrsplat.core.color import LUMINANCE
from irrsplat.core.errors import InputError, did_you_mean
from irrsplat.core.vectors import near_origin
from irrsplat.sky.environment import Environment


@dataclass(frozen=True, eq=False)  # compared by identity: two textures share an image where it is the same object
class Image:
    """A picture that surfaces wear.

    pixels: (H, W, 4) uint8, top row first; red, green and blue are sRGB-encoded, those of a normal map the stored
    values; alpha is linear. name: of its file, for notices.
    """

    pixels: np.ndarray
    name: str = ""

    @cached_property
    def alpha_range(self) -> tuple[float, float]:
        """The least and the greatest alpha of its pixels, 0..1."""
        alpha = self.pixels[..., 3]
        return int(alpha.min()) / 255.0, int(alpha.max()) / 255.0


Wrap = Literal["repeat", "mirror", "clamp"]
AlphaMode = Literal["opaque", "mask", "blend"]


@dataclass(frozen=True)
class Texture:
    """An image, and how it lies on a surface.

    uv_set: which of a mesh's two sets of coordinates, 0 or 1. transform: (a, b, c, d, e, f), the image's coordinates are
    (a·u + b·v + c, d·u + e·v + f). They run from (0, 0) at the image's top left corner to (1, 1) at its bottom right one.
    wrap: beyond that, along u and v. nearest: magnified texels are squares, not blended.
    """

    image: Image
    uv_set: int = 0
    transform: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    nearest: bool = False


@dataclass(frozen=True)
class Material:
    """A Lambertian surface, lit from both sides.

    albedo: (3,) diffuse reflectance in 0..1, linear; times the colour of albedo_texture. emission: (3,) emitted radiance in
    W/(m² sr), from both sides; times the colour of emission_texture.
    normal_texture: a tangent-space normal map (green up, as glTF has it); normal_scale: factor on its x and y.
    opacity: 0..1, times the alpha of albedo_texture. alpha_mode: "opaque" ignores opacity; "mask" is not there where it is below
    alpha_cutoff; "blend" lets what is behind show through. transmission: 0..1, the share of light that passes what is there.
    unlit: it reflects nothing (albedo 0), and what it emits is times the colours of vertices, if there are any.
    double_sided: False, and a camera does not see it from behind; to light it is there from both sides.
    """

    albedo: tuple[float, float, float] = (0.5, 0.5, 0.5)
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    albedo_texture: Texture | None = None
    emission_texture: Texture | None = None
    normal_texture: Texture | None = None
    normal_scale: float = 1.0
    opacity: float = 1.0
    alpha_mode: AlphaMode = "opaque"
    alpha_cutoff: float = 0.5
    transmission: float = 0.0
    double_sided: bool = True
    unlit: bool = False

    @property
    def light_cutoff(self) -> float:
        """The opacity (of `opacity`, texture and vertices) from which on light sees the surface; 0: always; above 1: never.

        The rule: what is cut out is not there. What blends or transmits is there to light where more than half of the light would
        be held back; elsewhere light passes as if there were nothing, and the picture is tinted (a filter).
        """
        if self.alpha_mode == "mask":
            return self.alpha_cutoff if self.transmission <= 0.5 else 2.0
        if self.transmission > 0.5:
            return 2.0
        return 0.5 / (1.0 - self.transmission) if self.alpha_mode == "blend" else 0.0

    @property
    def filters(self) -> bool:
        """Whether it may tint what is behind it: the picture shows that times 1 - opacity·(1 - albedo)."""
        return self.alpha_mode == "blend" or self.transmission > 0.5

    @property
    def textures(self) -> tuple[Texture, ...]:
        """Those that it has."""
        all_of_them = self.albedo_texture, self.emission_texture, self.normal_texture
        return tuple(texture for texture in all_of_them if texture is not None)


@dataclass(frozen=True, eq=False)  # compared by identity: arrays have no single answer to ==, and a moved mesh is a new one
class Mesh:
    """Triangles in world space, or relative to their scene's origin; each mesh is equal only to itself.

    positions: (V, 3) float32, metres. normals: (V, 3) float32, unit shading normals. faces: (F, 3) int32.
    colors: (V, 3) float32 linear reflectance that replaces material.albedo, or the factor on the emission of an unlit one, or
    None. opacities: (V,) float32 that replaces material.opacity, or None. uvs: (V, 4) float32, two sets of texture coordinates,
    u v u v, or None (all 0).
    closed: True only where the surface is watertight and wound outward (in world space).
    """

    positions: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Material)
    colors: np.ndarray | None = None
    closed: bool = False
    name: str = ""
    uvs: np.ndarray | None = None
    opacities: np.ndarray | None = None

    @cached_property
    def is_point(self) -> bool:
        """Whether all its vertices lie in one point, so that nothing of it is there to see."""
        return not np.ptp(self.positions, axis=0).any() if len(self.positions) else True


@dataclass(frozen=True, eq=False)  # compared by identity: arrays have no single answer to ==
class Photometry:
    """How strongly a luminaire shines in each direction, as goniometers measure it; linear in both angles.

    Its frame: it is aimed along −z, and the horizontal angle 0 lies towards +x, 90° towards +y.
    axes: (3, 3) rows, unit, in that frame: the directions of azimuth 0, of azimuth 90° and of the pole. polar: (P,) degrees from
    the pole, rising, 0..180; there is no light beyond either end. azimuth: (A,) degrees about the pole, rising over 360 at most,
    no light beyond either end; one alone: the same all around. candela: (A, P) cd.
    opening: width, length and height of the luminous opening in metres; the light leaves a point all the same. path: of its file.
    """

    polar: np.ndarray
    azimuth: np.ndarray
    candela: np.ndarray
    axes: np.ndarray
    opening: tuple[float, float, float] = (0.0, 0.0, 0.0)
    path: str = ""

    EDGE = 1e-3  # degrees by which rounding may take a direction beyond the ends

    def intensity(self, directions: np.ndarray) -> np.ndarray:
        """(…,) cd along unit directions (…, 3) in the luminaire's frame."""
        x, y, z = np.moveaxis(np.asarray(directions, float) @ self.axes.T, -1, 0)
        polar, azimuth, first = np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x)), self.azimuth[0]
        i, s, within_polar = _between(self.polar, polar, self.EDGE)
        k, t, within_azimuth = _between(self.azimuth, first + np.mod(azimuth - first, 360.0), self.EDGE)
        c, n = self.candela, np.minimum(k + 1, len(self.azimuth) - 1)
        low, high = c[k, i] * (1.0 - t) + c[n, i] * t, c[k, i + 1] * (1.0 - t) + c[n, i + 1] * t
        found: np.ndarray = np.where(within_polar & within_azimuth, low * (1.0 - s) + high * s, 0.0)
        return found

    @cached_property
    def flux(self) -> float:
        """lm: the integral of the intensity over all directions, exact for what is linear in both angles."""
        g = np.radians(self.polar)
        a, b, step = g[:-1], g[1:], np.diff(g)
        # over an interval ∫ sin γ dγ is cos a − cos b, and ∫ γ·sin γ dγ is sin b − b·cos b − sin a + a·cos a
        whole, moment = np.cos(a) - np.cos(b), np.sin(b) - b * np.cos(b) - np.sin(a) + a * np.cos(a)
        rising = (moment - a * whole) / step
        zonal = self.candela[:, :-1] @ (whole - rising) + self.candela[:, 1:] @ rising
        if len(zonal) == 1:
            return float(2.0 * np.pi * zonal[0])
        return float((0.5 * (zonal[:-1] + zonal[1:])) @ np.diff(np.radians(self.azimuth)))

    @cached_property
    def peak(self) -> float:
        """cd: the greatest intensity."""
        return float(self.candela.max())

    @cached_property
    def reach(self) -> float:
        """Degrees: no light leaves it at a greater angle to the aim."""
        lit = np.pad(self.candela > 0.0, 1)
        rows, columns = self.candela.shape
        touched = np.any([lit[i : i + rows, k : k + columns] for i in range(3) for k in range(3)], axis=0)
        polar, azimuth = np.radians(self.polar), np.radians(self.azimuth)[:, None]
        parts = np.broadcast_arrays(np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar))
        along_aim = -(np.stack(parts, axis=-1) @ self.axes)[..., 2]
        return math.degrees(math.acos(min(max(float(along_aim[touched].min(initial=1.0)), -1.0), 1.0)))

    @cached_property
    def digest(self) -> bytes:
        """32 bytes that differ wherever its light does."""
        whole = hashlib.sha256()
        for array in (self.polar, self.azimuth, self.candela, self.axes):
            whole.update(f"{array.shape}".encode() + np.asarray(array, np.float64).tobytes())
        return whole.digest()


def _between(angles: np.ndarray, values: np.ndarray, edge: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each value the number of the last angle (but one) that is not above it, the share of the way from there to the next
    angle, and whether it lies between the first angle and the last; a lone angle stands for all."""
    if len(angles) == 1:
        return np.zeros(values.shape, int), np.zeros(values.shape), np.ones(values.shape, bool)
    i = np.clip(np.searchsorted(angles, values, side="right") - 1, 0, len(angles) - 2)
    share = np.clip((values - angles[i]) / (angles[i + 1] - angles[i]), 0.0, 1.0)
    return i, share, (values >= angles[0] - edge) & (values <= angles[-1] + edge)


@dataclass(frozen=True)
class Light:
    """A delta light: a point, a spot, a directional one or a luminaire.

    position: (3,) world space; for a directional light the direction *towards* the light (need not be unit).
    color: (3,) OpenGL's `diffuse`, or the radiant intensity in W/sr where `physical`.
    attenuation: OpenGL's (constant, linear, quadratic); not used where `physical` (then 1/d²).
    spot_target: the point that a spot looks at, or None (no cone). spot_cutoff, spot_inner: half angles in degrees;
    full intensity inside spot_inner, falling linearly in the angle to 0 at spot_cutoff; equal: a hard edge.
    spot_exponent: OpenGL's cos^exponent inside the cone.
    photometry: of a luminaire, which is `physical`: its radiant intensity is color times the photometry's candela divided by
    LUMINOUS_EFFICACY, W/sr, and it has no cone. It is aimed at spot_target (None: along −z), and turned about that axis so that
    its horizontal angle 0 lies towards `across`, (3,) world space, any length, as far as that is at right angles to the axis.
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
    photometry: Photometry | None = None
    across: tuple[float, float, float] = (1.0, 0.0, 0.0)

    @property
    def kind(self) -> str:
        """Its kind in a word, for people: directional, luminaire, spot or point."""
        if self.photometry is not None:
            return "luminaire"
        return "directional" if self.directional else "spot" if self.has_cone else "point"

    def shifted(self, by: npt.ArrayLike) -> Light:
        """The light `by` (3,) metres from here; a directional one shines as before."""
        if self.directional:
            return self
        target = None if self.spot_target is None else _sum(self.spot_target, by)
        return replace(self, position=_sum(self.position, by), spot_target=target)

    @property
    def has_cone(self) -> bool:
        """Whether it is a spot: spot_target, spot_cutoff, spot_inner and spot_exponent say where it shines."""
        return self.spot_target is not None and self.photometry is None

    @property
    def frame(self) -> np.ndarray:
        """(3, 3) rows x, y and z of a luminaire's frame in world space, unit; −z is its aim."""
        aim = np.array([0.0, 0.0, -1.0])
        if self.spot_target is not None and tuple(self.spot_target) != tuple(self.position):
            aim = np.subtract(self.spot_target, self.position)
        z = -aim / np.linalg.norm(aim)
        across = np.asarray(self.across, float) / max(float(np.linalg.norm(self.across)), 1e-300)
        x = across - (across @ z) * z
        if np.linalg.norm(x) < 1e-6:  # along the aim: the axis that is least so, y before z
            across = np.eye(3)[np.argmin(np.abs(z))]
            x = across - (across @ z) * z
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(z, x), z])

    @property
    def output(self) -> tuple[float, float]:
        """A luminaire's flux in lm and its greatest intensity in cd, both times the luminance of its colour."""
        if self.photometry is None:
            return 0.0, 0.0
        shine = float(np.asarray(self.color, float) @ LUMINANCE)
        return shine * self.photometry.flux, shine * self.photometry.peak

    @property
    def key(self) -> tuple[npt.ArrayLike | None, ...]:
        """All that what it lights depends on: its fields without the name; of a luminaire 32 numbers for its photometry."""
        values = tuple(value for name, value in vars(self).items() if name not in ("name", "photometry", "across"))
        return values if self.photometry is None else (*values, tuple(self.photometry.digest), self.across)


def _sum(place: tuple[float, float, float], by: npt.ArrayLike) -> tuple[float, float, float]:
    x, y, z = np.add(place, np.asarray(by, float)).tolist()
    return x, y, z


def sun_lights(environment: Environment) -> tuple[Light, ...]:
    """The suns of a sky as the lights that a scene under it has."""
    found = []
    for sun in environment.suns:
        red, green, blue = (value / math.pi for value in sun.irradiance)
        found.append(Light(environment.toward(sun), (red, green, blue), directional=True, name="sun"))
    return tuple(found)


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

    def shifted(self, by: npt.ArrayLike) -> Camera:
        """The camera `by` (3,) metres from here, with the same view."""
        return replace(self, eye=_sum(self.eye, by), target=_sum(self.target, by))

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
    """All that is lit and seen. `cameras[0]` is the default one.

    sky: (3,) mean radiance of the environment; sky_gradient: (3,) how much brighter it is straight up; what comes from the unit
    direction d is sky + sky_gradient·dot(d, up), or what `environment` has there, if there is one; its suns are among the lights.
    up: (3,) unit, world space. own_sky: whether the file has asked for this sky; a stand-in is not what the camera shows behind
    things.
    notices: one-line remarks of the loader (degenerate triangles dropped, a sky invented, …), for a user to read.
    files: the paths of all files that it was read from.
    origin: (3,) world space, float64: what the positions of the meshes are relative to. It is near the scene where that lies far
    from 0 0 0, since float32 would be too coarse there; all else is in world space.
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

    @cached_property
    def local(self) -> Scene:
        """The scene with all of it relative to its origin, lights and cameras too: as renderers have it."""
        return self._shifted(np.negative(self.origin), (0.0, 0.0, 0.0)) if any(self.origin) else self

    def placed(self, origin: tuple[float, float, float]) -> Scene:
        """The scene whose `local` state this is, of that origin."""
        return self._shifted(origin, origin) if any(origin) else self

    def _shifted(self, by: npt.ArrayLike, origin: tuple[float, float, float]) -> Scene:
        lights = tuple(light.shifted(by) for light in self.lights)
        return replace(self, lights=lights, cameras=tuple(camera.shifted(by) for camera in self.cameras), origin=origin)

    def relative_to(self, origin: tuple[float, float, float]) -> Scene:
        """The same scene, of another origin."""
        if tuple(origin) == tuple(self.origin):
            return self
        by = np.subtract(self.origin, origin)
        meshes = (replace(mesh, positions=(mesh.positions + by).astype(np.float32)) for mesh in self.meshes)
        return replace(self, meshes=tuple(meshes), origin=origin)

    @property
    def recentred(self) -> Scene:
        """The same scene, of an origin near by where it lies far from 0 0 0 and has none; else this one."""
        origin = self.origin if any(self.origin) else near_origin(*self.bounds)
        return self.relative_to(origin)

    @property
    def sky_parts(self) -> tuple[object, ...]:
        """All that says what comes from the sky; equal where the same does."""
        return self.sky, self.sky_gradient, self.up if any(self.sky_gradient) else None, self.own_sky, self.environment

    @cached_property
    def materials(self) -> dict[Material, int]:
        """The different materials of its meshes, and the number of each."""
        return {material: i for i, material in enumerate(dict.fromkeys(mesh.material for mesh in self.meshes))}

    def sky_radiance(self, directions: np.ndarray, solid: np.ndarray | float = 0.0) -> np.ndarray:
        """(…, 3) radiance of the sky that a camera sees in unit directions (…, 3), each `solid` steradians wide."""
        if self.environment is not None:
            return self.environment.seen(directions, solid)
        rise = directions @ np.asarray(self.up)
        radiance: np.ndarray = np.asarray(self.sky) + rise[..., None] * np.asarray(self.sky_gradient)
        return radiance

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) float64, world space: the least and greatest corner of the geometry; zeros where there is none."""
        corners = [c for m in self.meshes if len(m.positions) for c in (m.positions.min(0), m.positions.max(0))]
        if not corners:
            return np.zeros((2, 3))
        found = np.array([np.min(corners, 0), np.max(corners, 0)], float)
        return found + self.origin if any(self.origin) else found

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
        names = [c.name for c in self.cameras if c.name]
        meant, listed = did_you_mean(name, names), ", ".join(map(repr, names)) or "none"
        raise InputError(f"there is no camera '{name}'{meant}; the named cameras here: {listed}")
