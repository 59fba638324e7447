"""Free memory of this process."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

_GROUPS = (  # files of a container: limit and usage
    ("memory.max", "memory.current"),
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
)


def available() -> int | None:
    """Return the bytes that this process may still allocate without swapping, or None if unknown, as on systems other than Linux.

    The least of the machine's, the container's and the process's own limit.
    """
    found = [*_machine(), *_container(), *_process()]
    return max(0, min(found)) if found else None


def _machine() -> list[int]:
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return [1024 * int(line.split()[1])]
    return []


def _container() -> list[int]:
    found = []
    for limit, taken in _GROUPS:
        with suppress(OSError, ValueError):  # "max", or no such file: no limit
            root = Path("/sys/fs/cgroup")
            found.append(int((root / limit).read_text()) - int((root / taken).read_text()))
    return found


def _process() -> list[int]:
    """Return the unused part of the limit of ulimit -v."""
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            return [limit - pages * resource.getpagesize()]
    return []
