"""Return of free memory to the system, so that the program's memory does not grow with use."""

from __future__ import annotations

import ctypes
from contextlib import suppress

_MMAP_THRESHOLD, _LARGE = -3, 4 << 20  # glibc's number of the option; bytes of a large array, about one array of a small picture
_NOT_GLIBC = (AttributeError, OSError, TypeError)  # the errors of another C library, and of Windows


def return_large_arrays() -> None:
    """Allocate each large array in pages of its own, which return to the system when the array is freed.

    Without this call, glibc raises the least size of an array with own pages at each free, up to 32 MB. Smaller arrays share a
    heap, which returns no memory below its last array.
    """
    with suppress(*_NOT_GLIBC):
        ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _LARGE)


def trim() -> None:
    """Return the free memory of the heap to the system, for example after a scene was closed."""
    with suppress(*_NOT_GLIBC):
        ctypes.CDLL(None).malloc_trim(0)
