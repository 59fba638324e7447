"""Virtual point lights: points on lit surfaces that emit the light reflected there (Keller 1997, "Instant radiosity").

A light close to a wall makes a bright spot that few of a record's rays hit; the sun through an opening makes a patch. Rays from
the light find the spot for certain, densest where it is brightest. Records sample it by shadow rays (next-event estimation); the
balance heuristic (Veach and Guibas 1995) weights these against their own rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.buffers import ShadowMaps, Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.glsl import WORTH
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, table_texture, uneven
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import across, light_defines, near_plane, parallel_frame
from irrsplat.scene.model import Light, Scene

_LIT = 1e29  # metres: greater distances stand for a miss
_ENDS = 4096  # virtual point lights in all sets, about: a single set would give all records the same error
_SETS = 8, 64  # the least and the greatest number of sets
_FIRST = 64  # sets of as many rays for the search of a directional light's window
_FURTHER = 8  # rays from the end of each: a place is inside if all of them hit something
_SEARCHES = 3  # each in the window of the previous one
_APART = 4.0  # margin of a window in distances of these rays: further rays find only a part of the inside
_EDGE = 2e-3  # of the scene's width: additional margin of a window, for the error of shadow maps
_WORTHWHILE = 0.05  # least share of a light's rays that end at virtual point lights


class VirtualLights(Owner):
    """Virtual point lights of the present world, in sets of at most `samples`, for records with `rays` a steradian.

    count: of a set. reach, windows: (LIGHTS, 4), the uniforms `virtual_lights` and `virtual_windows` of
    shaders/lighting/virtual_lights/hit.glsl. They depend on the places of lights and meshes, not on brightness.
    """

    def __init__(self, world: World, samples: int, rays: float) -> None:
        self.world = world
        # independent of the number of samples
        self._windows = world.derived.get("light windows", _inputs(world), lambda: LightWindows(world))
        spots = self._spots(np.flatnonzero(self._windows.rooms), samples, rays)
        while not spots.worthwhile.all():  # the remaining lights share the samples
            spots = self._spots(spots.lights[spots.worthwhile], samples, rays)
        columns = spots.columns
        self.count, sets = columns.shape[:2]
        rows = columns.reshape(self.count, sets * columns.shape[2], 4).swapaxes(0, 1)
        self._places = self.own(table_texture(world.ctx, rows, varying=True)) if self.count else None
        self._radiance = self.own(Target(world.ctx, (uneven(max(self.count, 1)), sets), (4,)))
        self._lit: ShadowMaps | None = None  # lights that `_radiance` was computed for
        self.reach = np.zeros((max(len(world.scene.lights), 1), 4))
        self.reach[spots.lights, 0], self.reach[spots.lights, 1] = spots.density, spots.reach**2
        self.windows = np.zeros_like(self.reach)
        self.windows[spots.lights] = self._windows.rectangles[spots.lights]

    def sample_uniforms(self, shadows: ShadowMaps) -> Uniforms:
        """Return the uniforms of shaders/gather/light_samples/sample.glsl for these lights."""
        assert self._places is not None
        if self._lit is not shadows:
            # the present passes: this result can be current again after other lights, which had passes of their own
            _passes(self.world).emit(self._radiance, {**self.world.hit_uniforms, **shadows.uniforms, "places": self._places})
            self._lit = shadows
        return {"virtual_places": self._places, "virtual_radiance": self._radiance.textures[0]}

    def _spots(self, lights: np.ndarray, samples: int, rays: float) -> _Spots:
        """Return the ends of rays from the lights of these numbers, which share `samples` virtual point lights."""
        scene, each = self.world.scene, max(samples // max(len(lights), 1), 1)
        if not len(lights):
            none = np.zeros(0)
            return _Spots(lights, none, none, np.zeros((0, 1, 1, 3, 4)), np.zeros((0, 1, 1), bool))
        rows = np.array([_row(scene.lights[i], scene, self._windows.rectangles[i]) for i in lights])
        parallel, sides = rows[:, 0, 3] > 0.5, 2.0 * self._windows.rectangles[lights, 2:]
        density = each / np.where(parallel, sides.prod(1), 2.0 * np.pi * rows[:, 1, 3])
        sets = int(np.clip(_ENDS // max(samples, len(lights)), *_SETS))
        place, normal, share = _passes(self.world).find(rows, each, sets, _find_uniforms(self.world, each))
        far, triangle, spread = place[..., 3].copy(), normal[..., 3].copy(), share[..., 3].copy()
        lit = spread > 0.0
        # a room is about as wide as a light's rays are long: within reach they are as dense as the rays of records across it
        room = np.sqrt((np.where(lit, far, 0.0) ** 2).sum((1, 2)) / np.maximum(lit.sum((1, 2)), 1))
        room = np.where(parallel, self._windows.rooms[lights], room)
        reach = 2.0 * room * np.sqrt(WORTH * density / rays)
        place[..., 3] = density[:, None, None] * spread
        normal[..., 3], share[..., 3] = lights[:, None, None], triangle
        # metres for a point light; a directional light's window is within reach as a whole or not at all
        near = lit & (np.where(parallel[:, None, None], 1.0, far) < reach[:, None, None])
        return _Spots(lights, density, reach, np.stack([place, normal, share], axis=3), near)


def virtual_lights(world: World, samples: int, rays: float) -> VirtualLights | None:
    """Return the virtual point lights of the world, cached by the world until lights or meshes move.

    None if there are none, or for more triangles than rays can traverse.
    """
    try:
        found = world.derived.get(f"virtual lights {samples} {rays}", _inputs(world), lambda: VirtualLights(world, samples, rays))
    except InputError:
        return None
    return found if found.count else None


class LightWindows(Owner):
    """The windows of the world's directional lights: rectangles across the light, through which rays find its virtual lights.

    Light through a window lights all places inside, which are lit places from which all further rays meet something. Where no
    place is inside, light through the window lights all lit places.
    rectangles: (LIGHTS, 4) middle and half the sides, metres in the light's `parallel_frame`; other lights have 0.
    rooms: (LIGHTS,) about how many metres surfaces are from the lit places; 0: nothing is lit. Other lights have 1.
    """

    def __init__(self, world: World) -> None:
        self.rectangles, self.rooms = np.zeros((len(world.scene.lights), 4)), np.ones(len(world.scene.lights))
        for i, light in enumerate(world.scene.lights):
            if light.directional:
                # an opening of a house is small on its ground
                for box in (world.scene.shaded_bounds, world.scene.bounds):
                    self.rectangles[i], self.rooms[i], inside = self._search(world, light, box)
                    if inside or box is world.scene.bounds:
                        break

    def _search(self, world: World, light: Light, box: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Return the light's rectangle (4,) and room, and True for light through a window, where it meets `box` (2, 3)."""
        scene, passes = world.scene, _passes(world)
        frame, _ = parallel_frame(light, scene)
        uniforms, (low, high), room, through = _find_uniforms(world, _FIRST, _FURTHER), across(frame, box), 0.0, False
        edge = 0.5 * _EDGE * (high - low)
        for _ in range(_SEARCHES):
            rows = np.array([_row(light, scene, _rectangle(low, high))])
            place, _, share = (ends.reshape(-1, 4) for ends in passes.find(rows, _FIRST, _FIRST, uniforms))
            lit = share[:, 3] > 0.0
            inside = lit & (place[:, 3] < _LIT)
            chosen = inside if inside.any() else lit & (room == 0.0)
            if not chosen.any():
                break
            found = place[chosen, :3] @ frame[:2, :3].T + frame[:2, 3]
            through = bool(inside.any())
            apart = (_APART if through else 1.0) * np.sqrt((high - low).prod()) / _FIRST + edge
            low, high = np.maximum(found.min(0) - apart, low - edge), np.minimum(found.max(0) + apart, high + edge)
            room = float(np.sqrt((place[inside, 3] ** 2).mean()) if through else 0.5 * np.linalg.norm(high - low))
        return _rectangle(low, high), room, through


