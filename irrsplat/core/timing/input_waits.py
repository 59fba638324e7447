"""Waiting input: work within a frame budget ends early for input, and continues in a later frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import moderngl


class InputWaits(Exception):
    """Raised between two stages of a frame if input waits."""


def never() -> bool:
    """Return False: a check by which nothing is ended early."""
    return False


_checks: list[Callable[[], bool]] = [never]  # the last one is in use


def input_waits() -> bool:
    """Return True if input waits, by the check in use."""
    return _checks[-1]()


def interruptible() -> bool:
    """Return True if input may end the present work."""
    return _checks[-1] is not never


def stop_for_input(ctx: moderngl.Context | None = None) -> None:
    """Raise InputWaits if input waits. The caller must leave no unfinished result behind as finished.

    ctx: an OpenGL context whose draws are finished first, so that the check comes after them.
    """
    if ctx is not None and interruptible():
        ctx.finish()
    if input_waits():
        raise InputWaits


@contextmanager
def checked_by(check: Callable[[], bool]) -> Iterator[None]:
    """Use `check` as the test for waiting input within the block."""
    _checks.append(check)
    try:
        yield
    finally:
        _checks.pop()
