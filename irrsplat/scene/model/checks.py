"""Checks of callers' arguments, and helpers of scene data."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.words import GREATEST


def put(thing: object, **values: object) -> None:
    """Set fields of a frozen dataclass during its construction, for example to normalized values."""
    for name, value in values.items():
        object.__setattr__(thing, name, value)


def check_type(what: str, value: object, kind: type, *others: None) -> None:
    """Raise InputError, with the name `what`, for a value that is neither of this kind nor one of the `others`."""
    if not isinstance(value, kind) and not (others and value is None):
        raise InputError(f"{what} is a {kind.__name__}, not {type(value).__name__}")


def check_callback(what: str, value: object) -> None:
    """Raise InputError, with the name `what`, for a value that is neither None nor can be called."""
    if value is not None and not callable(value):
        raise InputError(f"{what} is a function or None, not {type(value).__name__}")


def checked(what: str, values: object, count: int, low: float = -GREATEST, high: float = GREATEST) -> tuple[float, ...]:
    """Return `count` numbers from `low` to `high`; raise InputError, with the name `what`, for other values."""
    if isinstance(values, tuple) and len(values) == count and all(type(v) is float and low <= v <= high for v in values):
        return values  # numpy takes ten times as long, and files have many of these
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if array.shape == (count,) and (array >= low).all() and (array <= high).all():  # false for NaN
        return tuple(array.tolist())
    given = f"{values!r:.60}".replace("\n", " ")
    raise InputError(f"{what} takes {count} finite numbers{_between(low, high)}, not {given}")


def checked_number(what: str, value: object, low: float = -GREATEST, high: float = GREATEST) -> float:
    """Return a number from `low` to `high`; raise InputError, with the name `what`, for other values."""
    found = math.nan
    if not isinstance(value, (str, bytes, bool)) and np.ndim(value) == 0:  # type: ignore[arg-type]  # anything has a number of axes
        with suppress(TypeError, ValueError, OverflowError):
            found = float(value)  # type: ignore[arg-type]  # it is tried
    if not low <= found <= high:
        raise InputError(f"{what} takes a finite number{_between(low, high)}, not {value!r:.60}")
    return found


def check_rows(what: str, array: object, columns: int, rows: int | None = None, most: float = GREATEST) -> None:
    """Raise InputError, with the name `what`, unless `array` is (rows, columns) of finite numbers within `most`.

    The shape is (rows,) where columns is 0.
    """
    shape = f"({'N' if rows is None else rows},{f' {columns}' if columns else ''})"
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or array.ndim != 1 + (columns > 0):
        raise InputError(f"{what} are an array {shape} of numbers, not {_kind(array)}")
    if (columns and array.shape[1] != columns) or (rows is not None and len(array) != rows):
        raise InputError(f"{what} are an array {shape} of numbers, not {_kind(array)}")
    if array.size and not (array.min() >= -most and array.max() <= most):  # false for NaN
        raise InputError(f"{what} must be finite numbers, at most {most:g}")


def _kind(array: object) -> str:
    return f"one of shape {array.shape} of {array.dtype}" if isinstance(array, np.ndarray) else type(array).__name__


def _between(low: float, high: float) -> str:
    if -low == high:
        return f" within {high:g}"
    return f" from {low:g} to {high:g}"
