"""Every parameter of the method, declared once: name, default, range, unit, stage and one line of help.

The class Settings defines the flags of the command line, the sliders of the viewer, the table of docs/reference.md and the
checks. SettingValues repeats the names and types, because type checkers need them spelled out. A test compares the two classes.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any, Literal, TypedDict, Unpack, cast

from irrsplat.core.errors import InputError, did_you_mean

Auto = Literal["auto"]
All = Literal["all"]
Value = bool | int | float | str  # of one setting
Kind = Literal["bool", "choice", "int", "float"]

MOST_ROUNDS = 1000  # rounds after which a render or a bake stops with a notice
LEAST_TILE, MOST_TILE = 16, 4096  # pixels along a side of the tiles that a picture is drawn in

# constants of the weight, equal in shaders/records/weight.glsl and on the CPU
LEAST_ERROR = 1e-3  # lower bound of the error e, so that w = 1/e stays finite
IN_FRONT = 0.05  # of R: greatest distance of a record from the tangent plane of a pixel, on either side

WIDE = 3.0  # times R_k: greatest radius of a record; dark, narrow places must not cover distant surfaces


@dataclass(frozen=True)
class Declaration:
    """Description of one setting, without its value.

    word: a legal value that is no number, such as ``auto``; empty for none.
    """

    name: str
    kind: Kind
    default: Value
    help: str
    stage: str
    low: float | None = None
    high: float | None = None
    unit: str = ""
    word: str = ""
    choices: tuple[str, ...] = ()

    @property
    def flag(self) -> str:
        """The command line's spelling, such as ``--gather-size``."""
        return "--" + self.name.replace("_", "-")

    @property
    def words(self) -> tuple[str, ...]:
        """The legal values that are words, such as ``auto``."""
        return ("on", "off") if self.kind == "bool" else self.choices or ((self.word,) if self.word else ())

    @property
    def range(self) -> str:
        """The legal values in words, such as ``0..1`` or ``on|off``."""
        if self.kind == "bool":
            return "on|off"
        if self.kind == "choice":
            return "|".join(self.choices)
        span = f"{self.low:.10g}..{self.high:.10g}" + (f" {self.unit}" if self.unit else "")
        return f"{span} or {self.word}" if self.word else span

    def parse(self, text: str) -> Value:
        """Return the value of `text`. Raises InputError with the legal range for a text without a value."""
        word = text.strip().lower()
        if word in self.words:
            return self.check(word)
        if self.kind in ("int", "float"):
            with suppress(ValueError):
                return self.check(int(word) if self.kind == "int" else float(word))
        hint = _removed_choice(self.name, word) or did_you_mean(word, self.words)
        raise InputError(f"{self.flag} takes {self.range}, not '{text}'{hint}")

    def check(self, value: object) -> Value:
        """Return `value` in the type of this setting. Raises InputError for another type, and for a value out of range."""
        if getattr(value, "ndim", None) == 0:  # a number of NumPy, whose bool is none of Python's
            value = value.item()  # type: ignore[attr-defined]
        if isinstance(value, str):
            if self.word and value == self.word:
                return value
            if self.kind == "choice" and value in self.choices:
                return value
            if self.kind == "bool" and value in ("on", "off"):
                return value == "on"
        elif isinstance(value, bool):
            if self.kind == "bool":
                return value
        elif isinstance(value, numbers.Integral) and self.kind == "int":
            if self._in_range(int(value)):
                return int(value)
        elif isinstance(value, numbers.Real) and self.kind == "float" and math.isfinite(value) and self._in_range(float(value)):
            return float(value)
        raise InputError(f"setting '{self.name}' takes {self.range}, not {value!r}{_removed_choice(self.name, value)}")

    def _in_range(self, value: float) -> bool:
        return self.low is None or self.high is None or self.low <= value <= self.high


def _declare(default: Any, kind: Kind, stage: str, help: str, **rest: Any) -> Any:
    return field(default=default, metadata={"default": default, "kind": kind, "stage": stage, "help": help, **rest})


