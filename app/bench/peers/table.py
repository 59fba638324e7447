"""Renderers of `irrsplat bench --peers`. To add one, write a module and add a row here."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

Notify = Callable[[str], object]  # called with progress messages


class Peer(NamedTuple):
    """Renderer of the comparison: its name, its module in this folder, and its required Python package, or "".

    The module's `measure` takes scene, size, bounces, views and a Notify. It yields a Series per line of the plot, or raises
    IrrsplatError. note: a line below the title of the table, or "".
    """

    name: str
    module: str
    package: str = ""
    note: str = ""


# In the order of the table; times are multiples of the first row's
PEERS: tuple[Peer, ...] = (
    Peer("irrsplat", "ours"),
    Peer("Radiance", "radiance", "pyradiance"),
    Peer(
        "Mitsuba",
        "mitsuba",
        "mitsuba",
        "Mitsuba: its rays in the integrator of `verify`, which connects each vertex to points that the lights illuminate;\n"
        "+ OIDN: these irradiances as a picture, by the fast and the high filter of Open Image Denoise, with the normals",
    ),
    Peer(
        "Cycles",
        "cycles",
        "bpy",
        "Cycles: the pass of indirect diffuse light, unclamped, at the centres of pixels; + OIDN as above",
    ),
)


def others() -> str:
    """Return the names of all other renderers, for help and messages."""
    *names, last = (peer.name for peer in PEERS if peer.package)
    return f"{', '.join(names)} and {last}"
