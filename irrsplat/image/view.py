"""One view of the scene while it refines: the GPU handles of its buffers, how far it has come, and its frame on the CPU."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.buffers import CHANNELS, GBuffer, SplatBuffer
from irrsplat.core.color import LUMINANCE, MID_GREY
from irrsplat.core.files import as_png
from irrsplat.core.glsl import TOLD
from irrsplat.core.vectors import check_finite
from irrsplat.gpu.target import pixels
from irrsplat.image.backdrop import Backdrop, display_picture
from irrsplat.image.frame import Frame
from irrsplat.image.statistics import Statistics
from irrsplat.image.tonemap import exposure_of
from irrsplat.scene.model import Camera


@dataclass(frozen=True)
class View:
    """One round's picture as GPU handles, valid until the next round: what the viewer shows and `render` reads back.

    camera: relative to the scene's origin, as the g-buffer's positions are.
    sums: (Σ k·E, Σ k), whose quotient E the picture is made of: the splat buffer's own, or filtered in time.
    samples: of a pixel. Of more than one, the first at its centre, `image`, `direct`, `indirect`, `emission` (the sky's
    too) and `alpha` are the means; of one alone, indirect and emission follow from the rest. All others are of the centre.
    backdrop: what stands where nothing is seen. fading: whether E is not yet what the records say, but on the way there from what
    the picture before showed.
    """

    camera: Camera
    gbuffer: GBuffer
    direct: moderngl.Texture
    splats: SplatBuffer
    sums: moderngl.Texture
    image: moderngl.Texture
    alpha: moderngl.Texture
    samples: int = 1
    indirect: moderngl.Texture | None = None
    emission: moderngl.Texture | None = None
    backdrop: Backdrop = Backdrop()
    fading: bool = False

    def _repr_png_(self) -> bytes:
        """The picture as a PNG, by its own exposure: a notebook shows the view while it is valid."""
        image, kind = pixels(self.image)[..., :3], self.backdrop.kind
        return as_png(display_picture(image, exposure_of(image, reflectance(self)), pixels(self.alpha)[..., 0], kind))

    def mean(self, name: str) -> moderngl.Texture | None:
        """The texture that holds `image`, `direct`, `indirect` or `emission` of every pixel; None for one that has none."""
        return {"image": self.image, "direct": self.direct, "indirect": self.indirect, "emission": self.emission}.get(name)


@dataclass(frozen=True)
class Progress:
    """How far a view has come after a tick.

    round: complete rounds so far. records: in the cache; new: those made in this tick. coverage: the share of the seen pixels,
    0..1, that asked for nothing when the round began. renewed: old records gathered again in this tick; stale: those that still
    wait, or whose light by a single lamp is still to be gathered. complete: False while the round has sites left, or the view
    has only every other pixel splatted. surface: how much of
    the surface cache is made, 0..1. full: the view needs more records than `max_records`. sampled: the share of a render's
    samples that are taken, 0..1. error: the estimated relative RMSE of the indirect irradiance, None where it is not known.
    refined: whether the view is refined as far as it is to be, or can be. fading: the picture is not yet what the records say,
    see View.
    """

    round: int
    records: int
    new: int
    coverage: float
    renewed: int = 0
    stale: int = 0
    complete: bool = True
    surface: float = 1.0
    full: bool = False
    sampled: float = 0.0
    error: float | None = None
    refined: bool = False
    fading: bool = False

    @property
    def still(self) -> bool:
        """Whether nothing was gathered, and nothing would be in the next tick, nor would the picture be another."""
        return self.complete and self.surface == 1.0 and not (self.new or self.renewed or self.stale or self.fading)

    @property
    def done(self) -> bool:
        """Whether nothing is left to gather in this view, or nothing may be."""
        return self.still and (self.coverage == 1.0 or self.full)


def uncovered(view: View, rows_columns: tuple[slice, slice] = (slice(None), slice(None))) -> int:
    """Return the number of pixels, top row first, that see a surface which no record reaches."""
    untold = (pixels(view.splats.sums)[..., 3] <= TOLD) & (pixels(view.splats.weight)[..., 0] <= 0.0)
    return int(np.count_nonzero((_seen(view)[..., 0] & untold)[rows_columns]))


def counted(progress: Progress, seconds: float, on_progress: Callable[[Progress], None] | None) -> Statistics:
    """What is counted of a view that took so many seconds by the records that there are; on_progress is told, too."""
    if on_progress is not None:
        on_progress(progress)
    stats: Statistics = {"rounds": 0, "converged": progress.coverage == 1.0, "full": False, "interrupted": False}
    return stats | {"coverage": progress.coverage, "error": None, "records": progress.records, "seconds": seconds}


def sample_progress(on_round: Callable[[Progress], None] | None, stats: Statistics) -> Callable[[float], None] | None:
    """Calls `on_round` with the share of the samples that are taken, for a view that stands as in `stats`; None for None."""
    if on_round is None:
        return None
    now = Progress(stats["rounds"], stats["records"], 0, stats["coverage"])
    return lambda share: on_round(replace(now, sampled=share))


def read(view: View, records: dict[str, np.ndarray], stats: Statistics, names: Iterable[str] | None = None) -> Frame:
    """The view as a Frame: a copy of every buffer, zero where nothing is seen, and of the cache's `records`. names: of those that
    are wanted, None for all; others are empty, (0, 0) or (0, 0, 3)."""
    wanted = CHANNELS.keys() if names is None else set(names)
    made = {name: make(view) for name, make in _BUFFERS.items() if name in wanted}
    return frame_of(made, records, stats, view)


def values_of(view: View, name: str) -> np.ndarray:
    """One of CHANNELS of the view, as Frame has it."""
    return _BUFFERS[name](view)


def reflectance(view: View) -> np.ndarray:
    """Return (H, W) what an exposure meter takes each pixel to reflect: mid grey for sky and for what emits."""
    reflects = _seen(view)[..., 0] & ~pixels(view.gbuffer.emission)[..., :3].any(-1)
    found: np.ndarray = np.where(reflects, pixels(view.gbuffer.albedo)[..., :3] @ LUMINANCE, np.float32(MID_GREY))
    return found


def frame_of(buffers: Mapping[str, np.ndarray], records: Mapping[str, np.ndarray], stats: Statistics, view: View) -> Frame:
    """A Frame of these arrays, and of the cache's `records`, seen as `view` is, or the picture that it is a part of. Buffers
    that are not given are empty, (0, 0) or (0, 0, 3). Raises IrrsplatError for values that are not finite."""
    filled: dict[str, Any] = {
        name: np.zeros((0, 0, 3)[: 3 if kind.components == 3 else 2], "f4") for name, kind in CHANNELS.items()
    }
    for name, values in buffers.items():
        if name != "depth":
            check_finite(f"buffer '{name}'", values, lambda at: f"the pixel in row {at[0]}, column {at[1]}")
    for name, values in records.items():
        if name in ("irradiance", "radius"):
            check_finite(f"a record's {name}", values, lambda at: f"{records['position'][at[0]].tolist()}")
    kept: dict[str, Any] = {f"records_{name}": records[name] for name in ("position", "normal", "irradiance", "radius")}
    c = view.camera
    camera = Camera(c.eye, c.target, c.up, c.fov, c.name)  # without what moves samples within their pixels
    return Frame(**(filled | dict(buffers)), **kept, stats=stats, backdrop=view.backdrop.kind, camera=camera)


def _rgb(texture: moderngl.Texture) -> np.ndarray:
    return pixels(texture)[..., :3].copy()


def _seen(view: View) -> np.ndarray:
    """(H, W, 1) whether a pixel sees a surface."""
    seen: np.ndarray = pixels(view.gbuffer.position)[..., 3:] > 0.0
    return seen


def _where_seen(view: View, texture: moderngl.Texture, behind: np.ndarray | None = None) -> np.ndarray:
    """(H, W, 3) of the texture, and what is `behind`, default 0, where nothing is seen."""
    return np.where(_seen(view), pixels(texture)[..., :3], np.float32(0.0) if behind is None else behind)


def _irradiance(view: View) -> np.ndarray:
    sums = pixels(view.sums)
    found: np.ndarray = sums[..., :3] / np.where(sums[..., 3:] > 0.0, sums[..., 3:], np.float32(1.0))
    return found


def _indirect(view: View) -> np.ndarray:
    if view.indirect is not None:
        return _rgb(view.indirect)
    found: np.ndarray = _where_seen(view, view.gbuffer.albedo) * _irradiance(view) / np.float32(np.pi)
    return found


def _emission(view: View) -> np.ndarray:
    if view.emission is not None:
        return _rgb(view.emission)
    return _where_seen(view, view.gbuffer.emission, view.backdrop.radiance(view.camera, view.image.size))


def _opacity(view: View) -> np.ndarray:
    opacity: np.ndarray = _seen(view)[..., 0].astype("f4")
    if view.gbuffer.filters is None:
        return opacity
    filtered = pixels(view.gbuffer.filters.opacity)[..., 0]
    return np.where(filtered > 0.0, filtered, opacity)


_BUFFERS: dict[str, Callable[[View], np.ndarray]] = {  # each made by itself, so that no more of them is in memory than wanted
    "image": lambda view: _rgb(view.image),
    "direct": lambda view: _rgb(view.direct),
    "indirect": _indirect,
    "irradiance": _irradiance,
    "emission": _emission,
    "weight": lambda view: np.where(_seen(view)[..., 0], pixels(view.splats.weight)[..., 0], np.float32(0.0)),
    "position": lambda view: _where_seen(view, view.gbuffer.position),
    "normal": lambda view: _where_seen(view, view.gbuffer.lit_normal),
    "smooth_normal": lambda view: _where_seen(view, view.gbuffer.normal),
    "albedo": lambda view: _where_seen(view, view.gbuffer.albedo),
    "alpha": lambda view: pixels(view.alpha)[..., 0].copy(),
    "opacity": _opacity,
    "depth": lambda view: np.where(_seen(view), pixels(view.gbuffer.position)[..., 3:], np.float32(np.inf))[..., 0],
}
