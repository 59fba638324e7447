"""Films: pictures of a flight as .mp4, .webm or .gif, encoded by FFmpeg's libraries through PyAV.

Equal pictures give equal files. One thread encodes, colour conversion is exact, no date is written, and x264 uses no AVX-512:
its AVX-512 look-ahead reads uninitialized memory. Films are tagged with BT.709 primaries, sRGB's transfer curve, and BT.709's
matrix at limited range.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irrsplat.app.film.words import QUALITIES
from irrsplat.core import files, paths
from irrsplat.core.errors import InputError, IrrsplatError

if TYPE_CHECKING:
    import av

INSTALL = "pip install 'irrsplat[video]'"


@dataclass(frozen=True)
class _Codec:
    """FFmpeg parameters of one film format.

    crf: for each of QUALITIES, lower is better; empty without this parameter. even: True for even sides. options: of the
    encoder; file_options: of the container.
    """

    name: str
    pixels: str
    crf: tuple[int, ...]
    even: bool
    options: dict[str, str]
    file_options: dict[str, str]


_BY_ENDING = {
    ".mp4": _Codec("libx264", "yuv420p", (27, 18, 12), True, {"preset": "medium"}, {"movflags": "+faststart"}),
    ".webm": _Codec("libvpx-vp9", "yuv420p", (40, 28, 18), False, {"b": "0", "deadline": "good", "cpu-used": "3"}, {}),
    ".gif": _Codec("gif", "pal8", (), False, {}, {"loop": "0"}),
}
ENDINGS = tuple(_BY_ENDING)
_NO_AVX512 = {"x264-params": "asm=avx2"}  # every processor with AVX-512 has AVX2
_EXACT = "flags=bicubic+accurate_rnd+full_chroma_int+full_chroma_inp+bitexact"
_TO_YUV = f"{_EXACT}:in_range=full:out_range=limited:out_color_matrix=bt709"
_TAGS = 1, 13, 1, 1  # ITU-T H.273: BT.709's primaries, sRGB's curve, BT.709's matrix; limited range
_DITHER = ("none", "bayer:bayer_scale=5", "floyd_steinberg")  # of a GIF, by quality; stronger dithering is visible as dots


@dataclass(frozen=True)
class Encoding:
    """Encoding of a film: pictures per second, and one of QUALITIES."""

    rate: Fraction = Fraction(30)
    quality: str = "good"


def is_film(path: str) -> bool:
    """True if an output's ending is that of a film."""
    return os.path.splitext(path)[1].lower() in ENDINGS


def check(path: str, flies: bool) -> None:
    """Raise InputError if the film `path` cannot be written or encoded. flies: True if a flight is given."""
    if not flies:
        raise InputError("a film needs a flight; give --path FILE or --turntable N", path)
    if "{frame" in path:
        raise InputError("a film holds all frames, so there is no {frame} in its name; leave it out", path)
    files.check_file(path)
    if find_spec("av") is None:
        raise InputError(f"to write films: {INSTALL}", path)


def write(
    path: str, pictures: Sequence[Path], encoding: Encoding, on_share: Callable[[float], object] = lambda share: None
) -> None:
    """Encode `pictures`, PNG files of one size in order, as the film `path`, completely or not at all.

    Odd sides are extended by their last column or row if the codec requires it. on_share: called with the completed share.
    Raises IrrsplatError for a picture of another size or format, and for failed writes.
    """
    codec = _BY_ENDING[os.path.splitext(path)[1].lower()]
    files.write_file(path, lambda part: _encode(part, pictures, codec, encoding, on_share))


