"""Renderers of `irrsplat bench --peers`. To add one, write a module and add a row here."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irrsplat.app.bench.peers.judging import JudgedView, Series
    from irrsplat.scene.model import Scene
    from irrsplat.settings import All

Notify = Callable[[str], object]  # called with progress messages


@dataclass(frozen=True)
class Peer:
    """Renderer of the comparison.

    name: in tables and messages. function: its measurement as module:function in this folder. It takes scene, size, bounces,
    views and a Notify, and yields a Series per line of the plot, or raises IrrsplatError. package: required Python package, or
    "". note: a line below the title of the table, or "".
    """

    name: str
    function: str
    package: str = ""
    note: str = ""

    @property
    def installed(self) -> bool:
        """True if its package is installed."""
        return not self.package or importlib.util.find_spec(self.package) is not None

    def measure(
        self, scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
    ) -> Iterator[Series]:
        """Yield the series of its function."""
        module, function = self.function.split(":")
        found: Iterator[Series] = getattr(import_module(f"{__package__}.{module}"), function)(scene, size, bounces, views, notify)
        return found


# In the order of the table; times are multiples of the first row's
PEERS: tuple[Peer, ...] = (
    Peer("irrsplat", "ours:measure"),
    Peer("Radiance", "radiance:measure", "pyradiance"),
    Peer(
        "Mitsuba",
        "mitsuba:measure",
        "mitsuba",
        "Mitsuba: its rays in the integrator of `verify`, which connects each vertex to points that the lights illuminate;\n"
        "+ OIDN: these irradiances as a picture, by the fast and the high filter of Open Image Denoise, with the normals",
    ),
)


def others() -> str:
    """Return the names of all other renderers, for help and messages."""
    return " and ".join(peer.name for peer in PEERS if peer.package)
