"""The seed paper's algorithm as published (Jones 2010), one record at a time: the baseline of every comparison.

Kept: random warm-up records, a single plane of 150° per record, a blocking read-back and a sum on the CPU for each, and a
kernel cut off at 1/a. The traversal visits the splat buffer in scan order, and splats the weights of new records on the CPU.
Corrected, because the program differed from its formulas: coordinates on the plane, distances (true distances, weighted by
cosθ·dω), and the threshold (Σw compared with 1/a, not with a). Black records, the background, the quad of a splat, and the
repeated shadow maps are corrected, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, GBuffer, HitLight, Sites
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gather.hemisphere import Gather
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.records.weight import bounded, record_weight
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings

SMOOTH_OFF = 0.01  # of the scene's diagonal: how far neighbours of a smooth pixel may lie from its tangent plane
_ANGLE = 18.0  # degrees at most between the normals of a smooth pixel and its neighbours


@dataclass(frozen=True)
class Seen:
    """The g-buffer on the CPU, top row first: position, normal, lit_normal (bent by the normal map) and geometric (H, W, 3),
    mask (H, W), True where a surface is, and the number of the triangle (H, W) there, where known."""

    position: np.ndarray
    normal: np.ndarray
    lit_normal: np.ndarray
    geometric: np.ndarray
    mask: np.ndarray
    triangle: np.ndarray | None = None

    def sites(self, at: tuple[Any, ...]) -> Sites:
        """Return the pixels at an index of rows and columns as places for records."""
        triangle = None if self.triangle is None else self.triangle[at]
        return Sites(self.position[at], self.normal[at], self.geometric[at], triangle)

    def smooth(self, off: float) -> np.ndarray:
        """Return (H, W), True where a pixel's 3×3 neighbours have about its normal and lie near its tangent plane."""
        smooth = np.zeros_like(self.mask)
        inner = (slice(1, -1), slice(1, -1))
        height, width = self.mask.shape
        smooth[inner] = self.mask[inner]
        p, n = self.position[inner], self.normal[inner]
        for dy in (0, 1, 2):
            for dx in (0, 1, 2):
                there = (slice(dy, dy + height - 2), slice(dx, dx + width - 2))
                smooth[inner] &= self.mask[there]
                smooth[inner] &= (self.normal[there] * n).sum(-1) >= np.cos(np.radians(_ANGLE))
                smooth[inner] &= np.abs(((self.position[there] - p) * n).sum(-1)) <= off
        return smooth


class Scan:
    """The paper's traversal of a view. seen: its g-buffer. warmed: number of complete warm-up records."""

    def __init__(self, seen: Seen, warmed: int) -> None:
        self.seen, self.warmed = seen, warmed

    def advance(
        self,
        weight: np.ndarray,
        record: Callable[[Sites], np.ndarray],
        room: int,
        budget: Budget,
        camera: Camera,
        settings: Settings,
    ) -> tuple[Sites, np.ndarray, float, bool]:
        """Make the warm-up records (step 1), or traverse the view in scan order and make a record where Σw is too low (step 3).

        weight: (H, W) Σw. record: returns (4,) E and R at a site. At most `room` records are made, and one at least. Return the
        records' sites, their (N, 4) values, the share of the seen pixels that lacked one at first, and True unless `room` or
        budget ended the work.
        """
        seen, weight, stopped = self.seen, weight.copy(), False
        warming = self.warmed < settings.warmup
        if warming:
            visible = np.argwhere(seen.mask)
            chosen = np.random.default_rng(settings.seed).permutation(len(visible))
            places, missing = iter(visible[chosen[self.warmed : settings.warmup]]), float(seen.mask.any())
        else:
            missing = float((seen.mask & (weight < settings.threshold)).sum() / max(seen.mask.sum(), 1))
            places = _lacking(seen.mask, weight, settings.threshold)
        at, values = [], []
        for row, column in places:
            site = seen.sites((slice(row, row + 1), column))
            at.append((row, column))
            values.append(record(site))
            if not warming:
                splat_weight(weight, seen, site, float(values[-1][3]), camera, settings)
            stopped = budget.left <= 0.0 or len(at) == room
            if stopped:
                break
        if warming:
            self.warmed = self.warmed + len(at) if stopped else settings.warmup
        rows, columns = np.array(at, np.intp).reshape(-1, 2).T
        return seen.sites((rows, columns)), np.array(values, "f4").reshape(-1, 4), missing, not stopped


def _lacking(mask: np.ndarray, weight: np.ndarray, threshold: float) -> Iterator[tuple[int, int]]:
    """Yield the pixels of `mask` whose weight is below the threshold, in scan order. The weights may grow meanwhile."""
    for row in range(len(weight)):
        column = 0
        while (lacking := mask[row, column:] & (weight[row, column:] < threshold)).any():
            column += int(lacking.argmax())
            yield row, column
            column += 1


