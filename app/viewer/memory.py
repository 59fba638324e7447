"""Free memory goes back to the system at once, so that the program does not grow with use."""

from __future__ import annotations

import ctypes
import sys

_MMAP_THRESHOLD, _LARGE = -3, 4 << 20  # glibc's number of the option; bytes: an array for every pixel of a small picture


def return_large_arrays() -> None:
    """Let each large array have pages of its own, which its end returns.

    glibc raises the least size of such arrays with every one that ends, up to 32 MB. Arrays of pictures then share a heap, which
    returns nothing below its last array.
    """
    if (option := getattr(_libc(), "mallopt", None)) is not None:
        option(_MMAP_THRESHOLD, _LARGE)


def trim() -> None:
    """Return what the heap has free, such as after a scene was closed."""
    if (give_back := getattr(_libc(), "malloc_trim", None)) is not None:
        give_back(0)


def _libc() -> ctypes.CDLL | None:
    return ctypes.CDLL(None) if sys.platform == "linux" else None
