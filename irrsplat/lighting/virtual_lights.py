"""Virtual lights: points that lamps light, from which records take what is reflected there (Keller 1997, "Instant radiosity").

A lamp close to a wall lights a spot that few of a record's rays hit. Rays from the lamp find that spot for certain, densest where
it is brightest. A record takes what comes from there along shadow rays, and what its own rays find of it counts the less, by the
balance heuristic: together they are all of the light.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from irrsplat.core.buffers import ShadowMaps, Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.glsl import WORTH
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, table_texture
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines, near_plane
from irrsplat.scene.model import Light

_LIT = 1e29  # metres: what is farther is nothing that a ray has hit
_ENDS = 4096  # virtual lights in all sets, about: with one set for all records its error would be theirs
_SETS = 8, 64  # the least and the most sets
_WORTHWHILE = 0.05  # of a lamp's rays: so many have to end at virtual lights


class VirtualLights(Owner):
    """Those of the world's lamps as they are now, in sets of at most `samples`, for records with so many `rays` a steradian.

    count: of a set. reach: (LIGHTS, 4), the uniform `virtual_lights` of shaders/lighting/virtual_lights/hit.glsl. They depend on
    where lamps and meshes are, not on how bright those are.
    """

    def __init__(self, world: World, samples: int, rays: float) -> None:
        self.world = world
        kinds = light_defines(world.scene), world.material_defines
        self._passes = world.derived.get("virtual light passes", kinds, lambda: VirtualLightPasses(world))
        spots = self._spots(
            np.array([i for i, light in enumerate(world.scene.lights) if not light.directional], int), samples, rays
        )
        while not spots.worthwhile.all():  # the others share what there is
            spots = self._spots(spots.lamps[spots.worthwhile], samples, rays)
        columns = spots.columns
        self.count, sets = columns.shape[:2]
        self._places = table_texture(world.ctx, columns.reshape(self.count, -1, 4).swapaxes(0, 1)) if self.count else None
        self._radiance = Target(world.ctx, (max(self.count, 1), sets), (4,))
        self._lit: ShadowMaps | None = None  # the lamps by which they shine
        self.reach = np.zeros((max(len(world.scene.lights), 1), 4))
        self.reach[spots.lamps, 0], self.reach[spots.lamps, 1] = spots.density, spots.reach**2

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self._places, self._radiance)

    def sample_uniforms(self, shadows: ShadowMaps) -> Uniforms:
        """The uniforms of shaders/gather/light_samples/sample.glsl, by these lamps."""
        assert self._places is not None
        if self._lit is not shadows:
            self._passes.shine(self._radiance, {**self.world.hit_uniforms, **shadows.uniforms, "places": self._places})
            self._lit = shadows
        return {"virtual_places": self._places, "virtual_radiance": self._radiance.textures[0]}

    def _spots(self, lamps: np.ndarray, samples: int, rays: float) -> _Spots:
        """Where rays of the `lamps` of these numbers end, of whose virtual lights there are to be so many `samples`."""
        scene, each = self.world.scene, max(samples // max(len(lamps), 1), 1)
        if not len(lamps):
            none = np.zeros(0)
            return _Spots(lamps, none, none, np.zeros((0, 1, 1, 3, 4)), np.zeros((0, 1, 1), bool))
        rows = np.array([_row(scene.lights[lamp]) for lamp in lamps])
        density = each / (2.0 * np.pi * rows[:, 1, 3])
        uniforms = {**self.world.trace_uniforms, "rays": float(each), "near": near_plane(scene)}
        sets = int(np.clip(_ENDS // samples, *_SETS))
        place, normal, share = self._passes.find(rows, each, sets, uniforms)
        far, triangle = place[..., 3].copy(), normal[..., 3].copy()
        lit = far < _LIT
        # a room is about as wide as a lamp's rays are long: within reach they lie as densely as those of records across it
        room = np.sqrt((np.where(lit, far, 0.0) ** 2).sum((1, 2)) / np.maximum(lit.sum((1, 2)), 1))
        reach = 2.0 * room * np.sqrt(WORTH * density / rays)
        cosine = -((place[..., :3] - rows[:, None, None, 0, :3]) * normal[..., :3]).sum(-1) / far
        place[..., 3] = density[:, None, None] * cosine / far**2
        normal[..., 3], share[..., 3] = lamps[:, None, None], triangle
        near = lit & (far < reach[:, None, None]) & (place[..., 3] > 0.0)
        return _Spots(lamps, density, reach, np.stack([place, normal, share], axis=3), near)


def virtual_lights(world: World, samples: int, rays: float) -> VirtualLights | None:
    """Those of the world's lamps, which the world owns; None where they have none, and for more triangles than rays can go
    through. They hold until lamps or meshes move."""
    lamps = [replace(light, color=(1.0, 1.0, 1.0)) for light in world.scene.lights]
    inputs = world.scene.meshes, lamps
    try:
        found = world.derived.get(f"virtual lights {samples} {rays}", inputs, lambda: VirtualLights(world, samples, rays))
    except InputError:
        return None
    return found if found.count else None


@dataclass(frozen=True)
class _Spots:
    """The ends of rays from K point lights, in sets of R a light.

    lamps: (K,) the numbers of the lights. density: (K,) rays of a set to a steradian. reach: (K,) metres from the light within
    which the end of a ray is a virtual light. near: (K, SETS, R) whether it is. texels: (K, SETS, R, 3, 4), of each the two that
    `virtual_places` in shaders/gather/light_samples/sample.glsl has, and the shares of its triangle's corners, with the
    triangle's number.
    """

    lamps: np.ndarray
    density: np.ndarray
    reach: np.ndarray
    texels: np.ndarray
    near: np.ndarray

    @property
    def worthwhile(self) -> np.ndarray:
        """(K,) whether enough of a lamp's rays end at virtual lights."""
        some: np.ndarray = self.near.mean((1, 2)) > _WORTHWHILE
        return some

    @property
    def columns(self) -> np.ndarray:
        """(M, SETS, 3, 4) the texels of virtual lights alone, those of a set one after another, and then such as nobody sees,
        since they have no normal."""
        sets, most = self.near.shape[1], int(self.near.sum((0, 2)).max(initial=0))
        found = np.zeros((most, sets, 3, 4))
        found[:, :, 0, 3] = 1.0
        for number in range(sets):
            chosen = self.texels[:, number][self.near[:, number]]
            found[: len(chosen), number] = chosen
        return found


