"""Description of the machine, and peak memory of a case."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Mapping
from contextlib import suppress

import moderngl

from irrsplat.app.common.version import version
from irrsplat.gpu.resource import Owner

_STATUS, _CLEAR = "/proc/self/status", "/proc/self/clear_refs"  # Linux: the peak of the resident set, and its reset
_BYTES = {"f1": 1, "f2": 2, "f4": 4, "u4": 4}  # per texture component, by dtype


def about(gl: Mapping[str, object]) -> dict[str, object]:
    """Return the machine for the benchmark's JSON; gl: result of `gpu.context.describe`."""
    return {
        **{key: gl[key] for key in ("renderer", "vendor", "version", "software")},
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
        "irrsplat": version(),
    }


def forget_peak() -> None:
    """Reset the peak of this process's memory, if the system can."""
    with suppress(OSError), open(_CLEAR, "w", encoding="ascii") as file:
        file.write("5")


def peak_memory() -> int | None:
    """Return the peak resident set in bytes since `forget_peak` or the start; None if unknown."""
    with suppress(OSError), open(_STATUS, encoding="ascii", errors="replace") as file:
        for line in file:
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    try:
        import resource
    except ImportError:  # Windows
        return None
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most


def gpu_memory(owner: Owner) -> int:
    """Return the bytes of the textures and buffers that a Renderer or another owner has on the GPU."""
    found = {id(it): it for it in owner.resources() if isinstance(it, (moderngl.Texture, moderngl.Buffer))}
    alive = (it for it in found.values() if not isinstance(it.mglo, moderngl.InvalidObject))  # not released
    return sum(it.size if isinstance(it, moderngl.Buffer) else _texture(it) for it in alive)


def _texture(texture: moderngl.Texture) -> int:
    width, height = texture.size
    size: int = width * height * texture.components * _BYTES.get(texture.dtype, 4)
    return size
