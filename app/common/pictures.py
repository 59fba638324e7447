"""Output options of `irrsplat render`: PNG depth, EXR layer names, false colours, and the contact sheet."""

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
    """Output options of frames.

    png_bits: 8 or 16. exr_names: naming scheme of an EXR's layers. contact_sheet: True for a .png of all buffers. coloured:
    false colours of a .png, or None.
    """

    png_bits: int = 8
    exr_names: ExrNames = "irrsplat"
    contact_sheet: bool = False
    coloured: FalseColours | None = None

    @property
    def of_all_buffers(self) -> bool:
        """True if a .png needs more than the picture."""
        return self.contact_sheet or self.coloured is not None

    def save(self, name: str, frame: Frame, buffers: list[str] | None, renderer: Renderer, camera: Camera) -> None:
        """Write a new frame of `renderer` from `camera`; raise IrrsplatError for a failed write."""
        if self.coloured is not None and name.lower().endswith(".png"):
            self.coloured.save(name, frame, renderer, camera)
        else:
            frame.save(name, buffers, png_bits=self.png_bits, exr_names=self.exr_names, contact_sheet=self.contact_sheet)


def checked(args: argparse.Namespace) -> Pictures:
    """Return the options for the flags; raise InputError for incompatible or unused flags."""
    endings = [output.lower().rpartition(".")[2] for output in args.output]
    if args.contact_sheet and "png" not in endings:
        raise InputError("--contact-sheet is for a .png, and no output is one; give -o NAME.png")
    if args.exr_names != "irrsplat" and "exr" not in endings:
        raise InputError("--exr-names is for an .exr, and no output is one; give -o NAME.exr")
    if args.falsecolor is not None and (args.contact_sheet or args.png_bits != PNG_BITS[0]):
        flag = "--contact-sheet" if args.contact_sheet else "--png-bits"
        raise InputError(f"--falsecolor and {flag} are two kinds of .png; give one of them")
    return Pictures(args.png_bits, args.exr_names, args.contact_sheet, false_colours.checked(args))
