"""One view of the scene while it refines: the GPU handles of its buffers, how far it has come, and its frame on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, SplatBuffer
from irrsplat.gpu.target import pixels
from irrsplat.image.backdrop import Backdrop
from irrsplat.image.frame import Frame
from irrsplat.image.statistics import Statistics
from irrsplat.scene.model import Camera


@dataclass(frozen=True)
class View:
    """One round's picture as GPU handles, valid until the next round: what the viewer shows and `render` reads back.

    camera: relative to the scene's origin, as the g-buffer's positions are.
    sums: (Σ k·E, Σ k), whose quotient E the picture is made of: the splat buffer's own, or smoothed.
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


def sample_progress(on_round: Callable[[Progress], None] | None, stats: Statistics) -> Callable[[float], None] | None:
    """Calls `on_round` with the share of the samples that are taken, for a view that stands as in `stats`; None for None."""
    if on_round is None:
        return None
    now = Progress(stats["rounds"], stats["records"], 0, stats["coverage"])
    return lambda share: on_round(replace(now, sampled=share))


def read(view: View, records: dict[str, np.ndarray], stats: Statistics) -> Frame:
    """The view as a Frame: a copy of every buffer, zero where nothing is seen, and of the cache's `records`."""
    gbuffer = view.gbuffer
    buffers = {
        "position": pixels(gbuffer.position),
        "normal": pixels(gbuffer.lit_normal),
        "smooth_normal": pixels(gbuffer.normal),
        "albedo": pixels(gbuffer.albedo),
        "emission": pixels(gbuffer.emission),
    }
    seen = buffers["position"][..., 3:] > 0.0
    values = {name: np.where(seen, b[..., :3], np.float32(0.0)) for name, b in buffers.items()}
    albedo = values["albedo"]
    behind = view.backdrop.radiance(view.camera, view.image.size)
    opacity = seen[..., 0].astype("f4")
    if gbuffer.filters is not None:
        filtered = pixels(gbuffer.filters.opacity)[..., 0]
        opacity = np.where(filtered > 0.0, filtered, opacity)
    sums = pixels(view.sums)
    irradiance = sums[..., :3] / np.where(sums[..., 3:] > 0.0, sums[..., 3:], np.float32(1.0))
    return Frame(
        image=_rgb(view.image),
        direct=_rgb(view.direct),
        indirect=_rgb(view.indirect) if view.indirect is not None else albedo * irradiance / np.float32(np.pi),
        irradiance=irradiance,
        emission=_rgb(view.emission) if view.emission is not None else np.where(seen, values["emission"], behind),
        weight=np.where(seen[..., 0], pixels(view.splats.weight)[..., 0], np.float32(0.0)),
        position=values["position"],
        normal=values["normal"],
        smooth_normal=values["smooth_normal"],
        albedo=albedo,
        alpha=pixels(view.alpha)[..., 0].copy(),
        opacity=opacity,
        depth=np.where(seen, buffers["position"][..., 3:], np.float32(np.inf))[..., 0],
        records_position=records["position"],
        records_normal=records["normal"],
        records_irradiance=records["irradiance"],
        records_radius=records["radius"],
        stats=stats,
        backdrop=view.backdrop.kind,
    )


def _rgb(texture: moderngl.Texture) -> np.ndarray:
    return pixels(texture)[..., :3].copy()
