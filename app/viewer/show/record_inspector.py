"""The record under the cursor: which one it is, what it holds, and the hemisphere that it saw."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.app.viewer.show.buffer_view import BufferView
from irrsplat.app.viewer.show.screen import Texels
from irrsplat.core.buffers import HitLight, Records, Sites
from irrsplat.core.color import LUMINANCE
from irrsplat.gather import autotune
from irrsplat.gather.look import Gather
from irrsplat.gather.world import World
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.image.view import View
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.weight import splat_radius
from irrsplat.scene.model import Camera
from irrsplat.settings import IN_FRONT, LEAST_ERROR, Settings


@dataclass(frozen=True)
class Table:
    """The records on the CPU, float32: position, normal, irradiance E in W/m² (N, 3), radius R_k in metres (N,).

    gradient: (N, 3, 3) ∇E of red, green and blue in W/m³. axis: (N, 3) unit, along which the light bends least, 0 where that is
    not known. bend: (N, 2) second derivatives along it and across it over the light itself, 1/m². farthest: (N,) the greatest
    radius that these may come to, in metres. limit: (N,) the share of its radii that a record may reach at most.
    walls: (N, 2, 2) and dark: as buffers.Records has them.
    """

    position: np.ndarray
    normal: np.ndarray
    irradiance: np.ndarray
    radius: np.ndarray
    gradient: np.ndarray
    axis: np.ndarray
    bend: np.ndarray
    farthest: np.ndarray
    limit: np.ndarray
    walls: np.ndarray
    dark: float = 0.0

    def __len__(self) -> int:
        return len(self.radius)

    def slope(self) -> np.ndarray:
        """(N,) |∇E| of luminance in W/m³."""
        return np.linalg.norm(np.einsum("ncx,c->nx", self.gradient, LUMINANCE), axis=1)

    def reach(self, camera: Camera, settings: Settings) -> np.ndarray:
        """(N, 2) the radii a·R in metres along `axis` and across it, with all limits of this view and the settings, as splat.vert
        has them."""
        R = self.radius
        if settings.gradients:  # R <= E/|∇E|
            slope, Y = self.slope(), self.irradiance @ LUMINANCE
            E = np.maximum(Y, max(self.dark, 1e-20))
            R = np.where(slope * R > E, E / np.where(slope > 0.0, slope, 1.0), R)
        radii = np.stack([R, R], axis=1)
        if settings.gradients and settings.radius == "hessian":
            bends = self.axis.any(axis=1)
            square = (2.0 * E / np.maximum(Y, 1e-20))[:, None] / np.maximum(np.abs(self.bend), 1e-14)
            radii[bends] = np.minimum(np.sqrt(square), self.farthest[:, None])[bends]
        distance = np.linalg.norm(self.position - np.asarray(camera.eye), axis=1)
        return splat_radius(radii * self.limit[:, None], distance[:, None], camera, settings)

    def weights(self, p: np.ndarray, n: np.ndarray, camera: Camera, settings: Settings) -> np.ndarray:
        """(N,) every record's raw w at a point p with unit normal n, (3,) each; 0 where it does not speak for it."""
        R = self.reach(camera, settings) / settings.a
        apart, cosine = p - self.position, self.normal @ n
        along = (apart * self.axis).sum(1)
        distance = np.stack([along, np.sqrt(np.maximum((apart**2).sum(1) - along**2, 0.0))], axis=1) / np.maximum(R, 1e-30)
        error = np.linalg.norm(distance, axis=1) + np.sqrt(np.maximum(0.0, 1.0 - cosine))
        w = 1.0 / np.maximum(error, LEAST_ERROR)
        speaks = w > 1.0 / settings.a
        if settings.in_front:
            speaks &= (cosine > 0.0) & (np.abs((apart * (n + self.normal)).sum(1)) * 0.5 <= IN_FRONT * R[:, 1])
        if settings.gradients and settings.walls:
            place = np.stack([along, (apart * np.cross(self.normal, self.axis)).sum(1)], axis=1)
            speaks &= ((place[:, None] * self.walls).sum(2) <= 1.0).all(1)
        return np.where(speaks, w, 0.0)


@dataclass(frozen=True)
class InspectedRecord:
    """A record on show: what it holds, a label and a text each, the hemisphere that it sees, and how many pixels it serves."""

    number: int
    side: int
    lines: list[tuple[str, str]]
    picture: moderngl.Texture
    served: int


