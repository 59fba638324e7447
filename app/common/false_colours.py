"""`irrsplat render --falsecolor`: false-colour pictures in photometric or radiometric units."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.core.files import Pathlike
from irrsplat.meter.light_scale import LightScale, brightest, round_above

if TYPE_CHECKING:
    from irrsplat.image.frame import Frame
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera

WORDS = {  # of the buffers FALSE_COLOURED in app/commands/render.py
    "light": "light on surfaces",
    "irradiance": "indirect light on surfaces",
    "image": "luminance",
    "direct": "direct light, reflected",
    "indirect": "indirect light, reflected",
    "emission": "emitted light",
}
_ON_SURFACES = ("light", "irradiance")  # lux or W/m²; for other buffers cd/m² or W/(m² sr)
_FLAGS = ("scale", "log", "unit", "lines")


def checked(args: argparse.Namespace) -> FalseColours | None:
    """Return the false colours for the flags, or None; raise InputError for incompatible flags."""
    if args.falsecolor is None:
        given = next((flag for flag in _FLAGS if getattr(args, flag) is not None), None)
        if given is not None:
            raise InputError(f"--{given} is for --falsecolor; give that as well")
        return None
    if not any(output.lower().endswith(".png") for output in args.output):
        raise InputError("--falsecolor is for a .png, and no output is one; give -o NAME.png")
    if args.scale is not None and not args.scale > 0.0:
        raise InputError(f"--scale is {args.scale:g}; give a number above 0, or leave it out for one by itself")
    decades = 2 if args.log is None else args.log
    scale = LightScale(args.unit or "lux", args.scale, args.log is not None, decades, args.lines != "off")
    return FalseColours(args.falsecolor, scale)


def save(
    coloured: FalseColours | None, name: str, frame: Frame, buffers: list[str] | None, renderer: Renderer, camera: Camera
) -> None:
    """Write a new frame of `renderer` from `camera`, in false colours for a .png; raise IrrsplatError for a failed write."""
    if coloured is not None and name.lower().endswith(".png"):
        coloured.save(name, frame, renderer, camera)
    else:
        frame.save(name, buffers)


@dataclass
class FalseColours:
    """False-colour pictures of `buffer` with `scale`; the first picture of a path sets an automatic end of the scale."""

    buffer: str
    scale: LightScale

    def save(self, path: Pathlike, frame: Frame, renderer: Renderer, camera: Camera) -> None:
        """Write a new frame of `renderer` from `camera` as a PNG; raise IrrsplatError for a failed write."""
        from irrsplat.image import false_colours

        light, depth = self.settle(frame, renderer, camera)
        picture = false_colours.coloured(light, depth, self.scale)
        picture = false_colours.with_legend(picture, self.scale, WORDS[self.buffer], self._unit)
        files.write_picture(path, picture)

    def settle(self, frame: Frame, renderer: Renderer, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """Return the frame's light and depth, (H, W) each; set an automatic end of the scale above the light."""
        direct = renderer.read_direct_irradiance(camera) if self.buffer == "light" else 0.0
        values: np.ndarray = getattr(frame, "irradiance" if self.buffer == "light" else self.buffer)
        light = (direct + values) @ self.scale.weights
        depth = frame.depth
        if self.buffer in ("image", "emission"):  # a visible sky counts as light
            depth = np.where(np.isfinite(depth) | (light > 0.0), np.minimum(depth, np.float32(1e9)), depth)
        if self.scale.highest is None:
            self.scale = replace(self.scale, highest=round_above(brightest(light[np.isfinite(depth)])))
        return light, depth

    @property
    def _unit(self) -> str:
        if self.buffer in _ON_SURFACES:
            return self.scale.shown_unit
        return "cd/m²" if self.scale.unit == "lux" else "W/(m² sr)"
