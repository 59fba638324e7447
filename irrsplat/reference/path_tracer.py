"""An independent reference: irradiance of N bounces and direct light by path tracing, with Mitsuba 3 for intersections.

Importing this needs the extra `reference`. All radiometry is written out here: lights, spots, luminaires, two-sided Lambertian
surfaces and their textures. Lights of the OpenGL kind, which Mitsuba lacks, thus have a reference, and no shared code repeats a
fault of the renderer.

E_N(p) = ∫ L(q)·cosθ dω over the hemisphere about the normal n, with L = L_emitted + ρ/π·(E_direct + E_(N−1)) at the hit surface
q, or the sky's radiance; E_0 = 0. Directions below the geometric surface count 0. At a pixel, n includes the normal map; at q it
is interpolated. Rays pass surfaces below Material.light_cutoff. A path has N vertices, the first at p, each further one at the
hit of a cosine-distributed ray from the vertex before.

At every vertex, three kinds of samples estimate the incident light. They are the ray itself, for each positional light a ray from
the light whose hit is connected to the vertex, and a connection to a point on an emitting triangle (emitters.py). The balance
heuristic (Veach & Guibas 1995, eq. 9) combines the first kind with each of the others, light by light. Without the second, a
light near a wall, which makes a tiny bright spot, would hardly converge; without the third, neither would a small bulb. Russian
roulette (Arvo & Kirk 1990) ends paths early without bias.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.reference.camera_view import Visible, camera_rays, epsilon_of, seen
from irrsplat.reference.emitters import Emitters
from irrsplat.reference.lanes import (
    BACKEND,
    TINY,
    EmitterLanes,
    Lanes,
    PhotometryLanes,
    cosine_hemisphere,
    density_of_ray,
    lights,
    polar_angle,
    positive,
    uniform_cap,
)
from irrsplat.reference.surfaces import Surfaces
from irrsplat.reference.textures import TextureTable
from irrsplat.scene.model import Camera, Light, Photometry, Scene

LANES = 1 << 20  # samples in flight at once; limits the memory
LEAST_WEIGHT = 0.25  # path weight kept by Russian roulette; measured, 1 has up to 1.8 times the noise in little less time


def choose_variant() -> str:
    """Set a vectorised Mitsuba variant (the GPU's or LLVM's) and return its name; raises IrrsplatError if a library is
    missing."""
    for variant in ("cuda_ad_rgb", "llvm_ad_rgb"):
        try:
            mi.set_variant(variant)
            dr.eval(mi.Float(0.0) + dr.arange(mi.Float, 2))
            return variant
        except Exception:  # Dr.Jit raises bare exceptions if a driver or LLVM is missing
            continue
    raise IrrsplatError(
        "Mitsuba finds neither LLVM 19 nor CUDA; install libllvm19 (Debian, Ubuntu), or let DRJIT_LIBLLVM_PATH name the library"
    )


def generator(seed: int, first: int, lane: Lanes) -> Lanes:
    """Return a generator of random numbers for each lane, independent of other lanes and seeds; first: number added to `lane`.

    State and stream are hashed as in Mitsuba's samplers: PCG32's streams of consecutive numbers are correlated.
    """
    whole, before = (dr.opaque(mi.UInt32, number % 2**32) for number in (seed, first))  # avoids a compilation per seed
    pcg: Any = mi.PCG32
    hashed: Any = mi.sample_tea_32
    state, stream = hashed(whole, before + lane)
    return pcg(initstate=mi.UInt64(state), initseq=mi.UInt64(stream))


@dataclass(frozen=True)
class Hit:
    """Surface points, one per lane.

    `n` and `g`: shading and geometric normals, turned to the ray's origin; `face`: number among the triangles that light may hit.
    """

    valid: Lanes
    p: Lanes
    n: Lanes
    g: Lanes
    albedo: Lanes
    emission: Lanes
    face: Lanes
    ambiguous: Lanes  # only the geometric normal, not the shading normal, is turned to the ray's origin


class Tracer:
    """A scene for tracing; lengths in the scene's units, radiance and irradiance in W/(m² sr) and W/m²."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.surfaces = scene, Surfaces.of(scene)
        self.epsilon = epsilon_of(scene)  # offset of a ray from its surface
        surfaces, table = self.surfaces, self.surfaces.materials
        may, depends = surfaces.seen_by_light
        solid = np.flatnonzero(may)  # the triangles that light may hit
        faces, material = surfaces.faces[solid], surfaces.material[solid]
        self.world = _world(surfaces.positions, faces)
        self.camera_world = self.world if may.all() else _world(surfaces.positions, surfaces.faces)

        self.positions, self.normals, self.albedo = (
            mi.Float(a.ravel()) for a in (surfaces.positions, surfaces.normals, surfaces.albedo)
        )
        self.faces = mi.UInt32(faces.astype(np.uint32).ravel())
        self.emission = mi.Float(surfaces.emission[solid].ravel())
        self.emission_factor = mi.Float(surfaces.emission_factor.ravel()) if surfaces.emission_varies.any() else None

        # opacity thresholds of alpha-tested triangles; 0 elsewhere
        self.cutoff = None
        if depends.any():
            self.cutoff = mi.Float(np.where(depends[solid], table.light_cutoff[material], 0.0).astype(np.float32))
        self.opacity, self.uvs = mi.Float(surfaces.opacity), mi.Float(surfaces.uvs.ravel())
        self.textures = TextureTable.of(table.textures, BACKEND) if table.textures else None
        numbers = {kind: table.texture[kind][material] for kind in ("albedo", "emission")}  # −1 becomes the greatest number
        self.texture = {k: mi.UInt32(n.astype(np.uint32)) if (n >= 0).any() else None for k, n in numbers.items()}

        self.photometries: dict[Photometry, PhotometryLanes] = {}
        environment = scene.environment
        self.sky_map = None if environment is None else mi.Float(np.ascontiguousarray(environment.light, np.float32).ravel())
        found = Emitters.of(surfaces)
        self.emitters = None if found is None else EmitterLanes(found, np.searchsorted(solid, found.face), len(solid))

    # --- rays -----------------------------------------------------------------------------------------------------------

    def hit(self, origin: Lanes, direction: Lanes, active: Lanes = True) -> Hit:
        """Return the nearest surface that light hits, from `origin` along the unit `direction`, at least epsilon away."""
        valid, face, u, v = self._nearest(origin + self.epsilon * direction, direction, mi.Bool(active))
        corners = dr.gather(mi.Vector3u, self.faces, face, active=valid)
        a, b, c = (dr.gather(mi.Point3f, self.positions, k, active=valid) for k in (corners.x, corners.y, corners.z))
        g = dr.select(valid, dr.normalize(dr.cross(b - a, c - a)), -direction)
        g = dr.select(dr.dot(g, direction) < 0.0, g, -g)
        n = self._blended(self.normals, corners, u, v, valid)
        n = dr.select(dr.dot(n, n) > 0.0, dr.normalize(n), g)
        n = dr.select(dr.dot(n, g) < 0.0, -n, n)
        albedo, emission = self._colors(face, corners, u, v, valid)
        return Hit(
            valid=valid,
            p=mi.Point3f(a * (1.0 - u - v) + b * u + c * v),
            n=n,
            g=g,
            albedo=albedo,
            emission=emission,
            face=face,
            ambiguous=dr.dot(n, direction) >= 0.0,
        )

    def visible(self, origin: Lanes, direction: Lanes, distance: Lanes, active: Lanes) -> Lanes:
        """Return True for lanes without a hit between `origin` and `distance` along the unit `direction`."""
        length = distance - 2.0 * self.epsilon
        start = origin + self.epsilon * direction
        if self.cutoff is None:
            ray = mi.Ray3f(mi.Ray3f(start, direction), length)
            return active & ((length <= 0.0) | ~self.world.ray_test(ray, coherent=False, active=active))
        blocked, *_ = self._nearest(start, direction, active & (length > 0.0), length)
        return active & ~blocked

    def _nearest(
        self, origin: Lanes, direction: Lanes, active: Lanes, length: Lanes | None = None
    ) -> tuple[Lanes, Lanes, Lanes, Lanes]:
        """Return (valid, triangle, u, v) of the nearest hit at most `length` away; rays pass transparent points."""
        ray = mi.Ray3f(origin, direction)
        if length is not None:
            ray = mi.Ray3f(ray, length)
        found = self.world.ray_intersect_preliminary(ray, coherent=False, active=active)
        valid = found.is_valid() & active
        face = mi.UInt32(found.prim_index)
        u, v = (dr.select(valid, x, 0.0) for x in (found.prim_uv.x, found.prim_uv.y))
        if self.cutoff is None:
            return valid, face, u, v
        farthest = mi.Float(dr.inf) if length is None else length
        distance = mi.Float(dr.select(valid, found.t, 0.0))
        passes = valid & self._lets_through(face, u, v, valid)

        def step(
            passes: Lanes, valid: Lanes, face: Lanes, u: Lanes, v: Lanes, distance: Lanes
        ) -> tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes]:
            done = distance + self.epsilon
            further = mi.Ray3f(mi.Ray3f(origin + done * direction, direction), farthest - done)
            found = self.world.ray_intersect_preliminary(further, coherent=False, active=passes)
            hit = passes & found.is_valid()
            face = dr.select(hit, found.prim_index, face)
            u, v = dr.select(hit, found.prim_uv.x, u), dr.select(hit, found.prim_uv.y, v)
            distance = dr.select(hit, done + found.t, distance)
            return hit & self._lets_through(face, u, v, hit), dr.select(passes, hit, valid), face, u, v, distance

        state = passes, valid, face, mi.Float(u), mi.Float(v), distance
        _, valid, face, u, v, _ = dr.while_loop(state, lambda passes, *_: passes, step)
        return valid, face, u, v

    def _lets_through(self, face: Lanes, u: Lanes, v: Lanes, active: Lanes) -> Lanes:
        """True for points of triangles that light passes."""
        cutoff = dr.gather(mi.Float, self.cutoff, face, active=active)
        tested = active & (cutoff > 0.0)
        corners = dr.gather(mi.Vector3u, self.faces, face, active=tested)
        x, y, z = (dr.gather(mi.Float, self.opacity, k, active=tested) for k in (corners.x, corners.y, corners.z))
        opacity = x * (1.0 - u - v) + y * u + z * v
        if self.texture["albedo"] is not None:
            opacity = opacity * self._texel("albedo", face, self._places(corners, u, v, tested), tested)[3]
        return tested & (opacity < cutoff)

    def _blended(self, values: Lanes, corners: Lanes, u: Lanes, v: Lanes, active: Lanes) -> Lanes:
        """Return interpolated vectors of three vertices."""
        x, y, z = (dr.gather(mi.Vector3f, values, k, active=active) for k in (corners.x, corners.y, corners.z))
        return x * (1.0 - u - v) + y * u + z * v

    def _places(self, corners: Lanes, u: Lanes, v: Lanes, active: Lanes) -> tuple[Lanes, ...]:
        """Return the texture coordinates (u, v, u, v) at points of triangles."""
        x, y, z = (dr.gather(mi.Vector4f, self.uvs, k, active=active) for k in (corners.x, corners.y, corners.z))
        return tuple(x * (1.0 - u - v) + y * u + z * v)

    def _texel(self, kind: str, face: Lanes, uvs: tuple[Lanes, ...], active: Lanes) -> tuple[Lanes, Lanes, Lanes, Lanes]:
        """Return red, green, blue and alpha of the triangles' textures of this kind; 1 without a texture."""
        assert self.textures is not None
        number = dr.gather(mi.UInt32, self.texture[kind], face, active=active)
        worn = active & (number < len(self.surfaces.materials.textures))
        found = self.textures.color_at(dr.select(worn, number, 0), uvs)
        return tuple(dr.select(worn, channel, 1.0) for channel in found)

    def _colors(self, face: Lanes, corners: Lanes, u: Lanes, v: Lanes, active: Lanes) -> tuple[Lanes, Lanes]:
        """Return albedo and emission at points of triangles."""
        albedo = mi.Color3f(self._blended(self.albedo, corners, u, v, active))
        emission = dr.gather(mi.Color3f, self.emission, face, active=active)
        if self.emission_factor is not None:
            emission *= mi.Color3f(self._blended(self.emission_factor, corners, u, v, active))
        if self.textures is None:
            return albedo, emission
        uvs = self._places(corners, u, v, active)
        if self.texture["albedo"] is not None:
            albedo *= mi.Color3f(*self._texel("albedo", face, uvs, active)[:3])
        if self.texture["emission"] is not None:
            emission *= mi.Color3f(*self._texel("emission", face, uvs, active)[:3])
        return albedo, emission

    # --- lights ---------------------------------------------------------------------------------------------------------

    def unoccluded(self, light: Light, p: Lanes, n: Lanes, g: Lanes) -> tuple[Lanes, Lanes, Lanes]:
        """Return (E, direction, distance): unshadowed E_direct of `light` at p, and the way to it (inf: directional)."""
        toward = mi.Vector3f(*light.position) if light.directional else mi.Point3f(*light.position) - p
        distance = dr.norm(toward)
        w = toward / (distance + TINY)
        strength: Lanes = light.strength(1.0)
        if light.physical and not light.directional:
            strength = dr.rcp(dr.square(distance) + TINY)
        elif not light.directional:
            k_c, k_l, k_q = light.attenuation
            strength = pi / (k_c + k_l * distance + k_q * dr.square(distance))
        if has_cone(light):
            strength = strength * self.spot(light, -w)
        elif light.photometry is not None:
            if light.photometry not in self.photometries:
                self.photometries[light.photometry] = PhotometryLanes(light.photometry)
            strength = strength * self.photometries[light.photometry].intensity(-w, light.frame)
        cosine = dr.select(dr.dot(g, w) > 0.0, positive(dr.dot(n, w)), 0.0)
        return mi.Color3f(*light.color) * (strength * cosine), w, mi.Float(dr.inf) if light.directional else distance

    @staticmethod
    def spot(light: Light, direction: Lanes) -> Lanes:
        """Return the factor of the light's cone along the unit `direction` away from it: exponent and falloff."""
        cosine = dr.dot(mi.Vector3f(axis(light)), direction)
        inner = min(light.spot_inner, light.spot_cutoff)
        cone: Lanes = dr.select(cosine >= cos(radians(light.spot_cutoff)), mi.Float(1.0), 0.0)
        if inner < light.spot_cutoff:
            angle = dr.acos(cosine * (1.0 - 1e-7)) * (180.0 / pi)
            falloff = (light.spot_cutoff - angle) / (light.spot_cutoff - inner)
            cone = dr.select(cosine >= cos(radians(inner)), cone, positive(falloff))
        return cone * dr.power(positive(cosine) + TINY, light.spot_exponent) if light.spot_exponent > 0.0 else cone

    def lit(self, light: Light, hit: Hit) -> tuple[Lanes, Lanes]:
        """Return E_direct of one light at surface points, with shadow and without."""
        E, w, distance = self.unoccluded(light, hit.p, hit.n, hit.g)
        seen = self.visible(hit.p, w, distance, hit.valid & lights(E))
        return dr.select(seen, E, 0.0), E

    # --- the two estimators ---------------------------------------------------------------------------------------------

    def irradiance(self, p: np.ndarray, n: np.ndarray, g: np.ndarray, side: int, seed: int, bounces: int = 1) -> np.ndarray:
        """Return (N, 3) E of `bounces` at `p` (N, 3) with shading and geometric normals `n`, `g`; side² paths each."""
        step = max(LANES // (side * side), 1)
        parts = [np.zeros((0, 3))]
        for k in range(0, len(p), step):
            some = [mi.Vector3f(x[k : k + step].T) for x in (p, n, g)]
            parts.append(self._irradiance(some[0], some[1], some[2], side, (seed, k * side * side), bounces))
        return np.concatenate(parts)

    def _irradiance(self, p: Lanes, n: Lanes, g: Lanes, side: int, seed: tuple[int, int], bounces: int) -> np.ndarray:
        """Return (N, 3) E at points (N,); seed: of a call of `irradiance`, and the number of the first path among its paths."""
        count = side * side
        lane = dr.arange(mi.UInt32, dr.width(p) * count)
        point = lane // count
        p, n, g = (dr.gather(mi.Vector3f, x, point) for x in (p, n, g))
        random = generator(*seed, lane)
        stratum = mi.Point2u((lane % count) % side, (lane % count) // side)

        def uniform() -> Lanes:  # a point in the unit square per lane, stratified at the first vertex
            u = mi.Point2f(random.next_float32(), random.next_float32())
            return u if vertex else (mi.Point2f(stratum) + u) / side

        path: Lanes = lane
        total: Lanes = dr.zeros(mi.Color3f, dr.width(lane))
        weight: Lanes = mi.Color3f(1.0)
        for vertex in range(bounces):
            seen, q = self._seen(mi.Point3f(p), n, g, uniform, random.next_float32)
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

    def _seen(self, p: Lanes, n: Lanes, g: Lanes, uniform: Lanes, single: Lanes) -> tuple[Lanes, Hit]:
        """Return E_1 at each p, estimated by one ray, one ray from each light and one emitter connection; and the rays' hits.

        uniform: draws points of the unit square; single: numbers.
        """
        direction = mi.Frame3f(n).to_world(cosine_hemisphere(uniform()))
        above = dr.dot(direction, g) > 0.0
        q = self.hit(p, direction, above)
        emission = q.emission
        whole = None if self.emitters is None else self.emitters.total(p, n)
        if self.emitters is not None:
            p_ray, p_emitter = density_of_ray(p, n, q.p, q.g), self.emitters.density(p, n, whole, q.face, q.valid)
            emission = emission * dr.select(p_emitter > 0.0, p_ray / (p_ray + p_emitter + TINY), 1.0)
        total = mi.Color3f(dr.select(q.valid, emission, dr.select(above, self.sky(direction), 0.0))) * pi
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
        if self.emitters is not None:
            total += self._from_emitter(p, n, g, whole, uniform(), single())
        return total, q

    def sky(self, direction: Lanes) -> Lanes:
        """Return the sky's radiance along unit directions; texels of a map, without its suns."""
        environment = self.scene.environment
        if environment is not None:
            assert self.sky_map is not None
            height, width = environment.light.shape[:2]
            east, up, south = (dr.dot(direction, mi.Vector3f(*axis)) for axis in environment.frame.tolist())
            level = dr.select(up > 1.0, 1.0, dr.select(up < -1.0, -1.0, up))
            column = mi.Int32(dr.floor((0.5 + polar_angle(east, -south) / (2.0 * pi)) * width))
            row = mi.Int32(dr.floor(dr.acos(level) / pi * height))
            column, row = dr.clip(column, 0, width - 1), dr.clip(row, 0, height - 1)
            return dr.gather(mi.Color3f, self.sky_map, mi.UInt32(row * width + column))
        radiance = mi.Color3f(*self.scene.sky)
        if any(self.scene.sky_gradient):
            radiance = radiance + mi.Color3f(*self.scene.sky_gradient) * dr.dot(direction, mi.Vector3f(*self.scene.up))
        return radiance

    def _from_emitter(self, p: Lanes, n: Lanes, g: Lanes, whole: Lanes, u: Lanes, jitter: Lanes) -> Lanes:
        """Return the contribution to E_1 of connections between emitting triangles and p.

        whole: sum of the clusters' weights at p. u: random point of the unit square, jitter: random number.
        """
        assert self.emitters is not None
        face, rest = self.emitters.draw(p, n, whole, u.x, jitter)
        corners = dr.gather(mi.Vector3u, self.faces, face)
        a, b, c = (dr.gather(mi.Point3f, self.positions, k) for k in (corners.x, corners.y, corners.z))
        root = dr.sqrt(rest)
        s, t = root * (1.0 - u.y), root * u.y
        y = a * (1.0 - s - t) + b * s + c * t
        toward = y - p
        r = dr.norm(toward)
        w = toward / (r + TINY)
        m = dr.normalize(dr.cross(b - a, c - a))
        cos_p, cos_y = dr.dot(n, w), dr.abs(dr.dot(m, w))
        active = (r > 0.0) & (cos_p > 0.0) & (dr.dot(g, w) > 0.0) & (cos_y > 0.0)
        if self.cutoff is not None:
            active &= ~self._lets_through(face, s, t, active)
        _, emission = self._colors(face, corners, s, t, active)
        active &= lights(emission)
        active &= self.visible(p, w, r, active)
        p_ray, p_emitter = density_of_ray(p, n, y, m), self.emitters.density(p, n, whole, face, active)
        geometry = cos_p * cos_y / dr.square(r)
        return dr.select(active & (p_emitter > 0.0), emission * (geometry / (p_ray + p_emitter)), 0.0)

    def _from_light(self, light: Light, p: Lanes, n: Lanes, g: Lanes, u: Lanes) -> Lanes:
        """Return the contribution to E_1 of connections between hits of rays from `light` and p."""
        edge = beam_edge(light)
        direction = uniform_cap(u, edge)
        if edge > -1.0:
            direction = mi.Frame3f(mi.Vector3f(axis(light))).to_world(direction)
        q = self.hit(mi.Point3f(*light.position), direction)
        back = p - q.p
        r = dr.norm(back)
        back /= r + TINY
        cos_p = dr.dot(n, -back)
        # only the lit side of q emits, so p must be on that side
        active = q.valid & (r > 0.0) & (cos_p > 0.0) & (dr.dot(g, -back) > 0.0) & (dr.dot(q.g, back) > 0.0)
        E, _, _ = self.unoccluded(light, q.p, q.n, q.g)
        active &= self.visible(p, -back, r, active & lights(E))
        p_ray, p_light = self._densities(light, p, n, q.p, q.g)
        L = q.albedo * E / pi
        geometry = cos_p * dr.dot(q.g, back) / dr.square(r)
        return dr.select(active & (p_ray + p_light > 0.0), L * geometry / (p_ray + p_light), 0.0)

    @staticmethod
    def _densities(light: Light, p: Lanes, n: Lanes, q: Lanes, g: Lanes) -> tuple[Lanes, Lanes]:
        """Return the densities per area at q of a cosine-distributed ray from p, and of a ray from the light."""
        to_light = mi.Point3f(*light.position) - q
        d = dr.norm(to_light)
        edge = beam_edge(light)
        density = 1.0 / (2.0 * pi * (1.0 - edge))
        inside = mi.Bool(True)
        if edge > -1.0:
            inside = dr.dot(mi.Vector3f(axis(light)), -to_light) >= edge * d
        p_light = dr.select(inside & (dr.dot(g, to_light) > 0.0), density * dr.dot(g, to_light) / (d * d * d), 0.0)
        return density_of_ray(p, n, q, g), dr.select(d > 0.0, p_light, 0.0)


def _world(positions: np.ndarray, faces: np.ndarray) -> Any:
    """Return triangles for Mitsuba; a degenerate one for an empty scene."""
    faces = faces if len(faces) else np.zeros((1, 3))
    mesh = mi.Mesh("scene", vertex_count=len(positions), face_count=len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = positions.ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return mi.load_dict({"type": "scene", "mesh": mesh})


def view(tracer: Tracer, camera: Camera, size: tuple[int, int], dx: float = 0.5, dy: float = 0.5) -> Visible:
    """Return the surfaces at one point of every pixel, see camera_rays; one ray per pixel, row by row."""
    directions, eye = camera_rays(camera, size, dx, dy), np.asarray(camera.eye, float)
    # rays start where they enter the scene's sphere: from a distant eye, float32 would miss by pixels
    entry = directions @ (tracer.scene.bounds.mean(axis=0) - eye) - 0.51 * tracer.scene.diagonal

    def nearest(pixel: np.ndarray, beyond: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        start = np.maximum(np.maximum(beyond, tracer.epsilon), entry[pixel])
        d = directions[pixel]
        ray = mi.Ray3f(mi.Point3f((eye + start[:, None] * d).T), mi.Vector3f(d.T))
        found = tracer.camera_world.ray_intersect_preliminary(ray, coherent=False)
        valid = np.array(found.is_valid())
        face, u, v, t = (np.array(x) for x in (found.prim_index, found.prim_uv.x, found.prim_uv.y, found.t))
        return valid, face.astype(np.int64), u.astype(float), v.astype(float), start + np.where(valid, t, 0.0)

    return seen(tracer.surfaces, directions, nearest, tracer.epsilon)


def surface(found: Visible, camera: Camera) -> Hit:
    """Return the surfaces along a camera's rays, in lanes."""
    toward = found.position - np.asarray(camera.eye)
    away = ((found.normal * toward).sum(1) >= 0.0) | ((found.smooth * toward).sum(1) >= 0.0)
    return Hit(
        valid=mi.Bool(found.seen),
        p=mi.Point3f(found.position.T),
        n=mi.Vector3f(found.normal.T),
        g=mi.Vector3f(found.geometric.T),
        albedo=mi.Color3f(found.albedo.T),
        emission=mi.Color3f(found.emission.T),
        face=dr.zeros(mi.UInt32, len(away)),
        ambiguous=mi.Bool(away),
    )


def image(values: Lanes, size: tuple[int, int]) -> np.ndarray:
    """Return an (H, W, …) array of W·H lanes."""
    array, (width, height) = np.array(values), size
    return array.T.reshape(height, width, -1) if array.ndim == 2 else array.reshape(height, width)


def survival(weight: Lanes) -> Lanes:
    """Return the survival probability of a path of this weight: 1 while its brightest channel exceeds LEAST_WEIGHT."""
    most = dr.select(weight.x > weight.y, weight.x, weight.y)
    most = dr.select(most > weight.z, most, weight.z) / LEAST_WEIGHT
    return dr.select(most < 1.0, most, 1.0)


def has_cone(light: Light) -> bool:
    """True for a spot; half angles of 90 and 180 degrees mean no cone, as in the scene format."""
    return not light.directional and light.has_cone and light.spot_cutoff not in (90.0, 180.0)


def beam_edge(light: Light) -> float:
    """Return the least cosine to its axis at which a positional light emits; -1: all around."""
    if light.photometry is not None:
        return cos(radians(max(light.photometry.reach, 1.0)))  # 1: a light without emission gets rays as well
    return cos(radians(light.spot_cutoff)) if has_cone(light) else -1.0


def axis(light: Light) -> list[float]:
    """Return the unit axis of a spot or luminaire, pointing away from the light."""
    if light.photometry is not None:
        return [float(x) for x in -light.frame[2]]
    toward = np.subtract(light.spot_target or (0.0, 0.0, 0.0), light.position)
    return [float(x) for x in toward / np.linalg.norm(toward)]