def _rectangle(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return (4,) the middle and half the sides of a rectangle between these corners (2,)."""
    return np.concatenate([0.5 * (low + high), 0.5 * (high - low)])


@dataclass(frozen=True)
class _Spots:
    """The ends of rays from K lights, in sets of R a light.

    lights: (K,) indices of the lights. density: (K,) rays of a set to a steradian. reach: (K,) metres from the light within
    which the end of a ray is a virtual point light. near: (K, SETS, R) True for these ends. texels: (K, SETS, R, 3, 4), the two
    of `virtual_places` in shaders/gather/light_samples/sample.glsl, then the barycentric coordinates and the triangle's number.
    """

    lights: np.ndarray
    density: np.ndarray
    reach: np.ndarray
    texels: np.ndarray
    near: np.ndarray

    @property
    def worthwhile(self) -> np.ndarray:
        """(K,) True if enough of a light's rays end at virtual point lights."""
        return np.asarray(self.near.mean((1, 2)) > _WORTHWHILE)

    @property
    def columns(self) -> np.ndarray:
        """(M, SETS, 3, 4) the texels of virtual point lights, set by set; entries without a normal fill short sets."""
        sets, most = self.near.shape[1], int(self.near.sum((0, 2)).max(initial=0))
        found = np.zeros((most, sets, 3, 4))
        found[:, :, 0, 3] = 1.0
        for number in range(sets):
            chosen = self.texels[:, number][self.near[:, number]]
            found[: len(chosen), number] = chosen
        return found


class VirtualLightPasses(Owner):
    """Passes that find virtual point lights and compute their radiance, for the world's present kinds of lights and materials."""

    def __init__(self, world: World) -> None:
        self.ctx, materials = world.ctx, world.material_defines
        self._find = self.own(Program(world.ctx, "lighting/virtual_lights/find", "lib/fullscreen", materials))
        kinds = {**light_defines(world.scene), **materials}
        self._emit = self.own(Program(world.ctx, "lighting/virtual_lights/emit", "lib/fullscreen", kinds))

    def find(self, rows: np.ndarray, rays: int, sets: int, uniforms: Uniforms) -> tuple[np.ndarray, ...]:
        """Return three of (K, sets, rays, 4) float64, the outputs of shaders/lighting/virtual_lights/find.frag by K lights with
        these `rows` (K, 3, 4)."""
        with Target(self.ctx, (rays, sets * len(rows)), (4, 4, 4)) as ends:
            table = ends.own(table_texture(self.ctx, rows))
            self._find(ends, **self._find.declared({**uniforms, "lights": table, "sets": sets}))
            return tuple(ends.read(i)[::-1].astype(float).reshape(len(rows), sets, rays, 4) for i in range(3))

    def emit(self, target: Target, uniforms: Uniforms) -> None:
        """Write the radiance that the virtual point lights reflect."""
        self._emit(target, **self._emit.declared(uniforms))


def _passes(world: World) -> VirtualLightPasses:
    """Return the passes for the kinds of lights and materials that the world has now."""
    kinds = light_defines(world.scene), world.material_defines
    return world.derived.get("virtual light passes", kinds, lambda: VirtualLightPasses(world))


def _inputs(world: World) -> object:
    """Return the inputs of virtual point lights: meshes, and lights except their colours."""
    placed = [tuple(value for name, value in vars(light).items() if name != "color") for light in world.scene.lights]
    return world.scene.meshes, placed


def _find_uniforms(world: World, rays: int, further: int = 0) -> Uniforms:
    """Return the uniforms of shaders/lighting/virtual_lights/find.frag for so many rays a set."""
    return {**world.trace_uniforms, "rays": float(rays), "further": further, "near": near_plane(world.scene)}


def _row(light: Light, scene: Scene, window: np.ndarray) -> list[list[float]]:
    """Return the texels of a light in shaders/lighting/virtual_lights/find.frag; window: of a directional light."""
    if light.directional:
        frame, radius = parallel_frame(light, scene)
        (right, up, _), (middle, half) = frame[:, :3], window.reshape(2, 2)
        corner = ([*(middle - half), -radius] - frame[:, 3]) @ frame[:, :3]
        return [[*corner, 1.0], [*(2.0 * half[0] * right), 0.0], [*(2.0 * half[1] * up), 0.0]]
    if light.spot_target is None or not light.has_cone:
        return [[*light.position, 0.0], [0.0, 1.0, 0.0, 2.0], [0.0] * 4]
    axis = np.subtract(light.spot_target, light.position)
    return [
        [*light.position, 0.0],
        [*(axis / np.linalg.norm(axis)), 2.0 * float(np.sin(np.radians(0.5 * light.spot_cutoff)) ** 2)],
        [0.0] * 4,
    ]
