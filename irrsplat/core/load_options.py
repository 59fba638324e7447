"""The options of `load`: up axis, smoothing, sky and units."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Literal, get_args

from irrsplat.core.errors import InputError

UpAxis = Literal["auto", "x", "y", "z"]
UP_AXES: tuple[UpAxis, ...] = get_args(UpAxis)
CREASE_ANGLE = 40.0


@dataclass(frozen=True)
class LoadOptions:
    """The options of reading a file.

    up_axis: world axis that points up; "auto": by format or exporter. crease_angle: degrees, 0 to 180; without normals in the
    file, edges between triangles that meet at a smaller angle are smooth. sky: replaces the sky of the file or its substitute, in
    the words after `sky` in a `.scene`; None: the file's. allow: folders from which the scene may read files, in addition to its
    own. photometric: True if light in glTF files is in candela, lux and cd/m²; False: in W/sr, W/m² and W/(m² sr).
    """

    up_axis: UpAxis = "auto"
    crease_angle: float = CREASE_ANGLE
    sky: str | None = None
    allow: tuple[str | os.PathLike[str], ...] = ()
    photometric: bool = False

    def __post_init__(self) -> None:
        if self.up_axis not in UP_AXES:
            raise InputError(f"up_axis is one of {', '.join(UP_AXES)}, not {self.up_axis!r}")
        if not isinstance(self.photometric, bool):
            raise InputError(f"photometric is True or False, not {self.photometric!r:.60}")
        angle: object = self.crease_angle
        if not isinstance(angle, (int, float)) or isinstance(angle, bool) or not 0.0 <= angle <= 180.0:
            raise InputError(f"crease_angle lies between 0 and 180 degrees, not {self.crease_angle!r}")
        if self.sky is not None and not isinstance(self.sky, str):
            raise InputError(f"sky is a text such as '1 1 1', 'studio.hdr' or 'cie overcast lux 10000', not {self.sky!r}")
        if not isinstance(self.allow, tuple):
            raise InputError(f"allow is a list of folders, not {self.allow!r:.60}")
        for one in self.allow:
            if not isinstance(one, (str, os.PathLike)) or not os.path.isdir(one):
                raise InputError(f"allow: there is no folder {str(one)!r:.60}; give one that is there")
