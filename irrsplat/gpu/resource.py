"""Who owns what on the GPU: an owner lists what it frees, in the open."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Protocol, Self


class Resource(Protocol):
    """Anything that `release` frees: textures, buffers, programs, and owners of such."""

    def release(self) -> object:
        """Free it."""


class Owner(ABC):
    """Owns resources and frees them at the end of a `with` block, or by `release`; what it has borrowed it does not list."""

    @abstractmethod
    def owned(self) -> Sequence[Resource | None]:
        """What this frees; None stands for what has not been made yet."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free everything that is owned; twice does no harm."""
        for thing in self.owned():
            if thing is not None:
                thing.release()

    def resources(self) -> Iterator[Resource]:
        """Everything that is owned, here and by owners that are owned, the owners themselves left out."""
        for thing in self.owned():
            if isinstance(thing, Owner):
                yield from thing.resources()
            elif thing is not None:
                yield thing
