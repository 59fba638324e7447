"""Parsing of `sky` lines: a colour, a map with a gain and a turn, or a CIE sky with its sun, by position or place and time."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from irrsplat.core import paths
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import Vector
from irrsplat.core.words import GREATEST, number, quote
from irrsplat.sky.cie import CIE_KINDS, CieSky
from irrsplat.sky.environment import Environment
from irrsplat.sky.map_file import read_map
from irrsplat.sky.split import split

PLAIN = "R G B"
MAP = "FILE.hdr|FILE.exr [gain X] [rotate DEG]"
_SUN = "sun ALTITUDE AZIMUTH | at LAT LON TIME"
CIE = f"cie {'|'.join(CIE_KINDS)} [{_SUN}] [turbidity T] [ground R] [lux E] [north DEG]"
USAGE = f"{PLAIN}, or: FILE.hdr|FILE.exr …, or: cie {'|'.join(CIE_KINDS)} …"
_WORDS = {"sun": 2, "at": 3, "turbidity": 1, "ground": 1, "lux": 1, "north": 1}  # number of values of each word


@dataclass(frozen=True)
class Sky:
    """The sky of a scene: constant `radiance` (3,) W/(m² sr), or an `environment`.

    turn: degrees of the environment's north, clockwise seen from above, from the world's back. notices: for a user; files: its
    sources.
    """

    radiance: Vector = (0.0, 0.0, 0.0)
    environment: Environment | None = None
    turn: float = 0.0
    notices: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    def in_watts(self, per_unit: float) -> Sky:
        """Return the sky for a `radiance` in units of `per_unit` W/(m² sr). An environment has its own unit."""
        r, g, b = self.radiance
        return replace(self, radiance=(r * per_unit, g * per_unit, b * per_unit))


def sky_of(text: str | None) -> Sky | None:
    """Return the sky of a loader's option `sky`, with paths from the current folder; None for None.

    Raises InputError, one line, for any error in the text.
    """
    if text is None:
        return None
    with paths.anywhere():
        return parse(text, Path(), lambda message: InputError(f"sky: {message}"))


def parse(text: str, folder: Path, error: Callable[[str], InputError]) -> Sky:
    """Return the sky described by `text` (see USAGE); paths are relative to `folder`. error: makes the exception from a
    message."""
    words = text.split()
    if not words:
        raise error(f"nothing is said about it; expected: {USAGE}")
    if words[0] == "cie":
        return _cie(words[1:], error)
    if _spells_number(words[0]) and not (paths.may_read(folder / text) and os.path.isfile(folder / text)):
        return _plain(words, error)
    return _map(text, folder, error)


def _spells_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _number(word: str, error: Callable[[str], InputError], usage: str) -> float:
    try:
        return number(word)
    except ValueError as reason:
        raise error(f"{reason}; expected: {usage}") from None


def _plain(words: list[str], error: Callable[[str], InputError]) -> Sky:
    if len(words) != 3:
        raise error(f"'sky' has {len(words)} values; expected: sky {PLAIN}")
    r, g, b = (_number(word, error, f"sky {PLAIN}") for word in words)
    if min(r, g, b) < 0.0:
        raise error(f"the sky is {r:g} {g:g} {b:g}; expected values of 0 or more")
    return Sky((r, g, b))


def _map(text: str, folder: Path, error: Callable[[str], InputError]) -> Sky:
    given: dict[str, float] = {}
    name = text.strip()
    while match := re.fullmatch(r"(.*\S)\s+(gain|rotate)\s+(\S+)", name):
        name, word, value = match.groups()
        if word in given:
            raise error(f"'{word}' is given twice")
        given[word] = _number(value, error, f"sky {MAP}")
    gain = given.get("gain", 1.0)
    if gain < 0.0:
        raise error(f"the gain is {gain:g}; expected 0 or more")
    path = folder / name
    if not paths.may_read(path):
        raise error(f"this map is not read: {paths.refusal(path)}")
    if not os.path.isfile(path):
        raise error(f"there is no file {quote(name)}; expected: sky {USAGE}")
    radiance, notices = read_map(path)
    radiance = radiance * np.float32(gain)
    if not np.isfinite(radiance).all() or radiance.max() > GREATEST:
        raise error(f"the gain {gain:g} makes the sky brighter than {GREATEST:g}; give a smaller one")
    light, suns = split(radiance)
    height, width = radiance.shape[:2]
    about = f"{path.name}, {width}x{height}" + (f", gain {gain:g}" if gain != 1.0 else "")
    environment = Environment(radiance, light, suns, about)
    return Sky(environment=environment, turn=given.get("rotate", 0.0), notices=tuple(notices), files=(path,))


def _cie(words: list[str], error: Callable[[str], InputError]) -> Sky:
    usage = f"sky {CIE}"
    kind = next((kind for kind in CIE_KINDS if words[:1] == [kind]), None)
    if kind is None:
        raise error(f"'{' '.join(words[:1])}' is no kind of CIE sky; expected: {usage}")
    given: dict[str, list[str]] = {}
    rest = words[1:]
    while rest:
        word, count = rest[0], _WORDS.get(rest[0], -1)
        if count < 0:
            raise error(f"unknown word {quote(word)}; expected: {usage}")
        if word in given:
            raise error(f"'{word}' is given twice")
        if len(rest) <= count:
            raise error(f"'{word}' has {len(rest) - 1} values and needs {count}; expected: {usage}")
        given[word], rest = rest[1 : 1 + count], rest[1 + count :]

    def value(name: str, default: float, low: float, high: float) -> float:
        found = _number(given[name][0], error, usage) if name in given else default
        if not low <= found <= high:
            raise error(f"{name} is {found:g}; expected {low:g} to {high:g}")
        return found

    sky = CieSky(kind)
    altitude, azimuth = _sun(given, error, usage)
    if altitude is None and (sky.has_sun or "lux" not in given):
        other = "" if sky.has_sun else ", or lux E"
        raise error(f"a sky that is {kind} needs the sun's place: sun ALTITUDE AZIMUTH, or at LAT LON TIME{other}")
    if altitude is not None and altitude <= 0.0 and (sky.has_sun or "lux" not in given):
        raise error(f"the sun is {-altitude:.1f}° below the horizon; give another time")
    if "turbidity" in given and not sky.has_sun:
        raise error(f"turbidity is for clear and intermediate skies, not for one that is {kind}")
    sky = replace(
        sky,
        altitude=altitude,
        azimuth=azimuth,
        turbidity=value("turbidity", sky.turbidity, 1.0, 20.0),
        ground=value("ground", sky.ground, 0.0, 1.0),
        lux=value("lux", 0.0, 0.0, 1e6) if "lux" in given else None,
    )
    about = f"CIE {kind}" + ("" if altitude is None else f", sun at altitude {altitude:.1f}°, azimuth {azimuth:.1f}°")
    line = " ".join(["cie", *words])
    return Sky(environment=sky.environment(about, line), turn=value("north", 0.0, -360.0, 360.0))


def _sun(given: dict[str, list[str]], error: Callable[[str], InputError], usage: str) -> tuple[float | None, float | None]:
    """Return the sun's altitude and azimuth in degrees, as given or by place and time; (None, None) for neither."""
    if "sun" in given and "at" in given:
        raise error("'sun' and 'at' both define the position of the sun; give one of them")
    if "sun" in given:
        altitude, azimuth = (_number(word, error, usage) for word in given["sun"])
        if not -90.0 <= altitude <= 90.0:
            raise error(f"the sun's altitude is {altitude:g}; expected -90 to 90 degrees")
        return altitude, azimuth
    if "at" not in given:
        return None, None
    latitude, longitude = (_number(word, error, usage) for word in given["at"][:2])
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
        raise error(f"there is no place at {latitude:g} {longitude:g}; expected degrees north (-90 to 90) and east (-180 to 180)")
    time = given["at"][2]
    try:
        when = datetime.fromisoformat(time)
    except ValueError:
        raise error(f"{quote(time)} is no time; expected one such as 2026-06-21T12:00+02:00") from None
    if when.tzinfo is None:
        raise error(f"{quote(time)} has no offset from UTC; expected one such as 2026-06-21T12:00+02:00, or …Z")
    try:
        return sun_position(latitude, longitude, when)
    except OverflowError:  # UTC's year is 0, or 10000
        raise error(f"{quote(time)} lies beyond the years 1 to 9999") from None


def sun_position(latitude: float, longitude: float, when: datetime) -> tuple[float, float]:
    """Return (altitude, azimuth) of the sun's centre in degrees, the azimuth clockwise from north; without refraction.

    latitude, longitude: degrees, north and east positive. when: with its offset from UTC. Accurate to a few hundredths of a
    degree from 1900 to 2100 (NOAA's formulas, after Meeus).
    """
    from astral import Observer  # few scenes need it
    from astral.sun import azimuth, elevation

    place = Observer(latitude, longitude)
    return float(elevation(place, when, with_refraction=False)), float(azimuth(place, when))
