"""One view of the scene while it refines: the GPU handles of its buffers, how far it has come, and its frame on the CPU."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import moderngl
import numpy as np

from irrsplat.buffers import GBuffer, SplatBuffer
from irrsplat.gpu.target import pixels
from irrsplat.output import Frame
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings


@dataclass(frozen=True)
class View:
    """One round's picture as GPU handles, valid until the next round: what the viewer shows and `render` reads back.

    sums: (Σ k·E, Σ k) of which the picture is made, the splat buffer's own or smoothed; E is their quotient.
    """

    camera: Camera
    gbuffer: GBuffer
    direct: moderngl.Texture
    splats: SplatBuffer
    sums: moderngl.Texture
    image: moderngl.Texture


@dataclass(frozen=True)
class Progress:
    """Where a view stands after a tick: whole rounds so far, `records` in the cache, `new` among them, and `coverage` of the
    seen pixels, 0..1, at the round's begin. renewed: old records gathered again; stale: how many still wait for that.
    whole: False while sites of a round, or the pixels between every other one, are left over for the next tick. surface: how much
    of the surface cache is made, 0..1."""

    round: int
    records: int
    new: int
    coverage: float
    renewed: int = 0
    stale: int = 0
    whole: bool = True
    surface: float = 1.0

    @property
    def done(self) -> bool:
        """Whether nothing is left to gather in this view."""
        made = self.whole and self.surface == 1.0
        return made and not (self.new or self.renewed or self.stale) and self.coverage == 1.0


def read(view: View, sky: tuple[float, float, float], records: dict[str, np.ndarray], stats: dict[str, Any]) -> Frame:
    """The view as a Frame: every buffer copied, cleaned where nothing is seen, with the cache's records beside them."""
    buffers = {f.name: pixels(getattr(view.gbuffer, f.name)) for f in fields(GBuffer)}
    seen = buffers["position"][..., 3:] > 0.0
    position, normal, albedo, emission = (np.where(seen, b[..., :3], np.float32(0.0)) for b in buffers.values())
    sums = pixels(view.sums)
    irradiance = sums[..., :3] / np.where(sums[..., 3:] > 0.0, sums[..., 3:], np.float32(1.0))
    return Frame(
        image=pixels(view.image)[..., :3].copy(),
        direct=pixels(view.direct)[..., :3].copy(),
        indirect=albedo * irradiance / np.float32(np.pi),
        irradiance=irradiance,
        emission=np.where(seen, emission, np.asarray(sky, "f4")),
        weight=np.where(seen[..., 0], pixels(view.splats.weight)[..., 0], np.float32(0.0)),
        position=position,
        normal=normal,
        albedo=albedo,
        depth=np.where(seen, buffers["position"][..., 3:], np.float32(np.inf))[..., 0],
        records_position=records["position"],
        records_normal=records["normal"],
        records_irradiance=records["irradiance"],
        records_radius=records["radius"],
        stats=stats,
    )


def statistics(
    about: dict[str, Any], scene: Scene, size: tuple[int, int], preset: str, settings: Settings, exposure: float
) -> dict[str, Any]:
    """What a Frame's stats say of where, what and how: of the OpenGL context (`about`), scene and settings; exposure in stops."""
    return {
        "renderer": about["renderer"],
        "version": about["version"],
        "preset": preset,
        "settings": asdict(settings),
        "exposure": exposure,
        "size": list(size),
        "triangles": scene.triangles,
        "scene": scene.name,
    }
