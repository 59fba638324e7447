"""Float pictures as OpenEXR files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from irrsplat.core.files import check_exr


def write_layers(path: Path, layers: Mapping[str, np.ndarray], rows: int, header: Mapping[str, object] | None = None) -> None:
    """Write float32 layers with `rows` rows, and these attributes; raises OSError if the file is truncated."""
    import OpenEXR

    fixed = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File({**fixed, **(header or {})}, dict(layers)) as file:
        file.write(str(path))
    check_exr(path, rows)
