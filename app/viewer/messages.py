"""Lines for the user: notices that vanish after some seconds, and errors that stay."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from irrsplat.core.errors import IrrsplatError
from irrsplat.core.timing import clock

_SECONDS = 5.0  # seconds: the time that a notice stays
_MOST = 5  # the most lines at once


@dataclass(frozen=True)
class Message:
    """A line for the user. until: the clock's time in seconds at which a notice vanishes.

    error: True if the line is an error, which stays until it is closed or corrected. topic: see Messages.say.
    """

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
        """Show a line. It replaces an equal line, and the last line of its `topic`."""
        line = " ".join(str(text).split())
        others = [m for m in self.lines if m.text != line and (not topic or m.topic != topic)]
        self.lines = [*others[1 - _MOST :], Message(line, clock.now() + _SECONDS, error, topic)]

    def drop(self, topic: str) -> None:
        self.lines = [m for m in self.lines if m.topic != topic]

    def renew(self) -> None:
        """Show all notices for their full time from now on."""
        self.lines = [replace(line, until=clock.now() + _SECONDS) for line in self.lines]

    def expire(self) -> None:
        self.lines = [m for m in self.lines if m.error or m.until > clock.now()]

    @property
    def rests(self) -> float:
        """The seconds until the next notice vanishes; infinity without a notice."""
        now = clock.now()
        return min((max(m.until - now, 0.0) for m in self.lines if not m.error), default=math.inf)

    def close_errors(self, notices: Sequence[str] = ()) -> None:
        """Close all errors, and these notices."""
        self.lines = [m for m in self.lines if not m.error and m.text not in notices]

    def attempt(self, act: Callable[[], object]) -> None:
        """Call `act`, and show its error as a message."""
        try:
            act()
        except (IrrsplatError, OSError) as error:
            self.say(error, error=True)
