"""Value parsers of flags, for argparse; each returns a value or raises an error with the expected form."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable

from irrsplat.settings import LEAST_TILE, MOST_TILE

MOST_DECADES = 9


def number(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, not '{text}'")
    return value


def _whole(low: int, high: int, expected: str) -> Callable[[str], int]:
    """Return a parser of whole numbers from `low` to `high`; expected: these in words."""

    def parse(text: str) -> int:
        if not re.fullmatch(r"\d{1,9}", text, re.ASCII) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"expected {expected}, not '{text}'")
        return int(text)

    return parse


pixels = _whole(1, 999_999_999, "a whole number of pixels, at least 1")
samples = _whole(2, 999_999_999, "a whole number of samples, at least 2")
count = _whole(1, 999_999_999, "a whole number, at least 1")
decades = _whole(1, MOST_DECADES, f"a whole number from 1 to {MOST_DECADES}")
_tile = _whole(LEAST_TILE, MOST_TILE, f"0, or a whole number of pixels from {LEAST_TILE} to {MOST_TILE}")


def tile(text: str) -> int:
    """Parse a tile side in pixels; 0: no tiles."""
    return 0 if text == "0" else _tile(text)


def rate(text: str) -> float:
    """Parse frames per second."""
    value = number(text)
    if not 0.1 <= value <= 240.0:
        raise argparse.ArgumentTypeError(f"expected frames per second, 0.1 to 240, not '{text}'")
    return value


def frames(text: str) -> tuple[int, int | None]:
    """Parse frames A:B of a path as (A, B), half open as a Python slice; omitted: A = 0, B = None."""
    match = re.fullmatch(r"(\d{0,9}):(\d{0,9})", text, re.ASCII)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected A:B, the frames from A to before B, either may be left out, not '{text}'")
    start, stop = int(match[1] or 0), int(match[2]) if match[2] else None
    if stop is not None and start >= stop:
        raise argparse.ArgumentTypeError(f"'{text}' holds no frame: B is not among them; give a B greater than A")
    return start, stop
