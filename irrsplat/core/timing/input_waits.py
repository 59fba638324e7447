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


_checks: list[tuple[Callable[[], bool], bool]] = [(never, True)]  # the last one is in use; True if InputWaits may be raised


def input_waits() -> bool:
    """Return True if input waits, by the check in use."""
    return _checks[-1][0]()


def interruptible() -> bool:
    """Return True if input may end the present work."""
    return _checks[-1][0] is not never


def stop_for_input(ctx: moderngl.Context | None = None) -> None:
    """Raise InputWaits if input waits. The caller must leave no unfinished result behind as finished.

    ctx: an OpenGL context whose draws are finished first, so that the check comes after them.
    """
    _, raises = _checks[-1]
    if raises and ctx is not None and interruptible():
        ctx.finish()
    if raises and input_waits():
        raise InputWaits


@contextmanager
def checked_by(check: Callable[[], bool], raises: bool = True) -> Iterator[None]:
    """Use `check` as the test for waiting input within the block. raises: False if input ends budgets only."""
    _checks.append((check, raises))
    try:
        yield
    finally:
        _checks.pop()