def read(records: Records) -> Table:
    """Copy the records from the GPU; it waits for what is being drawn: once a click, or whenever the cache has changed."""

    def rows(texture: moderngl.Texture) -> np.ndarray:
        return np.frombuffer(texture.read(), "f4").reshape(-1, 4)[: records.count]

    last = rows(records.irradiance)
    vectors = [rows(texture) for texture in records.vectors]
    gradient, rest = np.stack([v[:, :3] for v in vectors[3:]], axis=1), np.stack([v[:, 3] for v in vectors], axis=1)
    limit = np.frombuffer(records.limit.read(), "f4")[: records.count]
    position, normal = rows(records.position)[:, :3], rows(records.normal)[:, :3]
    bends, walls = (rest[:, :3], rest[:, 3:5], rest[:, 5]), rows(records.walls).reshape(-1, 2, 2)
    return Table(position, normal, last[:, :3], last[:, 3], gradient, *bends, limit, walls, records.dark)


def pick(texel: Texels, table: Table, view: View, settings: Settings, x: int, y: int) -> int | None:
    """The number of the record that weighs most at pixel (x, y) of the view, (0, 0) the upper left one; None: there is none."""
    position = view.gbuffer.position
    if not len(table) or not (0 <= x < position.width and 0 <= y < position.height):
        return None
    here = texel(position, x, y)
    if here[3] == 0.0:
        return None
    w = table.weights(here[:3], texel(view.gbuffer.normal, x, y)[:3], view.camera, settings)
    best = int(np.argmax(w))
    return best if w[best] > 0.0 else None


def describe(number: int, table: Table, view: View, settings: Settings) -> list[tuple[str, str]]:
    """What record `number` holds, a label and a text each, with units."""
    E, R = table.irradiance[number], float(table.radius[number])
    along, across = table.reach(view.camera, settings)[number]
    lines = [
        ("record", f"{number} of {len(table)}"),
        ("position", " ".join(f"{v:.3f}" for v in table.position[number]) + " m"),
        ("normal", " ".join(f"{v:.3f}" for v in table.normal[number])),
        ("irradiance", " ".join(f"{v:.3g}" for v in E) + " W/m²"),
        ("luminance", f"{float(E @ LUMINANCE):.3g} W/m²"),
        ("R", f"{R:.3g} m"),
        ("a·R", f"{settings.a * R:.3g} m, here {along:.3g} by {across:.3g} m"),
    ]
    if settings.gradients:
        lines.append(("|grad E|", f"{float(table.slope()[number]):.3g} W/m³"))
    if table.axis[number].any():
        lines.append(("bend", " and ".join(f"{v:.3g}" for v in table.bend[number]) + " of E per m²"))
    return lines


class RecordInspector(Owner):
    """Gathers single records again, to show what they see."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.buffer_view = BufferView(ctx)
        self.gather_pass: Gather | None = None
        self.target: Target | None = None
        self.picture: moderngl.Texture | None = None
        self._made_for: tuple[object, ...] = ()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.buffer_view, self.gather_pass, self.target, self.picture)

    def hemisphere(
        self,
        number: int,
        site: Sites,
        world: World,
        light: HitLight,
        *,
        settings: Settings,
        exposure: float,
    ) -> moderngl.Texture:
        """What record `number`, which lies at the one `site`, sees: its cell of the atlas as it is, exposed by `exposure` stops.

        world, light: what gathers look at, and what lights that, as RecordScheduler has them.

        The texture is RGBA8, bottom row first, this object's own, and holds until the next call.
        """
        kind, more = autotune.kind(self.ctx, world.scene, settings), settings.most_bounces > 1
        made_for = world, kind, more, settings.gather_size, light_defines(world.scene)
        if self.gather_pass is None or made_for != self._made_for:
            self.release_cell()
            self.gather_pass = autotune.gather_pass(world, settings, capacity=1)
            self.picture = self.ctx.texture(self.gather_pass.cell, 4)
            self.target = Target(self.ctx, self.gather_pass.cell, textures=[self.picture])
            self._made_for = made_for
        assert self.target is not None and self.picture is not None
        atlas = self.gather_pass(light, site, np.array([number]), settings.seed)
        self.buffer_view.atlas(self.target, atlas, 2.0**exposure, world.scene.sky)
        return self.picture

    def release_cell(self) -> None:
        """Free what was made for the last scene and settings."""
        for thing in (self.gather_pass, self.target, self.picture):
            if thing is not None:
                thing.release()
