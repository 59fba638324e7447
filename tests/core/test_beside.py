"""Work in a thread beside a generator: its result, its errors, and what becomes of it when nobody waits any more."""

from __future__ import annotations

from collections.abc import Generator
from threading import Event
from typing import TypeVar

import pytest

from irrsplat.core.beside import _AT_ONCE, beside

Result = TypeVar("Result")


def last(steps: Generator[float, None, Result]) -> Result:
    """What a generator returns."""
    while True:
        try:
            assert next(steps) == 0.5
        except StopIteration as end:
            result: Result = end.value
            return result


def test_the_result_and_the_error_of_work() -> None:
    assert last(beside(lambda: 6 * 7, 0.5)) == 42
    with pytest.raises(ZeroDivisionError):
        last(beside(lambda: 1 // 0, 0.5))


def test_dropped_work_that_has_not_begun_never_begins() -> None:
    go_on, begun = Event(), []
    first = [beside(go_on.wait, 0.5) for _ in range(_AT_ONCE)]
    for work in first:
        next(work)
    second = beside(lambda: begun.append(True), 0.5)
    next(second)
    second.close()
    go_on.set()
    assert all(last(work) is True for work in first) and last(beside(lambda: 1, 0.5)) == 1 and not begun
