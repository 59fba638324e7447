"""A view during refinement: GPU handles of its buffers, its progress, and its frame on the CPU."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from weakref import WeakMethod

import moderngl
import numpy as np

from irrsplat.core.buffers import CHANNELS, GBuffer, SplatBuffer
from irrsplat.core.color import LUMINANCE, MID_GREY
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import check_finite
from irrsplat.gpu.target import pixels
from irrsplat.image.backdrop import Backdrop
from irrsplat.image.frame import Frame
from irrsplat.image.statistics import Statistics
from irrsplat.scene.model import Camera

Reader = WeakMethod[Callable[["View"], Frame]]


@dataclass(frozen=True)
class View:
    """One round's picture as GPU handles, valid until the next round.

    camera: relative to the scene's origin, like the g-buffer's positions. splats: at every pixel, its holes filled, or temporally
    filtered. samples: per pixel. With several samples, `image`, `direct`, `indirect`, `emission` (including the sky) and `alpha`
    are means; with one, indirect and emission are None and follow from other buffers. All others are sampled at pixel
    centres. accumulating: True while temporal accumulation has not reached the records' E.
    reader: the renderer's method that makes the frame of `read`; a weak reference, so that a view does not keep its renderer.
    """

    camera: Camera
    gbuffer: GBuffer
    direct: moderngl.Texture
    splats: SplatBuffer
    image: moderngl.Texture
    alpha: moderngl.Texture
    samples: int = 1
    indirect: moderngl.Texture | None = None
    emission: moderngl.Texture | None = None
    backdrop: Backdrop = Backdrop()
    accumulating: bool = False
    reader: Reader | None = field(default=None, repr=False, compare=False)

    def read(self) -> Frame:
        """Return the view as a Frame of numpy arrays that the caller owns, in world space, while the view is valid.

        The statistics state the view's progress. Raises InputError for a view of an earlier camera or size.
        """
        read_back = None if self.reader is None else self.reader()
        if read_back is None:
            raise InputError("the renderer of this view is gone; keep a renderer as long as its views are read")
        return read_back(self)


@dataclass(frozen=True)
class Progress:
    """The progress of a view after a frame of the window.

    round: complete rounds. records: in the cache; new: made in this frame. coverage: share of the visible pixels, 0..1, that were
    covered when the round began. renewed: records recomputed in this frame; stale: records that wait for recomputation. complete:
    False while the round has sites left, or the view is splatted at every other pixel. surface: finished share of the surface
    cache, 0..1. full: the view needs more records than `max_records`. sampled: finished share of a render's samples, 0..1. error:
    estimated relative RMSE of the indirect irradiance, or None. refined: True if no further refinement is due. accumulating: see
    View.
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
    accumulating: bool = False

    @property
    def still(self) -> bool:
        """True if nothing was gathered, nothing is left to gather, and the picture is final."""
        return self.complete and self.surface == 1.0 and not (self.new or self.renewed or self.stale or self.accumulating)

    @property
    def done(self) -> bool:
        """True if nothing is left to gather in this view, or the cache is full."""
        return self.still and (self.coverage == 1.0 or self.full)


def uncovered(view: View, rows_columns: tuple[slice, slice] = (slice(None), slice(None))) -> int:
    """Return the number of visible pixels (top row first) that no record reaches."""
    uncovered_here = pixels(view.splats.weight)[..., 0] <= 0.0
    return int(np.count_nonzero((_seen(view)[..., 0] & uncovered_here)[rows_columns]))


def sample_progress(on_round: Callable[[Progress], None] | None, stats: Statistics) -> Callable[[float], None] | None:
    """Return a callback that calls `on_round` with the share of finished samples; None for None."""
    if on_round is None:
        return None
    now = Progress(stats["rounds"], stats["records"], 0, stats["coverage"])
    return lambda share: on_round(replace(now, sampled=share))


def read(view: View, records: dict[str, np.ndarray], stats: Statistics, names: Iterable[str] | None = None) -> Frame:
    """Return the view as a Frame: copies of its buffers, zero where no surface is visible, and of the cache's `records`.

    names: the required buffers, None for all; others are empty, (0, 0) or (0, 0, 3).
    """
    requested = CHANNELS.keys() if names is None else set(names)
    made = {name: make(view) for name, make in BUFFERS.items() if name in requested}
    return frame_of(made, records, stats, view)


def reflectance(view: View) -> np.ndarray:
    """Return (H, W) reflectances for exposure metering: mid grey for sky and emitters."""
    reflects = _seen(view)[..., 0] & ~pixels(view.gbuffer.emission)[..., :3].any(-1)
    return np.where(reflects, pixels(view.gbuffer.albedo)[..., :3] @ LUMINANCE, np.float32(MID_GREY))


def frame_of(buffers: Mapping[str, np.ndarray], records: Mapping[str, np.ndarray], stats: Statistics, view: View) -> Frame:
    """Return a Frame of these arrays and the cache's `records`, with the backdrop of `view`.

    Missing buffers are empty, (0, 0) or (0, 0, 3). Raises IrrsplatError for values that are not finite.
    """
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
    return Frame(**(filled | dict(buffers)), **kept, stats=stats, backdrop=view.backdrop.kind)


def _rgb(texture: moderngl.Texture) -> np.ndarray:
    return pixels(texture)[..., :3].copy()


def _seen(view: View) -> np.ndarray:
    """Return (H, W, 1) bool, True for pixels with a surface."""
    return pixels(view.gbuffer.position)[..., 3:] > 0.0


def _where_seen(view: View, texture: moderngl.Texture, behind: np.ndarray | None = None) -> np.ndarray:
    """Return (H, W, 3) of the texture, and `behind` (default 0) for pixels without a surface."""
    return np.where(_seen(view), pixels(texture)[..., :3], np.float32(0.0) if behind is None else behind)


def _irradiance(view: View) -> np.ndarray:
    sums = pixels(view.splats.sums)
    return sums[..., :3] / np.where(sums[..., 3:] > 0.0, sums[..., 3:], np.float32(1.0))


def _indirect(view: View) -> np.ndarray:
    if view.indirect is not None:
        return _rgb(view.indirect)
    return np.asarray(_where_seen(view, view.gbuffer.albedo) * _irradiance(view) / np.float32(np.pi))


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


BUFFERS: dict[str, Callable[[View], np.ndarray]] = {  # as in Frame; made one by one, to limit the memory in use
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
