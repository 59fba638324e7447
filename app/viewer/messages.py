"""Lines for the user: notices that vanish by themselves, and errors that stay."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from irrsplat.core.errors import IrrsplatError
from irrsplat.core.timing import clock

_SECONDS = 5.0  # that a notice is shown
_MOST = 5  # lines at once


@dataclass(frozen=True)
class Message:
    """A line for the user. until: the clock's time at which it vanishes; an error stays until it is closed or corrected."""

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
        return [line for line in self.lines if line.error]

    def say(self, text: object, error: bool = False, topic: str = "") -> None:
        """Show a line, in place of an equal one and of the last one with the same `topic`."""
        line = " ".join(str(text).split())
        others = [m for m in self.lines if m.text != line and (not topic or m.topic != topic)]
        self.lines = [*others[1 - _MOST :], Message(line, clock.now() + _SECONDS, error, topic)]

    def renew(self) -> None:
        """Show all notices for their full time from now on."""
        self.lines = [replace(line, until=clock.now() + _SECONDS) for line in self.lines]

    def expire(self) -> None:
        """Drop the notices whose time is over."""
        self.lines = [m for m in self.lines if m.error or m.until > clock.now()]

    @property
    def rests(self) -> float:
        """The seconds until a notice goes; infinity without a notice."""
        now = clock.now()
        return min((max(m.until - now, 0.0) for m in self.lines if not m.error), default=math.inf)

    def close_errors(self) -> None:
        self.lines = [m for m in self.lines if not m.error]

    def close(self) -> None:
        self.lines = []

    def attempt(self, act: Callable[[], object]) -> bool:
        """Call `act`; whether it succeeded. What goes wrong is shown as an error."""
        try:
            act()
        except (IrrsplatError, OSError) as error:
            self.say(error, error=True)
            return False
        return True