class VirtualLightPasses(Owner):
    """What finds virtual lights, and makes them shine; for the kinds of lamps and materials that the world has now."""

    def __init__(self, world: World) -> None:
        self.ctx, materials = world.ctx, world.material_defines
        self._find = Program(world.ctx, "lighting/virtual_lights/find", "lib/fullscreen", materials)
        kinds = {**light_defines(world.scene), **materials}
        self._shine = Program(world.ctx, "lighting/virtual_lights/shine", "lib/fullscreen", kinds)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self._find, self._shine)

    def find(self, rows: np.ndarray, rays: int, sets: int, uniforms: Uniforms) -> tuple[np.ndarray, ...]:
        """Return three of (K, sets, rays, 4) float64, the outputs of shaders/lighting/virtual_lights/find.frag by K lights with
        these `rows` (K, 2, 4)."""
        with Target(self.ctx, (rays, sets * len(rows)), (4, 4, 4)) as ends, ExitStack() as made:
            lamps = table_texture(self.ctx, rows)
            made.callback(lamps.release)
            self._find(ends, **self._find.known({**uniforms, "lamps": lamps, "sets": sets}))
            return tuple(ends.read(i)[::-1].astype(float).reshape(len(rows), sets, rays, 4) for i in range(3))

    def shine(self, target: Target, uniforms: Uniforms) -> None:
        """Let them send out what the lamps bring to them."""
        self._shine(target, **self._shine.known(uniforms))


def _row(light: Light) -> list[list[float]]:
    """Its texels of `lamps` in shaders/lighting/virtual_lights/find.frag."""
    if light.spot_target is None or not light.has_cone:
        return [[*light.position, 0.0], [0.0, 1.0, 0.0, 2.0]]
    axis = np.subtract(light.spot_target, light.position)
    return [
        [*light.position, 0.0],
        [*(axis / np.linalg.norm(axis)), 2.0 * float(np.sin(np.radians(0.5 * light.spot_cutoff)) ** 2)],
    ]
