"""Words of a text: numbers, and quoting in messages."""

from __future__ import annotations

import math

GREATEST = 1e15  # its square, and sums of light from it, are still float32


def spelled(text: str) -> str:
    """Return `text` with escape sequences and other control characters escaped; line ends stay."""
    return text if text.isprintable() else "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


def quote(text: str) -> str:
    """Return `text` in quotes, at most 40 characters, for a one-line message."""
    return ascii(text if len(text) <= 40 else text[:39] + "…") if not text.isprintable() else f"'{text[:40]}'"


def amount(value: float) -> str:
    """Return `value` with four significant digits, and no exponent below 10^12."""
    return f"{float(f'{value:.4g}'):,.12g}"


def number(word: str) -> float:
    """Return the finite number spelled by `word`; raises ValueError with the reason for other words."""
    try:
        value = float(word.replace("_", "?"))  # Python alone allows 1_000
    except ValueError:
        raise ValueError(f"{quote(word)} is not a number") from None
    if not math.isfinite(value):
        raise ValueError(f"{quote(word)} is not a finite number")
    if abs(value) > GREATEST:
        raise ValueError(f"{quote(word)} is beyond {GREATEST:g}, the greatest number that 32-bit floats can reckon with here")
    return value


def is_number(word: str) -> bool:
    """True if `number` accepts `word`."""
    try:
        number(word)
    except ValueError:
        return False
    return True
