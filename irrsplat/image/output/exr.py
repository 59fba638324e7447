"""A frame as OpenEXR: a layer per buffer, with camera and settings as attributes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.files import check_exr, json_text
from irrsplat.image import statistics
from irrsplat.scene.model import Camera

_NEAR, _DISTANT = 1e-3, 1e3  # near and far of worldToNDC: no pixel depends on them


def write_layers(path: Path, layers: Mapping[str, np.ndarray], rows: int, header: Mapping[str, object] | None = None) -> None:
    """Write float32 layers with `rows` rows, and these attributes; raises OSError if the file is truncated."""
    import OpenEXR

    fixed = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File({**fixed, **(header or {})}, dict(layers)) as file:
        file.write(str(path))
    check_exr(path, rows)


def attributes(stats: statistics.Statistics, camera: Camera | None, aspect: float) -> dict[str, Any]:
    """Return the header's attributes, equal for equal runs.

    stats: the statistics as JSON text. irrsplat:NAME: each setting, a number or text. software: irrsplat's version. With a
    camera also OpenEXR's standard attributes, see `of_camera`.
    """
    kept = statistics.repeatable(stats)
    found: dict[str, Any] = {"stats": json_text(kept), "software": f"irrsplat {_version()}"}
    if "preset" in kept:
        found["irrsplat:preset"] = str(kept["preset"])
    settings = kept.get("settings")
    for name, value in settings.items() if isinstance(settings, Mapping) else ():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        found[f"irrsplat:{name}"] = (
            float(value) if number else ("on" if value else "off") if isinstance(value, bool) else str(value)
        )
    if camera is not None:
        found |= of_camera(camera, aspect)
    return found


def of_camera(camera: Camera, aspect: float) -> dict[str, Any]:
    """Return a camera as OpenEXR's standard attributes. aspect: width by height of the picture.

    worldToCamera: to right-handed camera space, along −z, y up, metres; worldToNDC: x and y −1..1 over the picture, y up, after
    division by w. Both are for row vectors, as in Imath: translation in the last row. screenWindowCenter and screenWindowWidth:
    of the picture at distance 1.
    """
    view = camera.view_from_world
    clip = camera.clip_from_view(aspect, _NEAR, _DISTANT) @ view
    return {
        "worldToCamera": np.ascontiguousarray(view.T, np.float32),
        "worldToNDC": np.ascontiguousarray(clip.T, np.float32),
        "screenWindowCenter": np.zeros(2, np.float32),
        "screenWindowWidth": float(camera.screen * aspect),
        "pixelAspectRatio": 1.0,
    }


def _version() -> str:
    from importlib import metadata  # takes 20 ms

    try:
        return metadata.version("irrsplat")
    except metadata.PackageNotFoundError:
        return ""
