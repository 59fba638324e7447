"""The record under the cursor: which one it is, what it holds, and the hemisphere that it saw."""

from __future__ import annotations

from dataclasses import dataclass, fields

import moderngl
import numpy as np

from irrsplat.app.viewer.show.buffer_view import BufferView
from irrsplat.app.viewer.show.screen import Texels
from irrsplat.core.buffers import HitLight, Records, Sites
from irrsplat.core.color import LUMINANCE
from irrsplat.core.record_layout import COLUMNS
from irrsplat.gather import autotune
from irrsplat.gather.look import Gather
from irrsplat.gather.world import World
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.image.view import View
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.weight import behind_wall, record_distance, record_weight, view_radius
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


@dataclass(frozen=True)
class Table:
    """The records on the CPU, float32 arrays with a row for each record; record_layout.COLUMNS says what its columns are.

    luminance_floor: as buffers.Records has it.
    """

    position: np.ndarray
    normal: np.ndarray
    irradiance: np.ndarray
    radius: np.ndarray
    gradient: np.ndarray
    axis: np.ndarray
    curvature: np.ndarray
    max_radius: np.ndarray
    walls: np.ndarray
    limit: np.ndarray
    luminance_floor: float = 0.0

    def __len__(self) -> int:
        return len(self.radius)

    def slope(self) -> np.ndarray:
        """(N,) |∇E| of luminance in W/m³."""
        return np.linalg.norm(np.einsum("ncx,c->nx", self.gradient, LUMINANCE), axis=1)

    def reach(self, camera: Camera, settings: Settings) -> np.ndarray:
        """(N, 2) the radii a·R in metres along `axis` and across it, with all limits of this view and the settings, as
        shaders/records/view_radius.glsl has them."""
        R = self.radius
        if settings.gradients:  # R <= E/|∇E|
            slope, Y = self.slope(), self.irradiance @ LUMINANCE
            E = np.maximum(Y, max(self.luminance_floor, 1e-20))
            R = np.where(slope * R > E, E / np.where(slope > 0.0, slope, 1.0), R)
        radii = np.stack([R, R], axis=1)
        if settings.gradients and settings.radius == "hessian":
            known = self.axis.any(axis=1)
            square = (2.0 * E / np.maximum(Y, 1e-20))[:, None] / np.maximum(np.abs(self.curvature), 1e-14)
            radii[known] = np.minimum(np.sqrt(square), self.max_radius[:, None])[known]
        distance = np.linalg.norm(self.position - np.asarray(camera.eye), axis=1)
        return view_radius(radii * self.limit[:, None], distance[:, None], camera, settings)

    def weights(self, p: np.ndarray, n: np.ndarray, camera: Camera, settings: Settings) -> np.ndarray:
        """(N,) every record's raw w at a point p with unit normal n, (3,) each; 0 where it does not count there."""
        radii, apart = self.reach(camera, settings) / settings.a, p - self.position
        distance = record_distance(apart, self.axis, radii)
        w = record_weight(distance, apart, n, self.normal, radii[:, 1], settings.in_front)
        counts = w > 1.0 / settings.a
        if settings.gradients and settings.walls:
            counts &= ~behind_wall(apart, self.axis, self.normal, self.walls)
        return np.where(counts, w, 0.0)


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
    names = [field.name for field in fields(Table) if field.name in COLUMNS]
    return Table(**records.read(*names), luminance_floor=records.luminance_floor)


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
        lines.append(("curvature", " and ".join(f"{v:.3g}" for v in table.curvature[number]) + " of E per m²"))
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
