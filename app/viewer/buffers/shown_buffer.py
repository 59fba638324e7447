"""A buffer on show: title, help, picture, legend, and the value at a pixel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.background_reference import TracedReference
from irrsplat.core.buffers import GBuffer, Uniforms
from irrsplat.core.color import srgb
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Region, Target, texel
from irrsplat.image.tonemap import viridis
from irrsplat.image.view import View
from irrsplat.lighting.sky import sky_defines
from irrsplat.meter.light_scale import LightScale
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera

_COLOURS = 1024  # texels in each row of the colour table


class Picture(Target):
    """Display colours, opaque over the cleared window. filter: by which the window enlarges them. alpha: "A" for transparency."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], filter: int = moderngl.NEAREST, alpha: str = "1") -> None:
        texture = self.own(ctx.texture(size, 4))
        texture.swizzle, texture.filter = f"RGB{alpha}", (filter, filter)
        texture.repeat_x = texture.repeat_y = False
        super().__init__(ctx, size, textures=[texture])

    def read(self, attachment: int = 0) -> np.ndarray:
        """Return display values 0..1 (H, W, 4), top row first."""
        texture = self.textures[attachment]
        return np.frombuffer(texture.read(), "u1").reshape(texture.height, texture.width, 4)[::-1] / np.float32(255.0)


class Programs(Owner):
    """The shared tools of all drawing: programs, each made on first use and kept.

    colours: the table for shaders/viewer/colours.glsl over 0..1. Its lower row is viridis, its upper row sRGB.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        t = np.linspace(0.0, 1.0, _COLOURS)
        rows = np.stack([viridis(t), np.repeat(srgb(t)[:, None], 3, axis=1)])
        table = ctx.texture((_COLOURS, 2), 3, rows.astype("f4").tobytes(), dtype="f4")  # linear filter by default
        self.colours, self._made = self.own(table), self.own(Workshop())

    def forget(self) -> None:
        self._made.clear()

    def __call__(self, fragment: str, vertex: str = "lib/fullscreen", defines: Mapping[str, object] | None = None) -> Program:
        """Return the program of these shaders and defines."""
        key = f"{fragment} {vertex} {sorted((defines or {}).items())}"
        return self._made.get(key, None, lambda: Program(self.ctx, fragment, vertex, defines))


def scale(target: Target, gbuffer: GBuffer) -> tuple[float, float]:
    """Return the pixels of the view per pixel of the target, in x and y."""
    return gbuffer.position.width / target.size[0], gbuffer.position.height / target.size[1]


def clear(target: Target, colour: tuple[float, float, float], region: Region | None = None) -> None:
    """Fill the target, or a region of it, with a display colour."""
    target.use(scissor=region)
    target.gl.clear(*colour, 1.0, viewport=region)


def view_uniforms(target: Target, gbuffer: GBuffer, camera: Camera) -> Uniforms:
    """Return the uniforms of shaders/viewer/markers/plane.frag and of all programs that draw in the view.

    With depth clamp on, the planes of `clip_from_world` at 1e-3 and 1e3 m clip nothing.
    """
    width, height = gbuffer.position.size
    return {
        "position": gbuffer.position,
        "normal": gbuffer.normal,
        "albedo": gbuffer.albedo,
        "pixel": camera.screen / height,
        "scale": scale(target, gbuffer),
        "clip_from_world": camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
    }


@dataclass(frozen=True)
class Legend:
    """The legend of a picture: `text`, and the printed ends `low` and `high` of its scale in `unit`.

    colours: (N, 3) display colours 0..1 from low to high, None for no colour scale. mark: the position 0..1 of the threshold on
    the scale, None for no mark. form: the format of a value under the cursor.
    """

    text: str
    low: str = ""
    high: str = ""
    unit: str = ""
    colours: np.ndarray | None = None
    mark: float | None = None
    form: str = ".4g"


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
    end. origin: a point in world space; the view's positions are relative to it, in metres. smoothed: True for smooth edges.
    """

    renderer: Renderer
    view: View
    exposure: float
    reference: TracedReference | None = None
    light_scale: LightScale = LightScale()  # frozen, so safe as a default
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    smoothed: bool = False

    @property
    def inputs(self) -> object:
        """The inputs of all buffers in the view, for a memo, which compares them by ==."""
        renderer, surface = self.renderer, self.renderer.scheduler.gatherer.surface_now
        made = self.view, self.reference, renderer.shadows, None if surface is None else surface.result
        return [Identity(one) for one in made], renderer.settings, self.exposure, self.light_scale, self.smoothed

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
        """Draw with shaders/viewer/buffers/`fragment`.frag. Undeclared uniforms are left out; capitals are defines."""
        defines = sky_defines(uniforms) | {name: value for name, value in uniforms.items() if name.isupper()}
        program = self.programs(f"viewer/buffers/{fragment}", defines=defines)
        program(self.target, scissor=self.region, **program.declared({"colours": self.programs.colours, **uniforms}))

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


Shown = tuple[Uniforms | None, Legend]  # uniforms of a buffer's shader, with the texture `values`; None before the buffer is made


@dataclass(frozen=True)
class ShownBuffer:
    """A buffer that the viewer can show: an entry of table.BUFFERS.

    name: the channel's name in core.buffers.CHANNELS, if the buffer is a channel. title: the text in menu, legend and help. help:
    one line for the tooltip. fragment: its shader in shaders/viewer/buffers. show: a call that returns the uniforms of this
    shader and the legend. read: a call that returns the 1 or 3 numbers at a pixel of the view from the uniforms, in the legend's
    unit, or None for no value. everywhere: True if the buffer also has numbers at pixels without a surface. in_view: True if its
    pixels are the pixels of the view, so that records and edges can be marked over it; else it shows tiles. legend_alone: a call
    that returns the legend without a draw; None if `show` draws nothing.
    """

    name: str
    title: str
    help: str
    fragment: str
    show: Callable[[ViewSource], Shown]
    read: Callable[[Uniforms, int, int], np.ndarray | None] = first(3)
    everywhere: bool = False
    in_view: bool = True
    legend_alone: Callable[[ViewSource], Legend] | None = None

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        """Fill the whole canvas."""
        (uniforms, _), gbuffer = self.show(source), source.view.gbuffer
        if uniforms is None:
            clear(canvas.target, GROUND, canvas.region)
        elif self.in_view:
            canvas.fill(self.fragment, {"position": gbuffer.position, "scale": scale(canvas.target, gbuffer), **uniforms})
        else:
            canvas.tiles(self.fragment, **uniforms)

    def legend(self, source: ViewSource) -> Legend:
        return self.show(source)[1] if self.legend_alone is None else self.legend_alone(source)

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        """Return the buffer's numbers at pixel (x, y) of the view; None for no value. (0, 0) is the upper left pixel."""
        depth = depth_at(source, x, y)
        if depth is None or (depth == 0.0 and not self.everywhere) or not self.in_view:
            return None
        uniforms, _ = self.show(source)
        return None if uniforms is None else self.read(uniforms, x, y)
