"""A renderer's state and progress: immutable values, replaced from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass

from irrsplat.core.buffers import GBuffer, ShadowMaps, SplatBuffer
from irrsplat.image.view import Progress, View
from irrsplat.indirect.scheduler import ViewState
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings


@dataclass(frozen=True)
class Shown:
    """The last picture.

    inputs: all inputs except the records. time: of its end, seconds.
    """

    view: View
    inputs: tuple[object, ...]
    time: float


@dataclass(frozen=True)
class State:
    """The value of a renderer that changes from frame to frame.

    view: the progress of the present view. splat_seconds, picture_seconds: the times of splatting, and of the picture with direct
    light, in the last limited tick that had them. shown: None before the first picture.
    tile: pixels along a side of the tiles that pictures are drawn in; 0: they are drawn whole. tile_size: the caller's choice of
    it; None: tiles where they are needed.
    """

    scene: Scene
    settings: Settings
    preset: str
    size: tuple[int, int]
    view: ViewState = ViewState()
    splat_seconds: float = 0.0
    picture_seconds: float = 0.0
    shown: Shown | None = None
    tile: int = 0
    tile_size: int | None = None

    @property
    def view_subject(self) -> tuple[object, ...]:
        """All inputs except the camera that decide which records a view requests."""
        scene, settings = self.scene, self.settings
        criteria = (
            *settings.of("shadow", "gather", "splat"),
            settings.request_criteria,
            settings.placement,
            settings.warmup,
        )
        return self.size, scene.meshes, scene.lights, scene.sky_parts, criteria


@dataclass(frozen=True)
class Round:
    """The result of one round of a view, from which its picture is made.

    gbuffer, splats: None for a view in tiles, which draws both again for every tile. frozen: True if pixels without a record take
    the light of records alone.
    """

    camera: Camera
    shadows: ShadowMaps
    gbuffer: GBuffer | None
    splats: SplatBuffer | None
    progress: Progress
    frozen: bool = False