def read_back(gbuffer: GBuffer) -> Seen:
    """Read the visible points and their normals back to the CPU (section 3.2)."""
    position, normal, albedo, emission = (pixels(t) for t in (gbuffer.position, gbuffer.normal, gbuffer.albedo, gbuffer.emission))
    mask = position[..., 3] > 0.0
    triangle = np.where(mask, emission[..., 3], 0.0).astype(np.intp)
    bent = normal if gbuffer.mapped_normal is None else pixels(gbuffer.mapped_normal)
    geometric = octahedral_decode(normal[..., 3], albedo[..., 3])
    return Seen(position[..., :3], normal[..., :3], bent[..., :3], geometric, mask, triangle)


def gather_record(gather: Gather, light: HitLight, site: Sites) -> np.ndarray:
    """Return (4,) a record by a picture of the scene from its site, and a sum on the CPU (section 3.4).

    The values are E = Σ L·ΔA/(1+x²+y²)² in W/m², and R_k, the harmonic mean distance in metres.
    """
    atlas = gather(light, site, np.zeros(1), 0)
    seen = _cell(atlas, atlas.radiance)
    share = gather.share  # cosθ·dω, which on the plane at distance 1 is ΔA/(1+x²+y²)²
    hit = seen[..., 3] > 0.0
    E = np.einsum("ij,ijc->c", share, np.where(hit[..., None], seen[..., :3], _sky(gather.world.scene, atlas)))
    inverse = (share[hit] / seen[..., 3][hit]).sum()
    R = np.clip(share.sum() / max(inverse, 1e-30), *gather.radii)
    return np.array([*E, R], "f4")


def _sky(scene: Scene, atlas: Atlas) -> np.ndarray:
    """Return (3,) the radiance of a uniform sky, or (H, W, 3) the radiance in the directions of the texels."""
    if scene.uniform_sky:
        return np.asarray(scene.sky, "f4")
    frames, table = atlas.frames, _cell(atlas, atlas.table)
    frame = np.frombuffer(frames.read(), "f4").reshape(frames.height, frames.width, 4)[:3, 0, :3]
    ways = table[..., :3].reshape(-1, 3) @ frame
    if scene.environment is not None:
        radiance = scene.environment.lit_by(ways, (table[..., 3] / table[..., 2]).ravel())
    else:
        radiance = scene.sky_radiance(ways)
    return radiance.reshape(*table.shape[:2], 3).astype("f4")


def _cell(atlas: Atlas, texture: moderngl.Texture) -> np.ndarray:
    """Return (H, W, 4) the first cell of a texture, which may be larger."""
    width, height = atlas.cell
    return np.frombuffer(texture.read(), "f4").reshape(texture.height, texture.width, 4)[:height, :width]


def splat_weight(weight: np.ndarray, seen: Seen, site: Sites, R: float, camera: Camera, settings: Settings) -> None:
    """Add a record's w to the CPU's copy of the weights, in the box of pixels that bounds its sphere (section 3.5.2)."""
    height, width = weight.shape
    p_k, n_k, a = site.position[0], site.normal[0], np.float32(settings.a)
    d = float(np.linalg.norm(p_k - np.asarray(camera.eye)))
    r = float(bounded(settings.a * R, camera.measure((width, height)) * d, settings))
    rows, columns = _box(p_k, r, camera, (width, height))
    apart = seen.position[rows, columns] - p_k
    distance = np.sqrt((apart * apart).sum(-1)) / np.float32(r / settings.a)
    w = record_weight(distance, apart, seen.normal[rows, columns], n_k, r / settings.a, settings.hessian)
    weight[rows, columns] += np.where(seen.mask[rows, columns] & (w > 1.0 / a), w, np.float32(0.0))


def _box(centre: np.ndarray, r: float, camera: Camera, size: tuple[int, int]) -> tuple[slice, slice]:
    """Return the rows and columns of pixels (top row first) that a sphere may cover; all if it reaches the eye's plane.

    A pixel of the sphere lies within the projection of the sphere's bounding box.
    """
    *lateral, z = camera.axes @ (centre - np.asarray(camera.eye))
    if -z <= r:
        return slice(None), slice(None)
    f = size[1] / camera.screen  # pixels
    ends = f * np.add.outer((-r, r), lateral)[None] / np.array([-z - r, -z + r])[:, None, None] + 0.5 * np.array(size)
    low, high = np.floor(ends.min((0, 1))) - 1.0, np.ceil(ends.max((0, 1))) + 1.0
    (left, bottom), (right, top) = (np.clip(end, 0, size).astype(int).tolist() for end in (low, high))
    return slice(size[1] - top, size[1] - bottom), slice(left, right)
