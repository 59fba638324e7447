"""Small scenes of known shape, their pinhole views, Lambert's formula, and pictures of failures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from PIL import Image

from irrsplat.core.buffers import GBuffer, HitLight, Records, Sites
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.core.record_layout import COLUMNS, TEXTURES, pack
from irrsplat.gather.hemisphere import Gather, gather_records
from irrsplat.gather.kinds import gather_pass
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu import context
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import float_texture, table_texture
from irrsplat.gpu.world import World
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene
from irrsplat.settings import Settings

FAILURES = Path(__file__).resolve().parents[1] / "failures"
Vector = Iterable[float]
ABOVE = Camera((0.0, 4.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 45.0)  # straight down at the origin


@cache
def shared() -> moderngl.Context:
    """Return the context that tests share until the process ends."""
    return context.create()


def material(albedo: float | tuple[float, float, float] = 0.5, emission: float | tuple[float, float, float] = 0.0) -> Material:
    """Return a Material of grey or coloured reflectance and emission."""
    grey = [(v, v, v) if isinstance(v, (int, float)) else v for v in (albedo, emission)]
    return Material(albedo=grey[0], emission=grey[1])


def quad(corner: Vector, u: Vector, v: Vector, paint: Material | None = None) -> Mesh:
    """Return a parallelogram of two triangles with the normal u × v."""
    c, u, v = (np.asarray(x, float) for x in (corner, u, v))
    n = np.cross(u, v)
    positions = np.array([c, c + u, c + u + v, c + v], "f4")
    normals = np.tile(n / np.linalg.norm(n), (4, 1)).astype("f4")
    return Mesh(positions, normals, np.array([[0, 1, 2], [0, 2, 3]], "i4"), paint or Material())


def floor(half: float = 2.0, height: float = 0.0, paint: Material | None = None) -> Mesh:
    """Return a horizontal square around the y axis that faces up."""
    return quad((-half, height, half), (2 * half, 0, 0), (0, 0, -2 * half), paint)


def box(low: Vector, high: Vector, paint: Material | None = None, outward: bool = True) -> Mesh:
    """Return an axis-aligned box of 12 triangles, closed if it is wound outward."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    parts = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3] = (high - low)[(axis + 1) % 3]
        v[(axis + 2) % 3] = (high - low)[(axis + 2) % 3]
        top = low.copy()
        top[axis] = high[axis]
        parts += [quad(low, v, u), quad(top, u, v)] if outward else [quad(low, u, v), quad(top, v, u)]
    faces = np.concatenate([p.faces + 4 * i for i, p in enumerate(parts)])
    return Mesh(
        np.concatenate([p.positions for p in parts]),
        np.concatenate([p.normals for p in parts]),
        faces,
        paint or Material(),
        closed=outward,
    )


def sphere(centre: Vector, radius: float, paint: Material | None = None, rings: int = 24, segments: int = 48) -> Mesh:
    """Return a closed sphere with smooth normals."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings + 1), 2 * np.pi * np.arange(segments) / segments, indexing="ij")
    unit = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    unit[0], unit[-1] = (0, 1, 0), (0, -1, 0)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(rings), np.arange(segments), indexing="ij"))
    k = (j + 1) % segments
    a, b, c, d = i * segments + j, i * segments + k, (i + 1) * segments + k, (i + 1) * segments + j
    upper, lower = np.stack([a, b, c], 1)[i > 0], np.stack([a, c, d], 1)[i < rings - 1]
    points = unit.reshape(-1, 3)
    return Mesh(
        (np.asarray(centre) + radius * points).astype("f4"),
        points.astype("f4"),
        np.concatenate([upper, lower]).astype("i4"),
        paint or Material(),
        closed=True,
    )


def scene(
    *meshes: Mesh, lights: tuple[Light, ...] = (), sky: float | tuple[float, float, float] = 0.0, camera: Camera = ABOVE
) -> Scene:
    """Return a Scene of these parts; sky grey or coloured."""
    return Scene(meshes, lights, (camera,), (sky, sky, sky) if isinstance(sky, (int, float)) else sky)


def point_light(position: Vector, power: float = 1.0, **rest: Any) -> Light:
    """Return a physical point light, `power` in W/sr for each channel."""
    return Light(tuple(position), (power, power, power), physical=True, **rest)  # type: ignore[arg-type]


# ---- pinhole views ----------------------------------------------------------------------------------------------------


def rays(camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Return float64 directions (H, W, 3) through pixel centres, top row first, of length 1 along the view axis."""
    width, height = size
    t = np.tan(np.radians(camera.fov) / 2.0)
    x = (2.0 * (np.arange(width) + 0.5) / width - 1.0) * t * width / height
    y = (1.0 - 2.0 * (np.arange(height) + 0.5) / height) * t
    right, up, backward = camera.axes
    return x[None, :, None] * right + y[:, None, None] * up - backward