def _encode(part: Path, pictures: Sequence[Path], codec: _Codec, encoding: Encoding, on_share: Callable[[float], object]) -> None:
    import av

    quality = QUALITIES.index(encoding.quality)
    passes = 1 if codec.crf else 2  # the first pass of a GIF finds its 256 colours
    done = 0

    def frames() -> Iterator[av.VideoFrame]:
        nonlocal done
        size = None
        for number, picture in enumerate(pictures):
            rgb = _read(picture, codec.even)
            if rgb.shape != (size or rgb.shape):
                raise IrrsplatError(f"{picture}: a frame of another size than those before it; remove it to have it made anew")
            size = rgb.shape
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
            frame.pts, frame.time_base = number, 1 / encoding.rate
            done += 1
            on_share(done / (passes * len(pictures)))
            yield frame

    height, width = _read(pictures[0], codec.even).shape[:2]
    make = _converted if codec.crf else _with_palette
    with av.open(str(part), "w", options={"fflags": "+bitexact", **codec.file_options}) as file:
        crf = {"crf": str(codec.crf[quality])} if codec.crf else {}
        kept_to = _NO_AVX512 if codec.name == "libx264" and _has_avx512() else {}
        stream: Any = file.add_stream(codec.name, rate=encoding.rate, options={**codec.options, **crf, **kept_to})
        stream.width, stream.height, stream.pix_fmt = width, height, codec.pixels
        context = stream.codec_context
        context.thread_count = 1
        if codec.crf:
            context.color_primaries, context.color_trc, context.colorspace, context.color_range = _TAGS
        for frame in make(frames, (width, height), encoding, codec.pixels, _DITHER[quality]):
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))


def _has_avx512() -> bool:
    """True if numpy reports AVX-512 on this processor."""
    try:
        from numpy._core._multiarray_umath import __cpu_features__
    except ImportError:  # moved in another numpy version
        return False
    return bool(__cpu_features__.get("AVX512F"))


def _read(picture: Path, even: bool) -> np.ndarray:
    """Return a PNG as (H, W, 3) uint8; `even`: repeat the last column or row of odd sides."""
    from PIL import Image, UnidentifiedImageError

    paths.check_readable(picture, paths.MOST_GEOMETRY)
    try:
        with Image.open(picture) as image:
            rgb = np.asarray(image.convert("RGB"))
    except (OSError, ValueError, UnidentifiedImageError, SyntaxError) as error:
        raise IrrsplatError(f"{picture}: a damaged picture ({type(error).__name__}); remove it to have it made anew") from error
    if even:
        rgb = np.pad(rgb, ((0, rgb.shape[0] % 2), (0, rgb.shape[1] % 2), (0, 0)), mode="edge")
    return np.ascontiguousarray(rgb)


def _graph(size: tuple[int, int], rate: Fraction) -> tuple[Any, Any]:
    """Return a filter graph and its source of RGB frames."""
    import av.filter

    graph: Any = av.filter.Graph()
    source = graph.add_buffer(width=size[0], height=size[1], format="rgb24", time_base=1 / rate)
    return graph, source


def _converted(
    frames: Callable[[], Iterator[av.VideoFrame]], size: tuple[int, int], encoding: Encoding, pixels: str, dither: str
) -> Iterator[av.VideoFrame]:
    """Yield the frames in the codec's pixel format."""
    graph, source = _graph(size, encoding.rate)
    scale, end = graph.add("scale", _TO_YUV), graph.add("buffersink")
    form = graph.add("format", f"pix_fmts={pixels}")
    graph.link_nodes(source, scale, form, end).configure()
    for frame in frames():
        graph.push(frame)
        yield graph.pull()


def _with_palette(
    frames: Callable[[], Iterator[av.VideoFrame]], size: tuple[int, int], encoding: Encoding, pixels: str, dither: str
) -> Iterator[av.VideoFrame]:
    """Yield the frames in a common palette of 256 colours."""
    graph, source = _graph(size, encoding.rate)
    chosen, end = graph.add("palettegen", "stats_mode=full:reserve_transparent=0"), graph.add("buffersink")
    graph.link_nodes(source, chosen, end).configure()
    for frame in frames():
        graph.push(frame)
    graph.push(None)
    palette = graph.pull()

    graph, source = _graph(size, encoding.rate)
    colours = graph.add_buffer(
        width=palette.width, height=palette.height, format=palette.format.name, time_base=1 / encoding.rate
    )
    use, end = graph.add("paletteuse", f"dither={dither}"), graph.add("buffersink")
    source.link_to(use, 0, 0)
    colours.link_to(use, 0, 1)
    use.link_to(end, 0, 0)
    graph.configure()
    palette.pts = 0
    colours.push(palette)
    colours.push(None)
    for frame in frames():
        source.push(frame)
        yield from _pulled(end)
    source.push(None)
    yield from _pulled(end)


def _pulled(end: Any) -> Iterator[av.VideoFrame]:
    """Yield the frames available from a filter graph."""
    import av.error

    while True:
        try:
            yield end.pull()
        except (av.error.BlockingIOError, av.error.EOFError):
            return
