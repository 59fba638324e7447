"""Lines for the user: notices that vanish by themselves, and errors that stay."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from irrsplat.core.errors import IrrsplatError

_SECONDS = 4.0  # that a notice is shown
_MOST = 5  # lines at once


@dataclass(frozen=True)
class Message:
    """A line for the user. until: time.monotonic() at which it vanishes; an error stays until it is closed or mended."""

    text: str
    until: float
    error: bool = False
    topic: str = ""


class Messages:
    """The lines on show, the newest last."""

    def __init__(self) -> None:
        self.lines: list[Message] = []

    @property
    def errors(self) -> list[Message]:
        """The errors among them."""
        return [line for line in self.lines if line.error]

    def say(self, text: object, error: bool = False, topic: str = "") -> None:
        """Show a line, in place of an equal one and of the last one with the same `topic`."""
        line = " ".join(str(text).split())
        others = [m for m in self.lines if m.text != line and (not topic or m.topic != topic)]
        self.lines = [*others[1 - _MOST :], Message(line, time.monotonic() + _SECONDS, error, topic)]

    def expire(self) -> None:
        """Drop the notices whose time is over."""
        self.lines = [m for m in self.lines if m.error or m.until > time.monotonic()]

    def close_errors(self) -> None:
        """Drop the errors."""
        self.lines = [m for m in self.lines if not m.error]

    def attempt(self, act: Callable[[], object]) -> bool:
        """Call `act`; whether it succeeded. What goes wrong is shown as an error."""
        try:
            act()
        except (IrrsplatError, OSError) as error:
            self.say(error, error=True)
            return False
        return True
