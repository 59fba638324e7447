"""The backdrop of a picture: the sky that lights the scene, or a background that emits no light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.image.tonemap import tonemap
from irrsplat.lighting.sky import SkyMaps, sky_uniforms
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings

BackdropKind = Literal["sky", "grey", "black", "white", "clear"]
_BLACK, _WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# display values at the picture's lower and upper edge: medium tones of a well exposed picture
GREY = (0.22, 0.22, 0.22), (0.36, 0.36, 0.36)
_ENDS = {"grey": GREY, "black": (_BLACK, _BLACK), "white": (_WHITE, _WHITE), "clear": GREY}


@dataclass(frozen=True)
class Backdrop:
    """The background of a view. kind: sky or display colours; scene: the owner of the sky; maps: its sky maps.

    Only a sky is light. Other backdrops are in no buffer; the display composites them behind the picture by its coverage.
    """

    kind: BackdropKind = "sky"
    scene: Scene = Scene((), (), ())
    maps: SkyMaps | None = None

    def uniforms(self, camera: Camera, size: tuple[int, int]) -> Uniforms:
        """Return the uniforms of shaders/image/backdrop.glsl for a view of `size` (width, height)."""
        seen: Uniforms = {} if self.maps is None else {"sky_seen": self.maps.seen}
        where: Uniforms = {
            "sky_is_seen": int(self.kind == "sky"),
            "pixel_rays": pixel_rays(camera, size),
            "picture_corner": camera.corner(),
        }
        return {**sky_uniforms(self.scene, self.maps), **seen, **where}

    @property
    def sky_terms(self) -> int:
        """Complexity of the radiance: 0 none, 1 constant, 2 gradient by elevation, 3 map."""
        if self.kind != "sky":
            return 0
        if self.maps is not None:
            return 3
        return 2 if any(self.scene.sky_gradient) else int(any(self.scene.sky))

    def radiance(self, camera: Camera, size: tuple[int, int]) -> np.ndarray:
        """Return (H, W, 3) float32 sky radiance at every pixel's centre, top row first; 0 for other backdrops."""
        if self.kind != "sky":
            return np.zeros((size[1], size[0], 3), np.float32)
        left, bottom = camera.corner()
        x, y = np.meshgrid(np.arange(size[0]) + left + 0.5, np.arange(size[1])[::-1] + bottom + 0.5)
        ways = np.stack([x, y, np.ones_like(x)], -1) @ pixel_rays(camera, size).T
        away = np.linalg.norm(ways, axis=-1)
        solid = camera.pixel(size) ** 2 / away**3  # sr of a pixel; its rays have length 1 along the view axis
        return self.scene.sky_radiance(ways / away[..., None], solid).astype(np.float32)

    @property
    def ends(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Display colours of the lower and upper edge, 0..1; black for a sky."""
        return _ENDS.get(self.kind, (_BLACK, _BLACK))


def backdrop_of(scene: Scene, settings: Settings, maps: SkyMaps | None = None) -> Backdrop:
    """Return the backdrop of the setting `backdrop`; "auto" is the sky of a scene whose file has one, else grey."""
    kind = settings.backdrop
    if kind == "auto":
        kind = "sky" if scene.own_sky else "grey"
    return Backdrop(kind, scene, maps)  # type: ignore[arg-type]  # the setting's choices


def pixel_rays(camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Return the (3, 3) matrix from (x, y, 1), pixels from the whole picture's lower left corner, to ray directions in world
    space.

    The directions are not normalised. size: (width, height) drawn.
    """
    right, up, backward = camera.axes
    step, whole = camera.pixel(size), camera.whole(size)
    shift = np.asarray(camera.shift) * whole  # pixels of the picture
    corner = -backward - step * ((0.5 * whole[0] + shift[0]) * right + (0.5 * whole[1] + shift[1]) * up)
    return np.stack([step * right, step * up, corner], axis=1)


def display_picture(
    radiance: np.ndarray, exposure: float, alpha: np.ndarray, kind: BackdropKind, rows: tuple[int, int] | None = None
) -> np.ndarray:
    """Return (H, W, 3) sRGB-encoded 0..1 of (H, W, 3) radiance with coverage `alpha` (H, W) over the backdrop.

    A clear backdrop gives (H, W, 4) with straight alpha. exposure: stops. Radiance of partly covered pixels is premultiplied.
    rows: first row and height of the whole picture, if only some of its rows are given.
    """
    if kind == "sky":
        return tonemap(radiance, exposure)
    share = alpha[..., None]
    own = tonemap(radiance / np.where(share > 0.0, share, 1.0), exposure)
    if kind == "clear":
        return np.concatenate([own, share], axis=-1)
    low, high = np.asarray(_ENDS[kind])
    first, height = rows or (0, len(radiance))
    rise = ((np.arange(height)[::-1] + 0.5) / height)[first : first + len(radiance), None, None]
    behind = low + rise * (high - low)
    return np.asarray(share * own + (1.0 - share) * behind)
