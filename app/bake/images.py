"""Pictures of light: a 16-bit PNG, which holds what the eye tells apart, and an EXR with W/m² as they are."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from irrsplat.core.files import check_exr

_UP = 2  # PNG's filter that keeps differences from the row above, which light has few of


def png(values: np.ndarray) -> bytes:
    """A PNG of 16 bits a channel of display values 0..1 (H, W, 3). Pillow writes 8 bits of colour, no more."""
    height, width, _ = values.shape
    rows = np.round(np.clip(values, 0.0, 1.0) * 65535.0).astype(">u2").reshape(height, -1).view(np.uint8)
    rows = np.diff(rows, axis=0, prepend=np.zeros((1, rows.shape[1]), np.uint8))  # modulo 256
    filtered = np.concatenate([np.full((height, 1), _UP, np.uint8), rows], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"sRGB", b"\0"), (b"IDAT", zlib.compress(filtered.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def write_exr(path: Path, layers: Mapping[str, np.ndarray]) -> None:
    """Write layers (H, W, 3) of float32 into an EXR; raises OSError where it is cut short."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = {name: np.ascontiguousarray(values, np.float32) for name, values in layers.items()}
    with OpenEXR.File(header, pixels) as file:
        file.write(str(path))
    check_exr(path, len(next(iter(layers.values()))))