def on_plane(camera: Camera, size: tuple[int, int], point: Vector, normal: Vector) -> tuple[np.ndarray, np.ndarray]:
    """Return each pixel ray's hit on a plane (H, W, 3), and its depth along the view axis (negative: behind the eye)."""
    d, n, eye = rays(camera, size), np.asarray(normal, float), np.asarray(camera.eye, float)
    with np.errstate(divide="ignore"):
        t = ((np.asarray(point, float) - eye) @ n) / (d @ n)
    return eye + t[..., None] * d, t


def gbuffer_of(ctx: moderngl.Context, position: np.ndarray, normal: np.ndarray, depth: np.ndarray, **rest: np.ndarray) -> GBuffer:
    """Return a GBuffer of (H, W, 3) arrays, top row first; the geometric normal defaults to the shading normal.

    depth: (H, W), 0 for the background. rest: `geometric`, and material properties; default albedo 0.5, others 0.
    """
    octahedral = encode(rest.get("geometric", normal))

    def texture(rgb: np.ndarray, w: np.ndarray) -> moderngl.Texture:
        return table_texture(ctx, np.concatenate([rgb, w[..., None]], -1)[::-1])

    return GBuffer(
        texture(position, depth),
        texture(normal, octahedral[..., 0]),
        texture(rest.get("albedo", np.full_like(position, 0.5)), octahedral[..., 1]),
        texture(rest.get("emission", 0.0 * position), np.ones_like(depth)),
    )


def encode(v: np.ndarray) -> np.ndarray:
    """Return the octahedral map (Meyer et al. 2010), (..., 3) to (..., 2)."""
    v = v / np.abs(v).sum(-1, keepdims=True)
    folded = (1.0 - np.abs(v[..., 1::-1])) * np.where(v[..., :2] >= 0.0, 1.0, -1.0)
    return np.where(v[..., 2:] >= 0.0, v[..., :2], folded)


# ---- records ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Gathered:
    """N records.

    E (N, 3), R (N,), M and ∇E (N, 3 channels, 3). axis (N, 3): direction of least bend. bend (N, 2): along and across it.
    farthest (N,): greatest radius. noise (N,): relative standard error of E.
    """

    E: np.ndarray
    R: np.ndarray
    M: np.ndarray
    gradient: np.ndarray
    axis: np.ndarray
    bend: np.ndarray
    farthest: np.ndarray
    noise: np.ndarray


def gathered(cache: RecordCache) -> Gathered:
    """Return a cache's values, read from the GPU."""
    names = ("irradiance", "radius", "vectors", "gradient", "axis", "curvature", "max_radius", "noise")
    return Gathered(*cache.records.read(*names).values())


def error_scale(Y: np.ndarray, dark: float) -> np.ndarray:
    """Return the scale of relative errors (docs/METHOD.md, 5.3): at least `dark`; above 32 times that, a geometric mean."""
    bright = 32.0 * dark if dark > 0.0 else np.inf
    return np.maximum(np.where(bright < Y, np.sqrt(np.minimum(bright, 1e30) * np.maximum(Y, 0.0)), Y), dark)


