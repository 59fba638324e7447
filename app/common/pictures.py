"""How `irrsplat render` writes its files: bits of a PNG, names in an EXR, false colours, and the contact sheet."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

from irrsplat.app.common import false_colours
from irrsplat.app.common.false_colours import FalseColours
from irrsplat.core.errors import InputError

if TYPE_CHECKING:
    from irrsplat.image.frame import Frame
    from irrsplat.image.output.exr import ExrNames
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera

PNG_BITS = (8, 16)


@dataclass(frozen=True)
class Pictures:
    """How frames are written. png_bits: 8 or 16. exr_names: whose names an EXR's layers have. contact_sheet: whether a .png shows
    all buffers. coloured: the false colours of a .png, if any."""

    png_bits: int = 8
    exr_names: ExrNames = "irrsplat"
    contact_sheet: bool = False
    coloured: FalseColours | None = None

    @property
    def of_all_buffers(self) -> bool:
        """Whether a .png is made of more than the picture."""
        return self.contact_sheet or self.coloured is not None

    def save(self, name: str, frame: Frame, buffers: list[str] | None, renderer: Renderer, camera: Camera) -> None:
        """Write a frame that `renderer` has just made from `camera`; raises IrrsplatError where that fails."""
        if self.coloured is not None and name.lower().endswith(".png"):
            self.coloured.save(name, frame, renderer, camera)
        else:
            frame.save(name, buffers, png_bits=self.png_bits, exr_names=self.exr_names, contact_sheet=self.contact_sheet)


def checked(args: argparse.Namespace) -> Pictures:
    """What the flags ask for; raises InputError for flags that do not go together, or that no output is for."""
    endings = [output.lower().rpartition(".")[2] for output in args.output]
    if args.contact_sheet and "png" not in endings:
        raise InputError("--contact-sheet is for a .png, and no output is one; give -o NAME.png")
    if args.exr_names != "irrsplat" and "exr" not in endings:
        raise InputError("--exr-names is for an .exr, and no output is one; give -o NAME.exr")
    if args.falsecolor is not None and (args.contact_sheet or args.png_bits != PNG_BITS[0]):
        flag = "--contact-sheet" if args.contact_sheet else "--png-bits"
        raise InputError(f"--falsecolor and {flag} are two kinds of .png; give one of them")
    return Pictures(args.png_bits, args.exr_names, args.contact_sheet, false_colours.checked(args))
