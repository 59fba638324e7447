"""Reader of photometric files of luminaires: ANSI/IES LM-63 of 1986, 1991, 1995, 2002 and 2019."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.paths import may_read, refusal
from irrsplat.core.words import number, quote
from irrsplat.scene.io.lines import text_bytes
from irrsplat.scene.model import Photometry

_HEADER = re.compile(r"\s*(?:IES(?:NA)?\s*:\s*LM-63-|IESNA)(\d{4}|\d{2})\b", re.IGNORECASE)
_TILT = re.compile(r"\s*TILT\s*=", re.IGNORECASE)
_FOOT = 0.3048  # metres
_LAMPS = {1: "of a lamp that is upright", 2: "of a lamp that stays level", 3: "of a level lamp that tilts with the luminaire"}
_ANGLE_TOLERANCE = 0.01  # degrees; tolerance for the angles 0, 90, 180, 270 and 360

# Directions of azimuth 0, of azimuth 90° and of the pole in the frame of Photometry, for photometry of types C, B and A.
# Type C has its pole at the aim, types B and A, for floodlights, to the side. The pole of B lies to the right of the aim with
# +x up: the vertical angle turns about it, the horizontal one rises to it. The pole of A lies above, with the angles exchanged.
_AXES = {
    1: np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]),
    2: np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
    3: np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
}


def load_ies(path: Path, notices: list[str], files: list[Path]) -> Photometry:
    """Read the photometry in the file at `path`; raise InputError with file and line for an invalid file.

    Candela are multiplied by the file's multiplier and its ballast factor; until 1991 also by a further photometric factor, whose
    field has another meaning in later versions. Symmetric parts are completed. Appends to `notices` for a TILT table that varies
    with the angle, and to `files` the table's own file, if any.
    """
    text = text_bytes(path, strict=False).decode("utf-8", "replace").split("\n")
    tilt = next((i for i, line in enumerate(text) if _TILT.match(line)), None)
    if tilt is None:
        expected = "expected a photometric file of luminaires (ANSI/IES LM-63); convert EULUMDAT (.ldt) to .ies"
        raise InputError(f"there is no line TILT=; {expected}", path)
    header = next((found for line in text[:tilt] if (found := _HEADER.match(line))), None)
    numbers = _Numbers(path, text, tilt + 1)
    factor = _tilt(text[tilt].partition("=")[2].strip(), numbers, tilt + 1, notices, files)
    return _photometry(numbers, factor, old=header is None or header[1] in ("86", "91", "1986", "1991"))


class _Numbers:
    """The numbers of a text in order, separated by blanks, commas and ends of lines."""

    def __init__(self, path: Path, text: list[str], start: int) -> None:
        self.path, self._text, self._start = path, text, start
        self._words = _words("\n".join(text[start:]))
        self._next = 0

    def error(self, message: str, back: int = 1) -> InputError:
        """Return an error with the place of the number `back` before the next."""
        ends = np.cumsum([len(_words(line)) for line in self._text[self._start :]])
        line = int(np.searchsorted(ends, self._next - back, side="right"))
        return InputError(message, self.path, self._start + line + 1)

    def take(self, what: str, count: int = 1) -> np.ndarray:
        """Return (count,) the next numbers; raise InputError, with their name `what`, for invalid or missing ones."""
        start, stop = self._next, self._next + count
        if stop > len(self._words):
            found = f", after {len(self._words) - start} of {count}" if count > 1 else ""
            end = max((i + 1 for i, line in enumerate(self._text) if line.strip()), default=1)
            raise InputError(f"the file ends in {what}{found}; it is cut off, or one of its counts is wrong", self.path, end)
        values = np.empty(count)
        for k, word in enumerate(self._words[start:stop]):
            self._next += 1
            try:
                values[k] = number(word)
            except ValueError as error:
                raise self.error(f"{error}; expected {what}") from None
        return values

    def finish(self, where: str) -> None:
        """Raise InputError for surplus numbers."""
        if self._next < len(self._words):
            self._next += 1
            raise self.error(f"{len(self._words) - self._next + 1} words too many {where}; one of the file's counts is wrong")

    def one(self, what: str) -> float:
        """Return the next number."""
        return float(self.take(what)[0])

    def whole(self, what: str, low: int, high: int) -> int:
        """Return the next number, an integer from `low` to `high`."""
        value = self.one(what)
        if not (value.is_integer() and low <= value <= high):
            raise self.error(f"{what} is {value:g}; expected {_range(low, high)}")
        return int(value)

    def positive(self, what: str) -> float:
        """Return the next number, which must be positive."""
        value = self.one(what)
        if not value > 0.0:
            raise self.error(f"{what} is {value:g}; expected a number above 0")
        return value

    def angles(self, what: str, count: int, low: float, high: float) -> np.ndarray:
        """Return (count,) the next numbers: ascending angles in degrees from `low` to `high`."""
        values = self.take(what, count)
        for wrong, reason in (
            (np.append(False, np.diff(values) <= 0.0), "expected angles that rise"),
            ((values < low - _ANGLE_TOLERANCE) | (values > high + _ANGLE_TOLERANCE), f"expected {low:g} to {high:g} degrees"),
        ):
            if wrong.any():
                first = int(wrong.argmax())
                raise self.error(f"{what}: {values[first]:g} is out of order; {reason}", count - first)
        right = np.round(values / 90.0) * 90.0
        return np.where(np.abs(values - right) <= _ANGLE_TOLERANCE, right, values)


def _words(text: str) -> list[str]:
    """Return the words between blanks, commas, ends of lines and ends of files."""
    return text.replace(",", " ").replace("\x1a", " ").split()


def _range(low: int, high: int) -> str:
    return ", ".join(map(str, range(low, high))) + f" or {high}" if high - low < 4 else f"a whole number of at least {low}"


def _tilt(word: str, numbers: _Numbers, line: int, notices: list[str], files: list[Path]) -> float:
    """Return the factor for the tilt of the light, from the word after TILT=: NONE, INCLUDE, or the name of a file."""
    path = numbers.path
    if word.upper() == "NONE":
        return 1.0
    if not word:
        raise InputError("TILT= has no value; expected TILT=NONE, TILT=INCLUDE, or TILT= and the name of a file", path, line)
    if word.upper() != "INCLUDE":
        file = path.parent / word
        if not may_read(file):
            raise InputError(f"the TILT file {quote(word)} is not read: {refusal(file)}", path, line)
        if not os.path.isfile(file):
            raise InputError(f"there is no TILT file {quote(word)} in its folder; put it there, or write TILT=NONE", path, line)
        files.append(file)
        text = text_bytes(file, strict=False).decode("utf-8", "replace").split("\n")
        numbers = _Numbers(file, text, 0)
    geometry = numbers.whole("the lamp-to-luminaire geometry", 1, 3)
    count = numbers.whole("the number of TILT angles", 1, 10_000)
    angles = numbers.angles("the TILT angles", count, -180.0, 180.0)
    factors = numbers.take("the TILT factors", count)
    if factors.min() < 0.0:
        raise numbers.error("a TILT factor is negative; expected factors of 0 or more")
    factor = float(np.interp(0.0, angles, factors))
    if not factor > 0.0:
        raise numbers.error("the TILT factor at 0 degrees is 0, and no light would leave it; expected one above 0")
    if factors.min() < factors.max():  # a scene does not define the tilt of the light
        notices.append(
            f"{path}: its TILT table ({_LAMPS[geometry]}) is taken at 0 degrees, a factor of {factor:g}: right where the "
            f"luminaire is not tilted from the position of its test; otherwise it has {factors.min():g} to {factors.max():g}"
        )
    return factor


def _photometry(numbers: _Numbers, factor: float, old: bool) -> Photometry:
    """Return the photometry in the numbers after TILT, with candela times `factor`. old: the file is of 1986 or 1991."""
    numbers.positive("the number of lamps")
    numbers.one("the lumens per lamp")  # -1: absolute photometry; candela are those of the luminaire in either case
    factor *= numbers.positive("the candela multiplier")
    counts = [numbers.whole(f"the number of {which} angles", low, 100_000) for which, low in (("vertical", 2), ("horizontal", 1))]
    kind = numbers.whole("the photometric type", 1, 3)
    metres = _FOOT if numbers.whole("the units of lengths", 1, 2) == 1 else 1.0
    width, length, height = (abs(float(x)) * metres for x in numbers.take("the luminous opening", 3))  # negative: round
    factor *= numbers.positive("the ballast factor")
    if old:
        factor *= numbers.positive("the ballast-lamp photometric factor")
    else:
        numbers.one("the field for future use")
    numbers.one("the input watts")
    vertical = numbers.angles("the vertical angles", counts[0], *((0.0, 180.0) if kind == 1 else (-90.0, 90.0)))
    horizontal = numbers.angles("the horizontal angles", counts[1], *((0.0, 360.0) if kind == 1 else (-90.0, 90.0)))
    try:
        horizontal, rows = (_all_around if kind == 1 else _both_sides)(horizontal)
        if kind != 1 and vertical[0] >= 0.0:
            raise ValueError(
                f"the vertical angles of type {'B' if kind == 2 else 'A'} begin at {vertical[0]:g}; expected -90 to 90"
            )
    except ValueError as error:
        raise numbers.error(str(error)) from None
    candela = numbers.take("the candela values", counts[0] * counts[1])
    if candela.min() < 0.0:
        first = int((candela < 0.0).argmax())
        raise numbers.error(f"an intensity is {candela[first]:g} candela; expected values of 0 or more", len(candela) - first)
    numbers.finish(f"after {counts[1]} times {counts[0]} candela values")
    table = factor * candela.reshape(counts[1], counts[0])[rows]
    opening, path = (width, length, height), str(numbers.path)
    if kind == 1:
        return Photometry(vertical, horizontal, table, _AXES[1], opening, path)
    if kind == 2:  # the horizontal angle rises to the pole; the vertical one turns about it
        return Photometry(90.0 - horizontal[::-1], vertical, table[::-1].T, _AXES[2], opening, path)
    return Photometry(90.0 - vertical[::-1], horizontal, table[:, ::-1], _AXES[3], opening, path)


def _all_around(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return horizontal angles of type C over 360°, and the row of candela for each; raise ValueError for an unknown symmetry."""
    rows = np.arange(len(angles))
    if len(angles) == 1:
        return np.zeros(1), rows
    first, last = angles[0], angles[-1]
    if (first, last) == (90.0, 270.0):
        return _mirrored(angles, rows, 90.0)
    if (first, last) == (0.0, 90.0):
        angles, rows = _mirrored(angles, rows, 90.0)
    if (angles[0], angles[-1]) == (0.0, 180.0):
        return _mirrored(angles, rows, 180.0)
    gap = 360.0 - last
    if first == 0.0 and 0.0 < gap < 180.0 and gap <= np.diff(angles).max() + _ANGLE_TOLERANCE:  # the last plane is left out
        return np.append(angles, 360.0), np.append(rows, 0)
    if (first, last) != (0.0, 360.0):
        raise ValueError(
            f"the horizontal angles go from {first:g} to {last:g}; expected 0 alone, 0 to 90, 180 or 360, or 90 to 270"
        )
    return angles, rows


def _both_sides(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles and rows for types A and B, whose horizontal angles from 0 on apply to both sides."""
    rows = np.arange(len(angles))
    if len(angles) > 1 and angles[0] == 0.0:
        return _mirrored(angles, rows, 0.0)
    if len(angles) == 1 or angles[0] > 0.0:
        raise ValueError(f"the horizontal angles begin at {angles[0]:g}; expected -90 to 90, or 0 to 90")
    return angles, rows


def _mirrored(angles: np.ndarray, rows: np.ndarray, about: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles and their mirror images about one end, ascending, with their rows."""
    mirror, others = (2.0 * about - angles)[::-1], rows[::-1]
    if about == angles[0]:
        return np.append(mirror[:-1], angles), np.append(others[:-1], rows)
    return np.append(angles, mirror[1:]), np.append(rows, others[1:])
