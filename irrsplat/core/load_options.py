"""What a caller of `load` decides about a file: which axis is up, which edges stay sharp, its time, and what sky it has."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Literal, get_args

from irrsplat.core.errors import InputError

UpAxis = Literal["auto", "x", "y", "z"]
UP_AXES: tuple[UpAxis, ...] = get_args(UpAxis)
CREASE_ANGLE = 40.0


@dataclass(frozen=True)
class LoadOptions:
    """How files are read.

    up_axis: which axis of the world points up; "auto": as the format or the file's exporter has it. crease_angle: degrees, 0 to
    180; where a file has no normals, edges between triangles that meet at less are smooth. time: seconds into the file's
    animation, 0 or more, at which it is posed; None: the stored pose. sky: what lights it from all around in place of its own sky
    or of what stands in, in the words that follow `sky` in a `.scene`; None: what the file has. allow: folders from which the
    scene may read files, beside its own.
    """

    up_axis: UpAxis = "auto"
    crease_angle: float = CREASE_ANGLE
    time: float | None = None
    sky: str | None = None
    allow: tuple[str | os.PathLike[str], ...] = ()

    def __post_init__(self) -> None:
        if self.up_axis not in UP_AXES:
            raise InputError(f"up_axis is one of {', '.join(UP_AXES)}, not {self.up_axis!r}")
        if not _within(self.crease_angle, 180.0):
            raise InputError(f"crease_angle lies between 0 and 180 degrees, not {self.crease_angle!r}")
        if self.time is not None and not _within(self.time, math.inf):
            raise InputError(f"time is a number of seconds, 0 or more, not {self.time!r}")
        if self.sky is not None and not isinstance(self.sky, str):
            raise InputError(f"sky is a text such as '1 1 1', 'studio.hdr' or 'cie overcast lux 10000', not {self.sky!r}")
        if not isinstance(self.allow, tuple):
            raise InputError(f"allow is a list of folders, not {self.allow!r:.60}")
        for one in self.allow:
            if not isinstance(one, (str, os.PathLike)) or not os.path.isdir(one):
                raise InputError(f"allow: there is no folder {str(one)!r:.60}; give one that is there")


def _within(value: object, most: float) -> bool:
    """Whether it is a finite number from 0 to `most`."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and 0.0 <= value <= most
