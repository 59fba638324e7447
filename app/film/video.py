"""Films: pictures of a flight as .mp4, encoded by FFmpeg's libraries through PyAV.

Equal pictures give equal files. One thread encodes, colour conversion is exact, no date is written, and x264 uses no AVX-512:
its AVX-512 look-ahead reads uninitialized memory. Films are tagged with BT.709 primaries, sRGB's transfer curve, and BT.709's
matrix at limited range.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core import files, paths
from irrsplat.core.errors import InputError, IrrsplatError

INSTALL = "pip install 'irrsplat[video]'"
ENDINGS = (".mp4",)
RATE = 30.0  # pictures per second by default
_CRF = "18"  # of x264: the usual value without visible loss
_NO_AVX512 = {"x264-params": "asm=avx2"}  # every processor with AVX-512 has AVX2
_EXACT = "flags=bicubic+accurate_rnd+full_chroma_int+full_chroma_inp+bitexact"
_TO_YUV = f"{_EXACT}:in_range=full:out_range=limited:out_color_matrix=bt709"
_TAGS = 1, 13, 1, 1  # ITU-T H.273: BT.709's primaries, sRGB's curve, BT.709's matrix; limited range


def is_film(path: str) -> bool:
    return os.path.splitext(path)[1].lower() in ENDINGS


def check(path: str, flies: bool) -> None:
    """Raise InputError if the film `path` cannot be written or encoded. flies: True if a flight is given."""
    if not flies:
        raise InputError("a film needs a flight; give --path FILE", path)
    if "{frame" in path:
        raise InputError("a film holds all frames, so there is no {frame} in its name; leave it out", path)
    files.check_file(path)
    if find_spec("av") is None:
        raise InputError(f"to write films: {INSTALL}", path)


def write(path: str, pictures: Sequence[Path], rate: Fraction, on_share: Callable[[float], object] = lambda share: None) -> None:
    """Encode `pictures`, PNG files of one size in order, as the film `path`, completely or not at all.

    Odd sides are extended by their last column or row, since the codec requires even sides. rate: pictures per second.
    on_share: called with the completed share. Raises IrrsplatError for a picture of another size or format, and for failed
    writes.
    """
    files.write_file(path, lambda part: _encode(part, pictures, rate, on_share))


def _encode(part: Path, pictures: Sequence[Path], rate: Fraction, on_share: Callable[[float], object]) -> None:
    import av
    import av.filter

    height, width = _read(pictures[0]).shape[:2]
    options = {"fflags": "+bitexact", "movflags": "+faststart"}
    with av.open(str(part), "w", format="mp4", options=options) as file:
        kept_to = _NO_AVX512 if _has_avx512() else {}
        stream: Any = file.add_stream("libx264", rate=rate, options={"preset": "medium", "crf": _CRF, **kept_to})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        context = stream.codec_context
        context.thread_count = 1
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = _TAGS
        graph: Any = av.filter.Graph()
        source = graph.add_buffer(width=width, height=height, format="rgb24", time_base=1 / rate)
        scale, end = graph.add("scale", _TO_YUV), graph.add("buffersink")
        graph.link_nodes(source, scale, graph.add("format", "pix_fmts=yuv420p"), end).configure()
        for number, picture in enumerate(pictures):
            rgb = _read(picture)
            if rgb.shape != (height, width, 3):
                raise IrrsplatError(f"{picture}: a frame of another size than those before it; remove it to have it made anew")
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
            frame.pts, frame.time_base = number, 1 / rate
            graph.push(frame)
            file.mux(stream.encode(graph.pull()))
            on_share((number + 1) / len(pictures))
        file.mux(stream.encode(None))


def _has_avx512() -> bool:
    """True if numpy reports AVX-512 on this processor."""
    try:
        from numpy._core._multiarray_umath import __cpu_features__
    except ImportError:  # moved in another numpy version
        return False
    return bool(__cpu_features__.get("AVX512F"))


def _read(picture: Path) -> np.ndarray:
    """Return a PNG as (H, W, 3) uint8, with the last column or row of odd sides repeated."""
    from PIL import Image, UnidentifiedImageError

    paths.check_readable(picture, paths.MOST_GEOMETRY)
    try:
        with Image.open(picture) as image:
            rgb = np.asarray(image.convert("RGB"))
    except (OSError, ValueError, UnidentifiedImageError, SyntaxError) as error:
        raise IrrsplatError(f"{picture}: a damaged picture ({type(error).__name__}); remove it to have it made anew") from error
    return np.ascontiguousarray(np.pad(rgb, ((0, rgb.shape[0] % 2), (0, rgb.shape[1] % 2), (0, 0)), mode="edge"))
