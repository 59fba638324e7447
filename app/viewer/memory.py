"""Return of free memory to the system, so that the program's memory does not grow with use."""

from __future__ import annotations

import ctypes
import sys

_MMAP_THRESHOLD, _LARGE = -3, 4 << 20  # glibc's number of the option; bytes of a large array, about one array of a small picture


def return_large_arrays() -> None:
    """Allocate each large array in pages of its own, which return to the system when the array is freed.

    Without this call, glibc raises the least size of an array with own pages at each free, up to 32 MB. Smaller arrays share a
    heap, which returns no memory below its last array.
    """
    if (option := getattr(_libc(), "mallopt", None)) is not None:
        option(_MMAP_THRESHOLD, _LARGE)


def trim() -> None:
    """Return the free memory of the heap to the system, for example after a scene was closed."""
    if (give_back := getattr(_libc(), "malloc_trim", None)) is not None:
        give_back(0)


def _libc() -> ctypes.CDLL | None:
    return ctypes.CDLL(None) if sys.platform == "linux" else None