@dataclass(frozen=True)
class Settings:
    """A complete set of valid parameters. `replace` and `with_values` return changed copies."""

    # the order of the stages is the order of the frame
    shadow_size: int = _declare(
        1024,
        "int",
        "shadow",
        "side of one shadow map tile; a point light has six, the sun of a vast scene up to four",
        low=16,
        high=4096,
        unit="texels",
    )
    seed: int = _declare(0, "int", "gather", "seed of all random numbers; equal seeds give equal bits", low=0, high=2**31 - 1)
    bounces: int | All = _declare(
        "all",
        "int",
        "gather",
        "indirect bounces; 0: direct light alone; all: until further bounces add almost nothing",
        low=0,
        high=64,
        word="all",
    )
    gather: str = _declare(
        "auto", "choice", "gather", "sampling of a record's hemisphere: one plane of 150°, or rays traced by shaders or by "
        "Embree; auto: rays, by Embree with software OpenGL",
        choices=("auto", "plane", "trace", "embree"),
    )  # fmt: skip
    gather_size: int = _declare(
        64,
        "int",
        "gather",
        "side of a record's plane in pixels, or square root of its number of rays; 128 is nearly exact",
        low=4,
        high=256,
        unit="pixels",
    )
    light_samples: int = _declare(
        512, "int", "gather", "next-event estimation: shadow rays of a record to emissive surfaces, and at most as many to "
        "virtual point lights near lights; 0: off", low=0, high=4096,
    )  # fmt: skip
    gradients: bool = _declare(True, "bool", "splat", "records store the derivatives of irradiance by position and normal")
    weights: str = _declare(
        "hessian", "choice", "splat", "weights and radii of records. paper: by distance, cut off at 1/a. hessian: "
        "anisotropic radii by the second derivatives of light, and weights that fall to 0 at the rim",
        choices=("paper", "hessian"),
    )  # fmt: skip
    a: float = _declare(
        0.6,
        "float",
        "splat",
        "a record reaches as far as a·R; a smaller value gives more records and less error",
        low=0.01,
        high=2,
    )
    adapt: float = _declare(
        0.6, "float", "splat", "relative difference between neighbouring records above which their radii shrink; 0: off",
        low=0, high=10,
    )  # fmt: skip
    radius_min: float = _declare(
        0.5, "float", "splat", "least radius a·R of a splat on screen, in percent of the image height; for a strip, in "
        "percent of the side of a square with as many pixels", low=0, high=50, unit="%",
    )  # fmt: skip
    radius_max: float = _declare(
        7.0, "float", "splat", "greatest radius a·R of a splat on screen, in the unit of radius_min; 0: no limit",
        low=0, high=100, unit="%",
    )  # fmt: skip
    tolerance: float | Auto = _declare(  # "auto" is resolved by `threshold`
        "auto", "float", "examine", "Σw below which a pixel requests a record; auto: 1/a", low=0.001, high=1e6, word="auto"
    )
    spread: float = _declare(
        0.05, "float", "examine", "inter-record variance above which a pixel requests a record, as standard deviation over "
        "mean; 0: off", low=0, high=10,
    )  # fmt: skip
    placement: str = _declare(
        "tiles", "choice", "examine", "placement of records. tiles: coarse to fine. scan: the paper's random warm-up "
        "and scan order",
        choices=("tiles", "scan"),
    )  # fmt: skip
    warmup: int = _declare(
        1000, "int", "examine", "number of random records before the scan; placement scan only", low=0, high=100_000
    )
    max_records: int = _declare(
        200_000, "int", "examine", "greatest number of records; a full cache drops the records that were out of view for longest",
        low=100, high=4_000_000,
    )  # fmt: skip
    blend: float = _declare(
        0.5, "float", "composite", "0: direct light alone; 0.5: the physical sum; 1: indirect light alone", low=0, high=1
    )
    fill_holes: bool = _declare(
        True, "bool", "composite", "pixels without a record show the light around them until a record covers them"
    )
    samples: int = _declare(
        1, "int", "composite", "subpixel samples of each pixel of a render; 1: the centre of the pixel alone",
        low=1, high=65536,
    )  # fmt: skip
    quality: float = _declare(
        0.0, "float", "composite", "estimated error at which a render ends, in percent of the mean indirect light; 0: it ends "
        "when records cover every pixel", low=0, high=100, unit="%",
    )  # fmt: skip
    exposure: float | Auto = _declare(
        "auto",
        "float",
        "composite",
        "brightness of the picture; auto: measured, so that white rooms are white",
        low=-64,
        high=64,
        unit="stops",
        word="auto",
    )

    backdrop: str = _declare(
        "auto", "choice", "composite", "background of the picture, without effect on light. auto: the sky of the scene's "
        "file, or grey without one. clear: transparent",
        choices=("auto", "sky", "grey", "black", "white", "clear"),
    )  # fmt: skip
    budget: float = _declare(
        80.0, "float", "view", "frame budget of the viewer, for gathering and drawing together; no effect on renders",
        low=1, high=10_000, unit="ms",
    )  # fmt: skip
    viewer_samples: int = _declare(
        64, "int", "view", "subpixel samples that the viewer accumulates in a still view; 0: off", low=0, high=65536,
    )  # fmt: skip
    viewer_quality: float = _declare(
        1.0, "float", "view", "estimated error at which refinement of a still view ends in the viewer, in percent of the "
        "mean indirect light; 0: off", low=0, high=100, unit="%",
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name, declaration in SETTINGS.items():
            object.__setattr__(self, name, declaration.check(getattr(self, name)))

    @property
    def request_criteria(self) -> tuple[float, float, int]:
        """Return the values that decide which pixels request a record: `threshold`, `spread` and `max_records`."""
        return self.threshold, self.spread, self.max_records

    @property
    def threshold(self) -> float:
        """The Σw below which a pixel requests a record: `tolerance`, with auto resolved."""
        return 1.0 / self.a if self.tolerance == "auto" else float(self.tolerance)

    @property
    def mix(self) -> tuple[float, float]:
        """The weights of direct and of indirect light in the picture, by `blend`."""
        return min(1.0, 2.0 * (1.0 - self.blend)), min(1.0, 2.0 * self.blend)

    @property
    def most_bounces(self) -> int:
        """The greatest number of indirect bounces: `bounces`, with all resolved."""
        return int(SETTINGS["bounces"].high or 0) if self.bounces == "all" else int(self.bounces)

    @property
    def hessian(self) -> bool:
        """True if `weights` are by the Hessian, and not the paper's."""
        return self.weights == "hessian"

    @property
    def widest(self) -> float:
        """The greatest radius that a record may have, in R_k."""
        return WIDE if self.gradients and self.hessian else 1.0

    def of(self, *stages: str) -> tuple[Value, ...]:
        """Return the values of the settings of these stages."""
        return tuple(getattr(self, name) for name, d in SETTINGS.items() if d.stage in stages)

    def with_values(self, values: Mapping[str, object]) -> Settings:
        """Return a copy with `values` by setting name. Raises InputError for an unknown name and for a bad value."""
        for name in values:
            check_name(name)
        return replace(self, **cast(SettingValues, dict(values)))  # __post_init__ checks the types


SETTINGS: dict[str, Declaration] = {f.name: Declaration(name=f.name, **f.metadata) for f in fields(Settings)}


REMOVED = {  # settings of earlier versions, and the reason for their removal
    "borrow": "each pixel without enough records requests one",
    "coarse": "views begin with every other pixel, except in the paper's order of placement",
    "fade": "the viewer accumulates frames, except in the paper's order of placement",
    "in_front": "the setting weights replaces it, hessian for on and paper for off",
    "kernel": "the setting weights replaces it, hessian for smooth and paper for cut",
    "max_rounds": f"a render stops after {MOST_ROUNDS} rounds",
    "overture": "its name is fill_holes now",
    "neighbours": "adaptive radii do better with fewer records",
    "pixel_light_samples": "records hold the light of emissive surfaces with less error in equal time",
    "radius": "the setting weights replaces it, hessian for hessian and paper for harmonic",
    "ray_noise": "a record has a quarter of the rays where their noise is below 4 %; gather_size 128 always has all rays",
    "rest": "its name is viewer_samples now",
    "second_order": "the setting weights replaces it, hessian for on and paper for off",
    "smooth": "it raised the error",
    "texture_memory": "images of surfaces have at most 1024 MiB",
    "walls": "inter-record variance finds the same pixels",
}


REMOVED_CHOICES = {("gather", "raster"): "rays see the whole hemisphere in less time"}


def _removed_choice(name: str, value: object) -> str:
    """Return the hint at a choice of an earlier version; empty for any other value."""
    why = REMOVED_CHOICES.get((name, value)) if isinstance(value, str) else None
    return f"; '{value}' was removed: {why}" if why else ""


def removed(name: str) -> str | None:
    """Return the message on a setting of an earlier version, by its name or flag; None for any other name."""
    why = REMOVED.get(name.removeprefix("--").replace("-", "_"))
    return None if why is None else f"setting '{name}' was removed: {why}; leave it out"


def check_name(name: str) -> None:
    """Raise InputError if `name` is not a setting."""
    if (message := removed(name)) is not None:
        raise InputError(message)
    if name not in SETTINGS:
        raise InputError(f"unknown setting '{name}'{did_you_mean(name, SETTINGS)}; the settings are {', '.join(SETTINGS)}")


class SettingValues(TypedDict, total=False):
    """Some settings by name: keywords of `render`, `Renderer` and `preset`."""

    shadow_size: int
    seed: int
    bounces: int | All
    gather: str
    gather_size: int
    light_samples: int
    gradients: bool
    weights: str
    a: float
    adapt: float
    radius_min: float
    radius_max: float
    tolerance: float | Auto
    spread: float
    placement: str
    warmup: int
    max_records: int
    blend: float
    fill_holes: bool
    samples: int
    quality: float
    exposure: float | Auto
    backdrop: str
    budget: float
    viewer_samples: int
    viewer_quality: float


PRESETS: dict[str, SettingValues] = {
    "default": {},
    "paper": {
        "bounces": 1,
        "gather": "plane",
        "gather_size": 64,
        "placement": "scan",
        "gradients": False,
        "weights": "paper",
        "a": 0.1,
        "adapt": 0.0,
        "spread": 0.0,
        "fill_holes": False,
        "radius_min": 0.0,
        "radius_max": 0.0,
    },
    "reference": {
        "gather_size": 128,
        "a": 0.2,
        "radius_min": 0.25,
        "radius_max": 2.0,
        "shadow_size": 2048,
    },
    "preview": {"gather_size": 24, "a": 0.8, "radius_min": 1.5, "radius_max": 12.0, "shadow_size": 512},
}


def preset(name: str = "default", **overrides: Unpack[SettingValues]) -> Settings:
    """Return the settings of the preset `name` with `overrides`. Raises InputError for an unknown name or value."""
    if not isinstance(name, str):
        raise InputError(f"a preset is given by its name, not by {type(name).__name__}; the presets are {', '.join(PRESETS)}")
    if name not in PRESETS:
        raise InputError(f"unknown preset '{name}'{did_you_mean(name, PRESETS)}; the presets are {', '.join(PRESETS)}")
    plain = _plain_preset(name)
    return plain.with_values(overrides) if overrides else plain


@cache
def _plain_preset(name: str) -> Settings:
    """Return a preset without overrides. The panel of the viewer reads it some thirty times a frame."""
    return Settings(**PRESETS[name])
