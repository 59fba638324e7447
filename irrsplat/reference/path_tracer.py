"""An independent truth: irradiance of N bounces and direct light by path tracing, with Mitsuba 3 finding the intersections.

Importing this needs the extra `reference`.
Everything radiometric is written out here (lights, spots, two-sided Lambertian surfaces), so that lights of the OpenGL
kind, which Mitsuba lacks, have a truth as well, and so that a fault of the renderer is not repeated by shared code.

E_N(p) = ∫ L(q)·cosθ dω over the hemisphere about the shading normal n, L = L_emitted + ρ/π·(E_direct + E_(N−1)) at the
surface q that is hit, or the sky's radiance; E_0 = 0; directions below the geometric surface count 0. A path has N vertices,
the first at p, each further one where a cosine-distributed ray from the one before it hits. At every vertex, what the ray
sees is estimated by two kinds of samples: that ray, and, for each positional light, a ray from the light whose hit is
connected to the vertex. The balance heuristic (Veach & Guibas 1995, eq. 9) joins the two, light by light: without the second
kind, a lamp close to a wall, which makes a tiny and very bright spot there, would hardly converge. Paths end early by Russian
roulette (Arvo & Kirk 1990), which does not change the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians
from typing import Any, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.scene.model import Camera, Light, Scene

Lanes: TypeAlias = Any  # a Dr.Jit array with an entry a lane; its class depends on the variant that is chosen at run time

TINY = 1e-30  # keeps divisors from 0
LANES = 1 << 20  # samples in flight at once; bounds the memory
LEAST_WEIGHT = 0.25  # of paths: Russian roulette keeps it; measured, 1 has up to 1.8 times the noise in little less time


def choose_variant() -> str:
    """Set a vectorised Mitsuba variant (the GPU's or LLVM's) and return its name; IrrsplatError says what is missing."""
    for variant in ("cuda_ad_rgb", "llvm_ad_rgb"):
        try:
            mi.set_variant(variant)
            dr.eval(mi.Float(0.0) + dr.arange(mi.Float, 2))
            return variant
        except Exception:  # Dr.Jit raises bare exceptions where a driver or LLVM is missing
            continue
    raise IrrsplatError(
        "Mitsuba finds neither LLVM 19 nor CUDA; install libllvm19 (Debian, Ubuntu), or let DRJIT_LIBLLVM_PATH name the library"
    )


@dataclass(frozen=True)
class Hit:
    """Surface points, one per lane; `n` and `g` are the shading and geometric normals, turned to where the ray came from."""

    valid: Lanes
    p: Lanes
    n: Lanes
    g: Lanes
    albedo: Lanes
    emission: Lanes
    ambiguous: Lanes  # the geometric normal is turned to the ray's origin, but the shading normal is not


class Tracer:
    """A scene, ready to be traced; lengths in the scene's units, radiance and irradiance in W/(m² sr) and W/m²."""

    def __init__(self, scene: Scene) -> None:
        meshes = [m for m in scene.meshes if len(m.faces)]
        first = np.cumsum([0] + [len(m.positions) for m in meshes])[:-1]
        positions = np.concatenate([m.positions for m in meshes]).astype(np.float32)
        faces = np.concatenate([m.faces + k for m, k in zip(meshes, first, strict=True)]).astype(np.uint32)
        albedo = [np.broadcast_to(m.material.albedo if m.colors is None else m.colors, m.positions.shape) for m in meshes]
        emission = [np.broadcast_to(m.material.emission, (len(m.faces), 3)) for m in meshes]

        mesh = mi.Mesh("scene", vertex_count=len(positions), face_count=len(faces))
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = positions.ravel()
        parameters["faces"] = faces.ravel()
        parameters.update()
        self.world = mi.load_dict({"type": "scene", "mesh": mesh})
        self.scene = scene
        self.epsilon = 2e-5 * scene.diagonal  # keeps a ray off the surface that it starts from

        self.positions = mi.Float(positions.ravel())
        self.faces = mi.UInt32(faces.ravel())
        self.normals = mi.Float(np.concatenate([m.normals for m in meshes]).astype(np.float32).ravel())
        self.albedo = mi.Float(np.concatenate(albedo).astype(np.float32).ravel())
        self.emission = mi.Float(np.concatenate(emission).astype(np.float32).ravel())

    # --- rays -----------------------------------------------------------------------------------------------------------

    def hit(self, origin: Lanes, direction: Lanes, active: Lanes = True) -> Hit:
        """The nearest surface from `origin` along the unit `direction`, at least epsilon away."""
        ray = mi.Ray3f(origin + self.epsilon * direction, direction)
        found = self.world.ray_intersect_preliminary(ray, coherent=False, active=mi.Bool(active))
        valid = found.is_valid() & mi.Bool(active)
        triangle = dr.gather(mi.Vector3u, self.faces, found.prim_index, active=valid)
        a, b, c = (dr.gather(mi.Point3f, self.positions, v, active=valid) for v in (triangle.x, triangle.y, triangle.z))
        u, v = (dr.select(valid, x, 0.0) for x in (found.prim_uv.x, found.prim_uv.y))

        def interpolate(values: Lanes) -> Lanes:
            x, y, z = (dr.gather(mi.Vector3f, values, k, active=valid) for k in (triangle.x, triangle.y, triangle.z))
            return x * (1.0 - u - v) + y * u + z * v

        g = dr.select(valid, dr.normalize(dr.cross(b - a, c - a)), -direction)
        g = dr.select(dr.dot(g, direction) < 0.0, g, -g)
        n = interpolate(self.normals)
        n = dr.select(dr.dot(n, n) > 0.0, dr.normalize(n), g)
        n = dr.select(dr.dot(n, g) < 0.0, -n, n)
        return Hit(
            valid=valid,
            p=mi.Point3f(a * (1.0 - u - v) + b * u + c * v),
            n=n,
            g=g,
            albedo=mi.Color3f(interpolate(self.albedo)),
            emission=dr.gather(mi.Color3f, self.emission, found.prim_index, active=valid),
            ambiguous=dr.dot(n, direction) >= 0.0,
        )

    def visible(self, origin: Lanes, direction: Lanes, distance: Lanes, active: Lanes) -> Lanes:
        """True where nothing lies between `origin` and the point at `distance` along the unit `direction`."""
        length = distance - 2.0 * self.epsilon
        ray = mi.Ray3f(mi.Ray3f(origin + self.epsilon * direction, direction), length)
        return active & ((length <= 0.0) | ~self.world.ray_test(ray, coherent=False, active=active))

    # --- lights ---------------------------------------------------------------------------------------------------------

    def unoccluded(self, light: Light, p: Lanes, n: Lanes, g: Lanes) -> tuple[Lanes, Lanes, Lanes]:
        """(E, direction, distance): E_direct of `light` at p before any shadow, and the way to it (inf: directional)."""
        toward = mi.Vector3f(*light.position) if light.directional else mi.Point3f(*light.position) - p
        distance = dr.norm(toward)
        w = toward / (distance + TINY)
        strength: Lanes = pi
        if light.physical:
            strength = dr.rcp(dr.square(distance) + TINY)
        elif not light.directional:
            k_c, k_l, k_q = light.attenuation
            strength = pi / (k_c + k_l * distance + k_q * dr.square(distance))
        if has_cone(light):
            strength = strength * self.spot(light, -w)
        cosine = dr.select(dr.dot(g, w) > 0.0, positive(dr.dot(n, w)), 0.0)
        return mi.Color3f(*light.color) * (strength * cosine), w, mi.Float(dr.inf) if light.directional else distance

    @staticmethod
    def spot(light: Light, direction: Lanes) -> Lanes:
        """The factor of the light's cone along the unit `direction` away from it: exponent and falloff."""
        cosine = dr.dot(mi.Vector3f(axis(light)), direction)
        inner = min(light.spot_inner, light.spot_cutoff)
        cone: Lanes = dr.select(cosine >= cos(radians(light.spot_cutoff)), mi.Float(1.0), 0.0)
        if inner < light.spot_cutoff:
            angle = dr.acos(cosine * (1.0 - 1e-7)) * (180.0 / pi)
            falloff = (light.spot_cutoff - angle) / (light.spot_cutoff - inner)
            cone = dr.select(cosine >= cos(radians(inner)), cone, positive(falloff))
        return cone * dr.power(positive(cosine) + TINY, light.spot_exponent) if light.spot_exponent > 0.0 else cone

    def lit(self, light: Light, hit: Hit) -> tuple[Lanes, Lanes]:
        """(E_direct with shadow, E_direct before it) of one light at surface points."""
        E, w, distance = self.unoccluded(light, hit.p, hit.n, hit.g)
        seen = self.visible(hit.p, w, distance, hit.valid & lights(E))
        return dr.select(seen, E, 0.0), E

    # --- the two estimators ---------------------------------------------------------------------------------------------

    def irradiance(self, p: np.ndarray, n: np.ndarray, g: np.ndarray, side: int, seed: int, bounces: int = 1) -> np.ndarray:
        """(N, 3) E of so many `bounces` at points `p` (N, 3) with shading and geometric normals `n`, `g`; side² paths each."""
        step = max(LANES // (side * side), 1)
        parts = [np.zeros((0, 3))]
        for k in range(0, len(p), step):
            some = [mi.Vector3f(x[k : k + step].T) for x in (p, n, g)]
            parts.append(self._irradiance(some[0], some[1], some[2], side, seed * 100_003 + k, bounces))
        return np.concatenate(parts)

    def _irradiance(self, p: Lanes, n: Lanes, g: Lanes, side: int, seed: int, bounces: int) -> np.ndarray:
        count = side * side
        lane = dr.arange(mi.UInt32, dr.width(p) * count)
        point = lane // count
        p, n, g = (dr.gather(mi.Vector3f, x, point) for x in (p, n, g))
        random: Lanes = mi.PCG32(size=dr.width(lane), initstate=seed)
        stratum = mi.Point2u((lane % count) % side, (lane % count) // side)

        def uniform() -> Lanes:  # a point in the unit square per lane, of the first vertex a stratified one
            u = mi.Point2f(random.next_float32(), random.next_float32())
            return u if vertex else (mi.Point2f(stratum) + u) / side

        path: Lanes = lane
        total: Lanes = dr.zeros(mi.Color3f, dr.width(lane))
        weight: Lanes = mi.Color3f(1.0)
        for vertex in range(bounces):
            seen, q = self._seen(mi.Point3f(p), n, g, uniform)
            seen *= weight
            dr.eval(seen, q, random)
            if not vertex:
                total = seen
            else:
                dr.scatter_add(total, seen, path)
            if vertex + 1 == bounces:
                break
            weight *= q.albedo
            lives = survival(weight)
            on: Lanes = dr.compress(q.valid & (random.next_float32() < lives))
            if not len(on):
                break
            p, n, g, weight, path, random = (dr.gather(type(x), x, on) for x in (q.p, q.n, q.g, weight / lives, path, random))
        dr.eval(total)
        sums = [dr.block_sum(total[k], count) for k in range(3)]
        return np.stack([np.array(s, dtype=np.float64) for s in sums], axis=1) / count

    def _seen(self, p: Lanes, n: Lanes, g: Lanes, uniform: Lanes) -> tuple[Lanes, Hit]:
        """E_1 at each p as estimated by one ray from it and one from each light; and the hits of the rays from p."""
        direction = mi.Frame3f(n).to_world(cosine_hemisphere(uniform()))
        above = dr.dot(direction, g) > 0.0
        q = self.hit(p, direction, above)
        total = mi.Color3f(dr.select(q.valid, q.emission, dr.select(above, mi.Color3f(*self.scene.sky), 0.0))) * pi
        for light in self.scene.lights:
            E, _ = self.lit(light, q)
            w: Lanes = 1.0
            if not light.directional:
                p_ray, p_light = self._densities(light, p, n, q.p, q.g)
                w = dr.select(p_ray > 0.0, p_ray / (p_ray + p_light), 1.0)
            total += dr.select(q.valid, q.albedo * E * w, 0.0)
        for light in self.scene.lights:
            if not light.directional:
                total += self._from_light(light, p, n, g, uniform())
        return total, q

    def _from_light(self, light: Light, p: Lanes, n: Lanes, g: Lanes, u: Lanes) -> Lanes:
        """The share of E_1 that comes from connecting the hits of rays from `light` to p."""
        if has_cone(light):
            direction = mi.Frame3f(mi.Vector3f(axis(light))).to_world(uniform_cap(u, cos(radians(light.spot_cutoff))))
        else:
            direction = uniform_cap(u, -1.0)
        q = self.hit(mi.Point3f(*light.position), direction)
        back = p - q.p
        r = dr.norm(back)
        back /= r + TINY
        cos_p = dr.dot(n, -back)
        # only the side of q that the light sees is lit, so p must lie on that side
        active = q.valid & (r > 0.0) & (cos_p > 0.0) & (dr.dot(g, -back) > 0.0) & (dr.dot(q.g, back) > 0.0)
        E, _, _ = self.unoccluded(light, q.p, q.n, q.g)
        active &= self.visible(p, -back, r, active & lights(E))
        p_ray, p_light = self._densities(light, p, n, q.p, q.g)
        L = q.albedo * E / pi
        geometry = cos_p * dr.dot(q.g, back) / dr.square(r)
        return dr.select(active & (p_ray + p_light > 0.0), L * geometry / (p_ray + p_light), 0.0)

    @staticmethod
    def _densities(light: Light, p: Lanes, n: Lanes, q: Lanes, g: Lanes) -> tuple[Lanes, Lanes]:
        """Densities per area at q of a cosine-distributed ray from p, and of a ray from the light."""
        to_p, to_light = p - q, mi.Point3f(*light.position) - q
        r, d = dr.norm(to_p), dr.norm(to_light)
        p_ray = positive(dr.dot(n, -to_p)) * dr.abs(dr.dot(g, to_p)) / (pi * r * r * r * r)
        density = 1.0 / (4.0 * pi)
        inside = mi.Bool(True)
        if has_cone(light):
            edge = cos(radians(light.spot_cutoff))
            density = 1.0 / (2.0 * pi * (1.0 - edge))
            inside = dr.dot(mi.Vector3f(axis(light)), -to_light) >= edge * d
        p_light = dr.select(inside & (dr.dot(g, to_light) > 0.0), density * dr.dot(g, to_light) / (d * d * d), 0.0)
        return dr.select(r > 0.0, p_ray, 0.0), dr.select(d > 0.0, p_light, 0.0)


def camera_rays(camera: Camera, size: tuple[int, int], dx: float | np.ndarray = 0.5, dy: float | np.ndarray = 0.5) -> np.ndarray:
    """(W·H, 3) unit directions, row by row from the top, through the point (dx, dy) of every pixel (0.5: its centre).

    size: (W, H). dx, dy: 0..1 to the right and downward, one number or (H, W).
    """
    width, height = size
    row, column = np.indices((height, width))
    slope = np.tan(np.radians(camera.fov) / 2.0)
    x = ((column + dx) / width * 2.0 - 1.0) * slope * (width / height)
    y = (1.0 - (row + dy) / height * 2.0) * slope
    world = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ camera.axes
    directions: np.ndarray = world / np.linalg.norm(world, axis=1, keepdims=True)
    return directions


def look(
    tracer: Tracer, camera: Camera, size: tuple[int, int], dx: float | np.ndarray = 0.5, dy: float | np.ndarray = 0.5
) -> Hit:
    """What the camera sees through one point of every pixel, as camera_rays has it; one lane per pixel."""
    return tracer.hit(mi.Point3f(*camera.eye), mi.Vector3f(camera_rays(camera, size, dx, dy).T))


def image(values: Lanes, size: tuple[int, int]) -> np.ndarray:
    """(H, W, …) array of what lies in W·H lanes."""
    array, (width, height) = np.array(values), size
    return array.T.reshape(height, width, -1) if array.ndim == 2 else array.reshape(height, width)


def cosine_hemisphere(u: Lanes) -> Lanes:
    """Cosine-distributed unit directions about z."""
    sine, phi = dr.sqrt(u.x), 2.0 * pi * u.y
    return mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), dr.sqrt(positive(1.0 - u.x)))