def records_of(ctx: moderngl.Context, luminance_floor: float = 0.0, **columns: np.ndarray) -> Records:
    """Return records with these columns (N, …) of record_layout.COLUMNS; texels after the last one are arbitrary."""
    count = len(columns["position"])
    size = TABLE_COLUMNS, -(-count // TABLE_COLUMNS)
    textures = {name: float_texture(ctx, size, channels) for name, channels in TEXTURES.items()}
    for name, texture in textures.items():
        texture.write(np.full(size[0] * size[1] * TEXTURES[name], 1e6, "f4").tobytes())
    records = Records(textures, count, luminance_floor)
    write_columns(records, 0, **columns)
    return records


def write_columns(records: Records, first: int, **columns: np.ndarray) -> None:
    """Write columns (N, …) by name directly into the records' textures, from number `first` on."""
    for name, values in columns.items():
        texels = {
            texture: np.frombuffer(records.textures[texture].read(), "f4").reshape(-1, TEXTURES[texture]).copy()
            for texture, _ in COLUMNS[name].slots
        }
        pack({texture: rows[first : first + len(values)] for texture, rows in texels.items()}, name, values)
        for texture, rows in texels.items():
            records.textures[texture].write(rows.tobytes())


def sites(position: Any, normal: Any, geometric: Any = None) -> Sites:
    """Return sites of (N, 3) or (3,) arrays, with normalized normals."""
    p, n = (np.atleast_2d(np.asarray(x, float)) for x in (position, normal))
    n = np.broadcast_to(n / np.linalg.norm(n, axis=1, keepdims=True), p.shape)
    g = n if geometric is None else np.broadcast_to(geometric, p.shape)
    return Sites(p.astype("f4"), n.astype("f4"), np.asarray(g, "f4"))


class Lit(Owner):
    """Scene on the GPU with its shadow maps, ready for any gather."""

    def __init__(self, ctx: moderngl.Context, scene: Scene, shadow: int = 256) -> None:
        self.ctx, self.scene = ctx, scene
        self.world, self.shadow = self.own(World(ctx, scene)), self.own(ShadowPass(ctx))
        self.geometry = self.world.geometry
        self.light = HitLight(self.shadow(self.world, shadow))

    def look(self, side: int, kind: str, capacity: int | None = None) -> Gather:
        """Return a gather of `kind` without next-event estimation; the caller owns it."""
        settings = Settings(bounces=1, gather=kind, gather_size=side, light_samples=0)
        return gather_pass(self.world, settings, capacity)

    def gather(self, where: Sites, side: int, kind: str = "trace", capacity: int = 64, seed: int = 0) -> Gathered:
        """Return records at `where`, `capacity` of them per call."""
        with self.look(side, kind, capacity) as look, ReducePass(self.ctx, True) as reduce, RecordCache(self.ctx) as cache:
            gather_records(look, reduce, self.light, cache, cache.append(where) + np.arange(len(where)), seed)
            return gathered(cache)


def gather(
    ctx: moderngl.Context,
    world: Scene,
    where: Sites,
    side: int = 32,
    kind: str = "trace",
    capacity: int | None = None,
    shadow: int = 256,
) -> Gathered:
    """Return gathered and reduced records at `where`, `capacity` of them per call (default: all)."""
    with Lit(ctx, world, shadow) as lit:
        return lit.gather(where, side, kind, capacity or len(where))


# ---- Lambert's formula ------------------------------------------------------------------------------------------------


def polygon_vector(corners: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return ∫ ω dω (..., 3) over the solid angle of a polygon (C, 3) or (..., C, 3) from points p (..., 3), towards it.

    Lambert 1760: half the sum of the edges' angles times their planes' normals. Its product with n is the irradiance from
    unit radiance, if the whole polygon lies above the horizon.
    """
    v = corners - p[..., None, :]
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    w = np.roll(v, -1, axis=-2)
    across = np.cross(v, w)
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (v * w).sum(-1, keepdims=True))
    vector = 0.5 * (angle * across / np.maximum(sine, 1e-300)).sum(-2)
    return vector * np.sign((vector * v.mean(-2)).sum(-1, keepdims=True))


# ---- pictures ---------------------------------------------------------------------------------------------------------


def assert_pictures(name: str, picture: np.ndarray, reference: np.ndarray, limit: Any, where: Any = True) -> None:
    """Fail for |picture - reference| > limit at pixels of `where`, and write picture, reference and difference."""
    picture, reference = np.asarray(picture, float), np.broadcast_to(reference, np.shape(picture)).astype(float)
    wrong = ~(np.abs(picture - reference) <= limit)  # NaN counts as wrong
    counted = np.broadcast_to(where, picture.shape[:2])
    wrong = (wrong.any(-1) if wrong.ndim == 3 else wrong) & counted
    if wrong.any():
        FAILURES.mkdir(exist_ok=True)
        white = max(float(np.nanpercentile(np.abs(reference), 99)), 1e-9)
        difference = np.where(counted if picture.ndim == 2 else counted[..., None], np.abs(picture - reference), 0.0)
        for kind, values in {"picture": picture, "reference": reference, "difference": difference}.items():
            shown = np.clip(np.nan_to_num(values / white), 0.0, 1.0) ** (1 / 2.2) * 255.0 + 0.5
            Image.fromarray(shown.astype(np.uint8)).save(FAILURES / f"{name}_{kind}.png")
    worst = np.nanmax(np.where(counted if picture.ndim == 2 else counted[..., None], np.abs(picture - reference), 0.0))
    assert not wrong.any(), (
        f"{name}: {wrong.sum()} of {counted.sum()} pixels are off, by {worst:.3g} at most: pictures in {FAILURES}"
    )
