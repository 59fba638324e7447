"""Description of the machine."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping

from irrsplat import __version__


def about(gl: Mapping[str, object]) -> dict[str, object]:
    """Return the machine for the benchmark's JSON; gl: result of `gpu.context.describe`."""
    return {
        **{key: gl[key] for key in ("renderer", "vendor", "version", "software")},
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
        "irrsplat": __version__,
    }
