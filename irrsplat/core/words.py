"""Words of a text: which are numbers, and how they are quoted in messages."""

from __future__ import annotations

import math

GREATEST = 1e15  # its square, and light summed up from it, is still a float32


def spelled(text: str) -> str:
    """Return `text` with everything that a terminal would act upon spelled out, such as escape sequences; ends of lines stay."""
    return text if text.isprintable() else "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


def quote(text: str) -> str:
    """`text` in quotes, at most 40 characters of it, fit to stand in a one-line message."""
    return ascii(text if len(text) <= 40 else text[:39] + "…") if not text.isprintable() else f"'{text[:40]}'"


def number(word: str) -> float:
    """The finite number that `word` spells; raises ValueError with the reason where it is none."""
    try:
        value = float(word)
    except ValueError:
        value = None
    if value is None or "_" in word:
        raise ValueError(f"{quote(word)} is not a number")
    if not math.isfinite(value):
        raise ValueError(f"{quote(word)} is not a finite number")
    if abs(value) > GREATEST:
        raise ValueError(f"{quote(word)} is beyond {GREATEST:g}, the greatest number that 32-bit floats can reckon with here")
    return value


def is_number(word: str) -> bool:
    """Whether `number` takes `word`."""
    try:
        number(word)
    except ValueError:
        return False
    return True
