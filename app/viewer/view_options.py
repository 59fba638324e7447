"""What is shown, what is drawn over it, and which windows of the interface are open: plain values that the interface changes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import Literal

Split = Literal["off", "buffers", "presets"]
SPLITS: dict[Split, str] = {"off": "one picture", "buffers": "two buffers", "presets": "two presets"}  # and their titles

_SAVED = ("points", "discs", "normals", "by_age", "sites", "wire")  # of ViewOptions, from one session to the next
_NOT_SAVED = ("help", "open", "hidden")  # of Panels


@dataclass
class ViewOptions:
    """What is shown, and what is drawn over it."""

    buffers: list[str] = field(default_factory=lambda: ["image", "irradiance"])  # of the left and of the right side
    split: Split = "off"
    divider: float = 0.5  # of the window's width
    points: bool = False
    discs: bool = False
    normals: bool = False
    by_age: bool = False
    sites: bool = False
    wire: bool = False
    inspect: bool = False
    frozen: bool = False


@dataclass
class Panels:
    """Which windows of the interface are open."""

    settings: bool = True
    lights: bool = False
    hud: bool = True
    help: bool = False
    open: bool = False
    hidden: bool = False


def saved(options: ViewOptions, panels: Panels) -> dict[str, object]:
    """The choices that are kept from one session to the next, plain JSON."""
    kept = {name: getattr(options, name) for name in _SAVED}
    return {"look": kept, "panels": {name: on for name, on in asdict(panels).items() if name not in _NOT_SAVED}}


def restore(choices: dict[str, object], options: ViewOptions, panels: Panels) -> None:
    """Set the choices of an earlier session, as `saved` gives them; what is not a choice is left out."""
    for name, target in (("look", options), ("panels", panels)):
        values = choices.get(name)
        for one in fields(target):
            value = values.get(one.name) if isinstance(values, dict) else None
            if isinstance(value, bool) and isinstance(getattr(target, one.name), bool):
                setattr(target, one.name, value)
