"""Buffers that are a texture of the view: a texel for every pixel, shown by one of a few small shaders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import (
    Canvas,
    Legend,
    ShownBuffer,
    ViewSource,
    colour_map,
    depth_at,
)
from irrsplat.app.viewer.show.screen import texel
from irrsplat.image.view import View
from irrsplat.scene.model import Camera, Scene

NO_TOLERANCE = -1.0  # which no weight is below


@dataclass(frozen=True)
class TextureBuffer(ShownBuffer):
    """A buffer whose value at a pixel is a texel's first components. texture: where it lies in a view.

    components: how many of the texel are the value. everywhere: whether it has a value where the camera sees nothing.
    """

    texture: Callable[[View], moderngl.Texture]
    components: int = 3
    everywhere: bool = False

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        depth = depth_at(source, x, y)
        if depth is None or (depth == 0.0 and not self.everywhere):
            return None
        return texel(self.texture(source.view), x, y)[: self.components]


@dataclass(frozen=True)
class RadianceBuffer(TextureBuffer):
    """Radiance, exposed and tone-mapped as the picture is; the backdrop's where the texture does not cover unseen pixels."""

    covers_unseen: Callable[[View], bool] = lambda view: True

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        view = source.view
        behind = view.backdrop.uniforms(view.camera, view.image.size)
        covers = self.covers_unseen(view)
        canvas.picture(source, "radiance", self.texture(view), covers_unseen=covers, gain=source.gain, **behind)

    def legend(self, source: ViewSource) -> Legend:
        return Legend(exposed(self.unit, source), unit=self.unit)


class ImageBuffer(RadianceBuffer):
    """The picture, before its backdrop."""

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        view = source.view
        lower, upper = view.backdrop.ends
        plain = view.backdrop.kind == "sky"
        canvas.picture(source, "image", view.image, alpha=view.alpha, plain=plain, lower=lower, upper=upper, gain=source.gain)


class IndirectBuffer(RadianceBuffer):
    """Indirect radiance: the mean of a pixel's samples, or, of the one at its centre, albedo/π times the irradiance there."""

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        view = source.view
        if view.indirect is not None:
            super().draw(canvas, source)
        else:
            canvas.picture(source, "indirect", view.sums, albedo=view.gbuffer.albedo, gain=source.gain)

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        view = source.view
        if view.indirect is not None:
            return super().value(source, x, y)
        if not depth_at(source, x, y):
            return None
        indirect: np.ndarray = irradiance_at(view, x, y) * texel(view.gbuffer.albedo, x, y)[:3] / np.float32(np.pi)
        return indirect


@dataclass(frozen=True)
class IrradianceBuffer(ShownBuffer):
    """Irradiance as a white surface reflects it, so that it compares with the picture; its texture holds Σ k·E and Σ k.

    texture: of a view; None before it is made, when the legend is `missing`. state: what the texture is made of, for a memo.
    about: further words for the legend.
    """

    texture: Callable[[ViewSource], moderngl.Texture | None] = lambda source: source.view.sums
    missing: str = ""
    state: Callable[[ViewSource], object] = lambda source: None
    about: Callable[[ViewSource], str] = lambda source: ""
    needs_reference: bool = False

    def inputs(self, source: ViewSource) -> object:
        return self.state(source)

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        found = self.texture(source)
        if found is None:
            draw_requests(canvas, source, NO_TOLERANCE)  # the dim picture
        else:
            canvas.picture(source, "irradiance", found, gain=source.gain)

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        found = self.texture(source) if depth_at(source, x, y) else None
        sums = None if found is None else texel(found, x, y)
        return None if sums is None or (sums[3] == 0.0 and self.missing) else mean_of(sums)

    def legend(self, source: ViewSource) -> Legend:
        if self.texture(source) is None:
            return Legend(self.missing)
        return Legend(f"{exposed(self.unit, source)}, as a white surface sends it out{self.about(source)}", unit=self.unit)


@dataclass(frozen=True)
class ShareBuffer(TextureBuffer):
    """Values 0..1, sRGB encoded. text: of the legend."""

    text: str = "share of the pixel"

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        canvas.picture(source, "unit", self.texture(source.view), grey=self.components == 1)

    def legend(self, source: ViewSource) -> Legend:
        return Legend(self.text, "0", "1")


@dataclass(frozen=True)
class VectorBuffer(TextureBuffer):
    """Vectors, x y z as red, green and blue between two ends. ends: low and high (3,) in a scene. note: what they are."""

    ends: Callable[[Scene], np.ndarray] = lambda scene: np.array([[-1.0] * 3, [1.0] * 3])
    note: str = ""

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        low, high = self.ends(source.scene)
        canvas.picture(source, "range", self.texture(source.view), low=low, high=np.where(high > low, high, low + 1.0))

    def legend(self, source: ViewSource) -> Legend:
        axes, unit = (1, "") if self.unit == "1" else (3, self.unit)
        far = any(source.origin) and axes == 3
        ends = self.ends(source.scene) + source.origin if far else self.ends(source.scene)
        low, high = (" ".join(f"{v:.2f}" if far else f"{v:.3g}" for v in end[:axes]) for end in ends)
        return Legend("x y z as red, green, blue" + self.note, low, high, unit)


class DepthBuffer(TextureBuffer):
    """The distance along the view axis, which the position's texels hold as their fourth component."""

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        low, high = depth_range(source.scene, source.view.camera)
        canvas.picture(source, "depth", self.texture(source.view), low=low, high=high)

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        depth = depth_at(source, x, y)
        return None if depth is None else np.array([depth or np.inf], "f4")

    def legend(self, source: ViewSource) -> Legend:
        low, high = depth_range(source.scene, source.view.camera)
        return Legend("distance along the view axis", f"{low:.3g}", f"{high:.3g}", self.unit, colour_map())


def draw_requests(canvas: Canvas, source: ViewSource, tolerance: float) -> None:
    """Draw the picture dim and grey, and orange over it the pixels that request a record at this tolerance."""
    splats = source.view.splats
    canvas.picture(
        source,
        "asking",
        splats.weight,
        image=source.view.image,
        gain=source.gain,
        sums=splats.sums,
        tolerance=tolerance,
        spread=source.settings.spread,
        luminance_floor=splats.luminance_floor,
    )


def irradiance_at(view: View, x: int, y: int) -> np.ndarray:
    """Return (3,) irradiance in W/m² that the picture shows at pixel (x, y) of the view; 0 where no record contributes."""
    return mean_of(texel(view.sums, x, y))


def mean_of(sums: np.ndarray) -> np.ndarray:
    """Return (3,) Σ k·E / Σ k of a texel; 0 for Σ k = 0."""
    mean: np.ndarray = sums[:3] / (sums[3] if sums[3] > 0.0 else np.float32(1.0))
    return mean


def exposed(unit: str, source: ViewSource) -> str:
    return f"{unit}, exposed by {source.exposure:+.1f} stops"


def depth_range(scene: Scene, camera: Camera) -> tuple[float, float]:
    """The least and the greatest distance along the view axis, in metres, that anything within the scene's bounds can have."""
    along = (scene.corners - np.asarray(camera.eye)) @ -camera.axes[2]
    low, high = max(float(along.min()), 0.0), float(along.max())
    return low, high if high > low else low + scene.diagonal
