"""A buffer on show: title, help, picture, legend, and the value at a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.background_reference import TracedReference
from irrsplat.app.viewer.show.screen import Programs, Region, clear, scale, texel
from irrsplat.gpu.target import Target
from irrsplat.image.tonemap import viridis
from irrsplat.image.view import View
from irrsplat.lighting.sky import sky_defines
from irrsplat.meter.light_scale import LightScale
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings


@dataclass(frozen=True)
class Legend:
    """The legend of a picture: `text`, and its scale from `low` to `high` in `unit`, as they are printed.

    colours: (N, 3) display colours 0..1 from low to high, None where there is no colour scale. mark: the position 0..1 on the
    scale of what the text calls the threshold, None for no mark.
    """

    text: str
    low: str = ""
    high: str = ""
    unit: str = ""
    colours: np.ndarray | None = None
    mark: float | None = None


def colour_map() -> np.ndarray:
    """(64, 3) display colours of the viridis map, for the scale of a legend."""
    return viridis(np.linspace(0.0, 1.0, 64))


GROUND = (0.11, 0.11, 0.12)  # display colour where a buffer has nothing to show

Uniform = moderngl.Texture | np.ndarray | tuple[float, ...] | float | bool


@dataclass(frozen=True, eq=False)
class Identity:
    """Something that is equal to itself alone: for a memo's inputs, where a new object may have the handles of the old one."""

    thing: object

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Identity) and self.thing is other.thing

    def __hash__(self) -> int:
        return id(self.thing)


@dataclass(frozen=True)
class ViewSource:
    """A renderer's view on one side of the window, exposed by `exposure` stops.

    reference: path-traced, of this view; None for none. light_scale: of false colours, with a known upper end.
    origin: world space; the view's positions are relative to it.
    """

    renderer: Renderer
    view: View
    exposure: float
    reference: TracedReference | None = None
    light_scale: LightScale = LightScale()  # it is frozen
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def settings(self) -> Settings:
        return self.renderer.settings

    @property
    def scene(self) -> Scene:
        return self.renderer.scene

    @property
    def inputs(self) -> object:
        """The inputs of all its buffers, for a memo; compared by ==."""
        return Identity(self.view), self.settings, self.exposure

    @property
    def gain(self) -> float:
        """The exposure as a factor."""
        return float(2.0**self.exposure)


@dataclass(frozen=True)
class Canvas:
    """A target or a `region` of it for a buffer, with programs."""

    target: Target
    programs: Programs
    region: Region | None = None

    def picture(self, source: ViewSource, fragment: str, values: moderngl.Texture, **uniforms: Uniform) -> None:
        """Draw with shaders/viewer/buffers/`fragment`.frag, which colours each pixel of the view by its texel of `values`."""
        program = self.programs(f"viewer/buffers/{fragment}", defines=sky_defines(uniforms))
        gbuffer = source.view.gbuffer
        given: dict[str, Any] = {
            "position": gbuffer.position,
            "scale": scale(self.target, gbuffer),
            "colours": self.programs.colours,
            "values": values,
            **uniforms,
        }
        program(self.target, scissor=self.region, **given)

    def blank(self) -> None:
        clear(self.target, GROUND, self.region)


def depth_at(source: ViewSource, x: int, y: int) -> float | None:
    """The depth in metres at pixel (x, y) of the view, 0 where nothing is seen; None outside of it."""
    position = source.view.gbuffer.position
    if not (0 <= x < position.width and 0 <= y < position.height):
        return None
    return float(texel(position, x, y)[3])


@dataclass(frozen=True)
class ShownBuffer:
    """A buffer that the viewer can show, an entry of table.BUFFERS; kinds.py makes them.

    name: as in core.buffers.CHANNELS where it is one of those. title: in menu, legend and help. help: one line for the tooltip.
    draw: over a whole canvas. read: its 1 or 3 numbers at a pixel of the view, in the legend's unit; None where it has none.
    everywhere: True if it has numbers where the camera sees nothing, too. in_view: True if its pixels are those of the view, so
    that records and edges can be marked over it. needs_reference: True if the path tracer has to find it first. state: its inputs
    apart from view and settings, for a memo; compared by ==.
    """

    name: str
    title: str
    help: str
    draw: Callable[[Canvas, ViewSource], None]
    legend: Callable[[ViewSource], Legend]
    read: Callable[[ViewSource, int, int], np.ndarray | None] = lambda source, x, y: None
    everywhere: bool = False
    in_view: bool = True
    needs_reference: bool = False
    state: Callable[[ViewSource], object] = lambda source: None

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        """Return its numbers at pixel (x, y) of the view, (0, 0) the upper left one; None where it has none."""
        depth = depth_at(source, x, y)
        return None if depth is None or (depth == 0.0 and not self.everywhere) else self.read(source, x, y)
