"""A buffer on show: title, help, picture, legend, and the value at a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from irrsplat.app.viewer.buffers.background_reference import TracedReference
from irrsplat.app.viewer.show.screen import Programs, Region, clear, scale, texel
from irrsplat.core.buffers import Uniforms
from irrsplat.gpu.target import Target
from irrsplat.image.tonemap import viridis
from irrsplat.image.view import View
from irrsplat.lighting.sky import sky_defines
from irrsplat.meter.light_scale import LightScale
from irrsplat.renderer import Renderer


@dataclass(frozen=True)
class Legend:
    """The legend of a picture: `text`, and the printed ends `low` and `high` of its scale in `unit`.

    colours: (N, 3) display colours 0..1 from low to high, None for no colour scale. mark: the position 0..1 of the threshold on
    the scale, None for no mark.
    """

    text: str
    low: str = ""
    high: str = ""
    unit: str = ""
    colours: np.ndarray | None = None
    mark: float | None = None


def colour_map() -> np.ndarray:
    """Return (64, 3) display colours of the viridis map, for the scale of a legend."""
    return viridis(np.linspace(0.0, 1.0, 64))


GROUND = (0.11, 0.11, 0.12)  # display colour of pixels without a value
_GAP = 2.0  # pixels between tiles


@dataclass(frozen=True, eq=False)
class Identity:
    """An object that equals only itself, among a memo's inputs. A new object may have the GPU handles of a released one."""

    thing: object

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Identity) and self.thing is other.thing

    def __hash__(self) -> int:
        return id(self.thing)


@dataclass(frozen=True)
class ViewSource:
    """A renderer's view on one side of the window, exposed by `exposure` stops.

    reference: the path-traced reference of this view; None for none. light_scale: the scale of false colours, with a known upper
    end. origin: a point in world space; the view's positions are relative to it, in metres.
    """

    renderer: Renderer
    view: View
    exposure: float
    reference: TracedReference | None = None
    light_scale: LightScale = LightScale()  # frozen, so safe as a default
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def inputs(self) -> object:
        """The inputs of all buffers of the view, for a memo, which compares them by ==."""
        return Identity(self.view), self.renderer.settings, self.exposure

    @property
    def gain(self) -> float:
        """The exposure as a factor."""
        return float(2.0**self.exposure)


@dataclass(frozen=True)
class Canvas:
    """The target of a buffer, or a `region` of the target, with the programs that draw into it."""

    target: Target
    programs: Programs
    region: Region | None = None

    def fill(self, fragment: str, uniforms: Uniforms) -> None:
        """Draw with shaders/viewer/buffers/`fragment`.frag. Uniforms that it does not declare are left out."""
        program = self.programs(f"viewer/buffers/{fragment}", defines=sky_defines(uniforms))
        given = program.declared({"colours": self.programs.colours, **uniforms})
        program(self.target, scissor=self.region, **given)

    def tiles(self, fragment: str, count: int, cell: tuple[float, float], columns: int, **uniforms: Any) -> None:
        """Draw `count` tiles of `cell` texels, as large as possible and centred. columns: tiles per row of the texture."""
        across = np.arange(1, max(count, 1) + 1)
        (W, H), rows = self.target.size, -(-max(count, 1) // across)
        pixels = np.minimum((W - _GAP * (across - 1)) / (across * cell[0]), (H - _GAP * (rows - 1)) / (rows * cell[1]))
        best = int(np.argmax(pixels))
        scale = max(float(pixels[best]), 1.0 / max(cell))  # pixels per texel
        width, height = (float(n[best]) * (c * scale + _GAP) - _GAP for n, c in ((across, cell[0]), (rows, cell[1])))
        place = (W - width) / 2.0, (H + height) / 2.0, 1.0 / scale, _GAP
        layout = {"cell": cell, "columns": columns, "count": count, "place": place, "across": int(across[best]), "ground": GROUND}
        self.fill(fragment, layout | uniforms)


def depth_at(source: ViewSource, x: int, y: int) -> float | None:
    """Return the depth in metres at pixel (x, y) of the view, 0 without a surface; None outside of the view."""
    position = source.view.gbuffer.position
    if not (0 <= x < position.width and 0 <= y < position.height):
        return None
    return float(texel(position, x, y)[3])


def first(count: int) -> Callable[[Uniforms, int, int], np.ndarray]:
    """Return a function that reads the first components of a texel of `values`."""
    return lambda uniforms, x, y: texel(uniforms["values"], x, y)[:count]


@dataclass(frozen=True)
class ShownBuffer:
    """A buffer that the viewer can show: an entry of table.BUFFERS.

    name: the channel's name in core.buffers.CHANNELS, if the buffer is a channel. title: the text in menu, legend and help. help:
    one line for the tooltip. fragment: its shader in shaders/viewer/buffers. uniforms: a call that returns the uniforms of this
    shader, with the texture `values`; None before the buffer is made. described: a call that returns the legend. read: a call
    that returns the 1 or 3 numbers at a pixel of the view from the uniforms, in the legend's unit, or None for no value.
    everywhere: True if the buffer also has numbers at pixels without a surface. missing: the legend before the buffer is made.
    in_view: True if its pixels are the pixels of the view, so that records and edges can be marked over it; else it shows tiles.
    needs_reference: True if it needs a path-traced reference. state: a call that returns the inputs apart from view and settings,
    for a memo, which compares them by ==.
    """

    name: str
    title: str
    help: str
    fragment: str
    uniforms: Callable[[ViewSource], Uniforms | None]
    described: Callable[[ViewSource], Legend]
    read: Callable[[Uniforms, int, int], np.ndarray | None] = first(3)
    everywhere: bool = False
    missing: str = ""
    in_view: bool = True
    needs_reference: bool = False
    state: Callable[[ViewSource], object] = lambda source: None

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        """Fill the whole canvas."""
        uniforms, gbuffer = self.uniforms(source), source.view.gbuffer
        if uniforms is None:
            clear(canvas.target, GROUND, canvas.region)
        elif self.in_view:
            canvas.fill(self.fragment, {"position": gbuffer.position, "scale": scale(canvas.target, gbuffer), **uniforms})
        else:
            canvas.tiles(self.fragment, **uniforms)

    def legend(self, source: ViewSource) -> Legend:
        return Legend(self.missing) if self.missing and self.uniforms(source) is None else self.described(source)

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        """Return the buffer's numbers at pixel (x, y) of the view; None for no value. (0, 0) is the upper left pixel."""
        depth = depth_at(source, x, y)
        if depth is None or (depth == 0.0 and not self.everywhere) or not self.in_view:
            return None
        uniforms = self.uniforms(source)
        return None if uniforms is None else self.read(uniforms, x, y)
