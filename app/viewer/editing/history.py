"""What can be undone and redone: a list of states, each a value, and where one is in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

MOST = 300  # states that are kept

State = TypeVar("State")


@dataclass(frozen=True)
class History(Generic[State]):
    """States in their order, of which `present` is the one in force. past: the last one before it comes last. future: what was
    undone, the last undone first."""

    present: State
    past: tuple[State, ...] = ()
    future: tuple[State, ...] = ()

    def then(self, state: State) -> History[State]:
        """With a new state in force; what was undone is given up. The same state again is no step."""
        if state == self.present:
            return self
        return History(state, (*self.past, self.present)[-MOST:])

    def undone(self) -> History[State]:
        """A step back, where there is one."""
        if not self.past:
            return self
        return replace(self, present=self.past[-1], past=self.past[:-1], future=(self.present, *self.future))

    def redone(self) -> History[State]:
        """A step ahead again, where there is one."""
        if not self.future:
            return self
        return replace(self, present=self.future[0], past=(*self.past, self.present), future=self.future[1:])
