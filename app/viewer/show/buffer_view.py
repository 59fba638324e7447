"""Any buffer of a view on the screen: the picture, what it is made of, and what the records are asked for and see."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, GREY
from irrsplat.app.viewer.background_truth import Lattice, Truth
from irrsplat.app.viewer.show.legend import SHOWINGS, TRUTHS, depth_range, light_tiles, shadow_range, weight_range
from irrsplat.app.viewer.show.screen import Programs, Region, Texels, clear, colours, scale
from irrsplat.core.buffers import Atlas, ShadowMaps
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.image.view import View
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings

# blocks of overlay_buffer.frag
_WAYS = ("radiance", "irradiance", "indirect", "unit", "range", "heat", "weight", "asking", "error")
_GROUND = (0.11, 0.11, 0.12)  # around tiles and cells
_GAP = 2.0  # pixels between them
_EVERY = Lattice(1, (0, 0), (0, 0))  # a buffer of the view has a texel for every pixel


class BufferView(Owner):
    """Draws what SHOWINGS names into targets of any size, best of the view's own."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.program = Programs(ctx)
        self.colours = colours(ctx)
        self.texel = Texels(ctx)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.colours, self.texel)

    def draw(
        self,
        target: Target,
        name: str,
        view: View,
        *,
        settings: Settings,
        scene: Scene,
        exposure: float,
        shadows: ShadowMaps | None = None,
        atlas: Atlas | None = None,
        surface: moderngl.Texture | None = None,
        truth: Truth | None = None,
        region: Region | None = None,
    ) -> None:
        """Draw the showing `name` of `view`, exposed by `exposure` stops, in `region` of the target alone (None: all of it).

        shadows, atlas and surface (RecordScheduler.surface_seen) are needed by the showings of these names; without them there is
        nothing but their ground. Without the truth of this very view, what is shown of it is the picture, dim and grey.
        """
        gain = 2.0**exposure
        how = SHOWINGS[name].how
        if how == "shadow":
            clear(target, _GROUND, region)
            if shadows is not None:
                self._shadows(target, shadows, scene, region)
        elif how == "atlas":
            clear(target, _GROUND, region)
            if atlas is not None:
                self.atlas(target, atlas, gain, scene.sky, region)
        elif how == "surface" and surface is None:
            clear(target, _GROUND, region)
        else:
            how = _block(how, truth, view)
            ways = {way.upper(): int(way == how) for way in _WAYS} | {"SQUARES": int(how in ("irradiance", "error"))}
            program = self.program("viewer/buffers/buffer", **ways)
            program(
                target,
                scissor=region,
                position=view.gbuffer.position,
                scale=scale(target, view.gbuffer),
                colours=self.colours,
                **_arguments(name, how, view, settings, scene, gain, truth, surface),
            )

    def _shadows(self, target: Target, shadows: ShadowMaps, scene: Scene, region: Region | None) -> None:
        side, columns, near = shadows.layout
        tiles = light_tiles(shadows)
        across, pixels, left, top = _grid(len(tiles), (side, side), target.size)
        low, high = shadow_range(scene, shadows)
        size = max(int(side * pixels), 1)
        for i, tile in enumerate(tiles):
            x = round(left + (i % across) * (side * pixels + _GAP))
            y = round(top - (i // across) * (side * pixels + _GAP)) - size
            part = _common((x, y, size, size), region)
            if part is None:
                continue
            self.program("viewer/buffers/shadow")(
                target,
                scissor=part,
                shadow_depth=shadows.depth,
                corner=(i % columns * side, i // columns * side),
                place=(x, y, side / size),
                near=0.0 if tile.thickness else near,
                thickness=tile.thickness,
                low=low,
                high=high,
                colours=self.colours,
            )

    def atlas(
        self,
        target: Target,
        atlas: Atlas,
        gain: float,
        sky: tuple[float, float, float],
        region: Region | None = None,
    ) -> None:
        """Draw the cells of the atlas as large as they fit, radiance times `gain`; a texel that hits nothing shows the sky."""
        across, pixels, left, top = _grid(atlas.count, atlas.cell, target.size)
        self.program("viewer/buffers/atlas")(
            target,
            scissor=region,
            radiance=atlas.radiance,
            cell=atlas.cell,
            columns=atlas.columns,
            count=atlas.count,
            place=(left, top, 1.0 / pixels, _GAP),
            across=across,
            gain=gain,
            sky=sky,
            ground=_GROUND,
        )

    def value(
        self,
        name: str,
        view: View,
        x: int,
        y: int,
        truth: Truth | None = None,
        surface: moderngl.Texture | None = None,
    ) -> np.ndarray | None:
        """The showing `name` at pixel (x, y) of the view, (0, 0) the upper left one: its 1 or 3 numbers in its unit.

        None where there are none: outside, where nothing is seen, for what is not a buffer of the view, and without the
        `truth` of it that reference and error need, or the `surface` cache's view. One texel of each texture concerned is read.
        """
        position = view.gbuffer.position
        if not (0 <= x < position.width and 0 <= y < position.height) or SHOWINGS[name].how in ("shadow", "atlas"):
            return None
        if name in TRUTHS:
            return None if truth is None else _truth_value(self.texel, name, view, truth, x, y)
        if name == "image":
            return self.texel(view.image, x, y)[:3]
        here = self.texel(position, x, y)
        if here[3] == 0.0:
            return np.array([np.inf], "f4") if name == "depth" else None
        if name in ("position", "depth"):
            return here[:3] if name == "position" else here[3:]
        if name in ("weight", "asking"):
            return self.texel(view.splats.weight, x, y)[:1]
        if name == "surface":
            return None if surface is None else self.texel(surface, x, y)[:3]
        mean = view.mean(name)
        if mean is not None:
            return self.texel(mean, x, y)[:3]
        if name in ("indirect", "irradiance"):
            E = _irradiance(self.texel, view, x, y)
            return E if name == "irradiance" else E * self.texel(view.gbuffer.albedo, x, y)[:3] / np.float32(np.pi)
        return self.texel(getattr(view.gbuffer, name), x, y)[:3]


def _block(how: str, truth: Truth | None, view: View) -> str:
    """The block of overlay_buffer.frag that draws this way of showing: without a truth, the dim picture where nothing asks."""
    if how == "surface":
        return "irradiance"
    if how == "indirect" and view.indirect is not None:
        return "radiance"
    if how not in TRUTHS:
        return how
    return "asking" if truth is None else "irradiance" if how == "reference" else how


def _irradiance(texel: Texels, view: View, x: int, y: int) -> np.ndarray:
    sums = texel(view.sums, x, y)
    quotient: np.ndarray = sums[:3] / (sums[3] if sums[3] > 0.0 else np.float32(1.0))
    return quotient


def _truth_value(texel: Texels, name: str, view: View, truth: Truth, x: int, y: int) -> np.ndarray | None:
    """The truth of the square about a pixel, or the error in its middle, the mean of the channels."""
    cell = truth.lattice.cell(x, y)
    found = texel(truth.values, *cell)
    if found[3] == 0.0:
        return None
    if name == "reference":
        return found[:3]
    return np.mean(_irradiance(texel, view, *truth.lattice.middle(cell, truth.size)) - found[:3], keepdims=True)


def _arguments(
    name: str,
    how: str,
    view: View,
    settings: Settings,
    scene: Scene,
    gain: float,
    truth: Truth | None,
    surface: moderngl.Texture | None,
) -> dict[str, Any]:
    """The uniforms of one block of overlay_buffer.frag."""
    g = view.gbuffer
    if how == "radiance":
        mean = view.mean(name)
        return {"values": g.emission if mean is None else mean, "whole": mean is not None, "gain": gain, "unseen": scene.sky}
    if how == "irradiance":
        values, lattice = (truth.values, truth.lattice) if name in TRUTHS and truth is not None else (view.sums, _EVERY)
        values = surface if name == "surface" else values
        return {"values": values, "gain": gain, "stride": lattice.stride, "margin": lattice.margin}
    if how == "error" and truth is not None:
        ends = {end: np.array(colour) / 255.0 for end, colour in (("bright", BRIGHT), ("dark", DARK), ("unseen", GREY))}
        place = {"stride": truth.lattice.stride, "margin": truth.lattice.margin}
        return {"values": view.sums, "truth": truth.values, "full": truth.full, **ends, **place}
    if how == "indirect":
        return {"values": view.sums, "albedo": g.albedo, "gain": gain}
    if how == "unit":
        return {"values": g.albedo}
    if how == "range":
        low, high = scene.bounds if name == "position" else np.array([[-1.0] * 3, [1.0] * 3])
        return {"values": getattr(g, name), "low": low, "high": np.where(high > low, high, low + 1.0)}
    if how == "heat":
        low, high = depth_range(scene, view.camera)
        return {"values": g.position, "low": low, "high": high}
    if how == "weight":
        low, high = weight_range(settings)
        return {"values": view.splats.weight, "low": low, "high": high, "threshold": settings.threshold}
    tolerance = settings.threshold if name == "asking" else -1.0  # which no weight is below
    asking = {
        "sums": view.splats.sums,
        "tolerance": tolerance,
        "spread": settings.spread,
        "luminance_floor": view.splats.luminance_floor,
    }
    return {"values": view.splats.weight, "image": view.image, "gain": gain, **asking}


def _grid(count: int, cell: tuple[float, float], size: tuple[int, int]) -> tuple[int, float, float, float]:
    """How `count` cells of `cell` texels fill a target best: cells per row, pixels per texel, and the upper left corner."""
    across = np.arange(1, max(count, 1) + 1)
    down = -(-max(count, 1) // across)
    pixels = np.minimum((size[0] - _GAP * (across - 1)) / (across * cell[0]), (size[1] - _GAP * (down - 1)) / (down * cell[1]))
    best = int(np.argmax(pixels))
    scale = max(float(pixels[best]), 1.0 / max(cell))
    width, height = (n[best] * (c * scale + _GAP) - _GAP for n, c in ((across, cell[0]), (down, cell[1])))
    return int(across[best]), scale, (size[0] - width) / 2.0, size[1] - (size[1] - height) / 2.0


def _common(a: Region, b: Region | None) -> Region | None:
    """Where both regions are; None for nowhere."""
    if b is None:
        return a
    low = max(a[0], b[0]), max(a[1], b[1])
    high = min(a[0] + a[2], b[0] + b[2]), min(a[1] + a[3], b[1] + b[3])
    return (*low, high[0] - low[0], high[1] - low[1]) if high[0] > low[0] and high[1] > low[1] else None
