"""Memory of a picture, and free memory of this process; both are compared before anything is allocated."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path

from irrsplat.core.buffers import CHANNELS
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings

LARGE = 1 << 22  # pixels, size from which a picture's memory is checked
PICTURE = frozenset(("image", "alpha"))
_READING = 28  # bytes a pixel, while one more buffer is read
_GROUPS = (  # files of a container: limit and usage
    ("memory.max", "memory.current"),
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
)


def view_bytes(scene: Scene, settings: Settings) -> int:
    """Return the bytes a pixel of a view during rendering: g-buffer, splat buffer, picture, samples."""
    gbuffer, splats, image, direct, summed = 68, 35, 20, 20, 24  # summed: temporally filtered, or with holes filled
    gbuffer += 16 if any(material.normal_texture for material in scene.materials) else 0
    gbuffer += 36 if any(material.filters for material in scene.materials) else 0
    if settings.samples > 1:
        return 2 * (gbuffer + splats + direct) + summed + image + 68
    refined = 64 if settings.quality else 0  # two more splat buffers and their comparison
    return gbuffer + splats + refined + summed + direct + image


def shortage(
    size: tuple[int, int], scene: Scene, settings: Settings, software: bool, buffers: Collection[str] | None, tile: int
) -> str:
    """Return the error if a picture of `size`, with `buffers` as arrays (None: all), certainly exceeds free memory; else "".

    GPU memory is not known: on a GPU only the arrays count. tile: pixels, side of the tiles that are drawn one by one; 0: draw
    the picture whole.
    """
    names = set(CHANNELS if buffers is None else buffers) & CHANNELS.keys()
    arrays = 4 * sum(CHANNELS[name].components for name in names)
    pixel = view_bytes(scene, settings) if software else 0
    if tile:
        drawn = min(1.25 * tile, max(size)) ** 2  # with the margin of a tile
        # 6 bytes a pixel while a .png is written
        need = size[0] * size[1] * (arrays + 6) + int(drawn) * (2 * pixel + _READING)
    else:
        need = size[0] * size[1] * (pixel + arrays + (0 if PICTURE.issuperset(names) else _READING))
    need += 450_000_000 if software else 0  # for gathers, surface cache, shadow maps and records, at any size
    free = available()
    if size[0] * size[1] < LARGE or free is None or need <= free:
        return ""
    found = f"size {size[0]}x{size[1]} needs {need / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free here"
    return f"{found}: take a smaller size" + ("" if PICTURE.issuperset(names) else ", or fewer buffers: a .png needs least")


def available() -> int | None:
    """Return the bytes that this process may still allocate without swapping, or None if unknown, as on systems other than Linux.

    The least of the machine's, the container's and the process's own limit.
    """
    found = list(_limits())
    return max(0, min(found)) if found else None


def _limits() -> Iterator[int]:
    """Yield the free bytes by each limit that this system has."""
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                yield 1024 * int(line.split()[1])
    for limit, taken in _GROUPS:
        with suppress(OSError, ValueError):  # "max", or no such file: no limit
            root = Path("/sys/fs/cgroup")
            yield int((root / limit).read_text()) - int((root / taken).read_text())
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource

        most, _ = resource.getrlimit(resource.RLIMIT_AS)  # of ulimit -v
        if most != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            yield most - pages * resource.getpagesize()
