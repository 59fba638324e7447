"""Options of the view, and the open parts of the interface: plain values."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import Literal, cast

from irrsplat.meter.light_scale import LightScale

Split = Literal["off", "buffers", "presets"]
SPLITS: dict[Split, str] = {  # and their titles
    "off": "one picture",
    "buffers": "two buffers",
    "presets": "two presets",
}

Compare = Literal["divided", "flip", "difference"]
COMPARES: dict[Compare, str] = {  # how two sides are compared, and the titles
    "divided": "side by side",
    "flip": "one after the other",
    "difference": "difference",
}

SCALES = (0.75, 2.0)  # least and greatest of the interface
_SAVED = ("points", "discs", "normals", "sites", "wire")  # of ViewOptions, from one session to the next
_NOT_SAVED = ("help", "open", "save", "palette", "hidden")  # of Panels


@dataclass
class ViewOptions:
    """The buffers on show, the split, and overlays."""

    buffers: list[str] = field(default_factory=lambda: ["image", "irradiance"])  # of the left and of the right side
    split: Split = "off"
    compare: Compare = "divided"
    flipped: bool = False  # the right side is on show, where one is after the other
    divider: float = 0.5  # of the window's width
    points: bool = False
    discs: bool = False
    normals: bool = False
    sites: bool = False
    wire: bool = False
    inspect: bool = False
    profile: bool = False  # whether lines are measured along
    plane: bool = False  # whether a horizontal plane is measured
    why: bool = False  # whether a click on a surface shows where its light comes from
    frozen: bool = False
    light_scale: LightScale = LightScale()  # it is frozen


@dataclass
class Panels:
    """The open parts of the interface."""

    controls: bool = True  # the slim panel at the side; the picture is fitted into the rest, and fills the window without it
    settings: bool = False
    lights: bool = False
    outliner: bool = False
    hud: bool = False
    help: bool = False
    open: bool = False
    save: bool = False
    palette: bool = False
    hidden: bool = False


def scale_of(choices: dict[str, object]) -> float:
    """Return the scale of the interface from an earlier session; 1 if there is none within SCALES."""
    kept = choices.get("appearance")
    scale = kept.get("scale") if isinstance(kept, dict) else None
    valid = isinstance(scale, (int, float)) and not isinstance(scale, bool) and SCALES[0] <= scale <= SCALES[1]
    return float(cast(float, scale)) if valid else 1.0


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
