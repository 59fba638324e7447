"""The renderers that `irrsplat bench --peers` sets beside each other. To add one, write a module for it and add a row here."""

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

Tell = Callable[[str], object]  # called with words on what goes on


@dataclass(frozen=True)
class Peer:
    """A renderer that takes part.

    name: in tables and messages. function: its measurement, as module:function beside this file; it is called with scene, size,
    bounces, views and a Tell, and yields a Series for each line of the plot, or raises IrrsplatError where it cannot take part.
    package: the Python package that it needs ("": none). note: a line below the title of the table ("": none).
    """

    name: str
    function: str
    package: str = ""
    note: str = ""

    @property
    def installed(self) -> bool:
        """Whether its package is here."""
        return not self.package or importlib.util.find_spec(self.package) is not None

    def measure(
        self, scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], tell: Tell
    ) -> Iterator[Series]:
        """What its function yields."""
        module, function = self.function.split(":")
        found: Iterator[Series] = getattr(import_module(f"{__package__}.{module}"), function)(scene, size, bounces, views, tell)
        return found


# in the order of the table; times are told as multiples of the first one's
PEERS: tuple[Peer, ...] = (
    Peer("irrsplat", "ours:measure"),
    Peer("Radiance", "radiance:measure", "pyradiance"),
    Peer(
        "Mitsuba",
        "mitsuba:measure_path",
        "mitsuba",
        "Mitsuba: its own integrator, `direct` for one bounce and `path` for more, on cosine-distributed rays from each pixel",
    ),
    Peer(
        "Mitsuba, lamps joined",
        "mitsuba:measure_joined",
        "mitsuba",
        "lamps joined: its rays in our own integrator (that of `verify`), which joins every vertex to what each lamp shines on",
    ),
)


def others() -> str:
    """The names of all others than ours, one for each package, for help and messages."""
    names: dict[str, str] = {}
    for peer in PEERS:
        if peer.package:
            names.setdefault(peer.package, peer.name)
    return " and ".join(names.values())