def uniform_cap(u: Lanes, edge: float) -> Lanes:
    """Uniform unit directions whose z is at least `edge`; the whole sphere where that is −1."""
    z, phi = 1.0 - u.x * (1.0 - edge), 2.0 * pi * u.y
    sine = dr.sqrt(positive(1.0 - z * z))
    return mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), z)


def survival(weight: Lanes) -> Lanes:
    """The probability that a path of this weight goes on: 1 while its brightest channel is above LEAST_WEIGHT."""
    most = dr.select(weight.x > weight.y, weight.x, weight.y)
    most = dr.select(most > weight.z, most, weight.z) / LEAST_WEIGHT
    return dr.select(most < 1.0, most, 1.0)


def positive(x: Lanes) -> Lanes:
    """max(x, 0), without the `fmaximum` of dr.maximum: LLVM sometimes fails to compile it (AVX-512, "Cannot select")."""
    return dr.select(x > 0.0, x, 0.0)


def lights(E: Lanes) -> Lanes:
    """Whether any channel is positive."""
    return (E.x > 0.0) | (E.y > 0.0) | (E.z > 0.0)


def has_cone(light: Light) -> bool:
    """Whether the light is a spot; half angles of 90 and 180 degrees mean no cone, as in the scene format."""
    return not light.directional and light.spot_target is not None and light.spot_cutoff not in (90.0, 180.0)


def axis(light: Light) -> list[float]:
    """A spot's unit axis, from the light to the point that it looks at."""
    toward = np.subtract(light.spot_target or (0.0, 0.0, 0.0), light.position)
    return [float(x) for x in toward / np.linalg.norm(toward)]
