"""Who owns what on the GPU: an owner lists what it frees, in the open."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, Self, TypeVar


class Resource(Protocol):
    """Anything that `release` frees: textures, buffers, programs, and owners of such."""

    def release(self) -> object:
        """Free it."""


Made = TypeVar("Made", bound=Resource)


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


class Workshop(Owner):
    """Resources that are made when they are first wanted, and made anew, the old ones freed, when they are wanted otherwise."""

    def __init__(self) -> None:
        self._made: dict[str, tuple[object, Resource]] = {}

    def owned(self) -> tuple[Resource, ...]:
        """Everything that was made and not freed."""
        return tuple(thing for _, thing in self._made.values())

    def clear(self) -> None:
        """Free everything; what is wanted next is made anew."""
        for name in list(self._made):
            self.drop(name)

    def drop_but(self, *kept: str) -> None:
        """Free everything but the resources of these names."""
        for name in self._made.keys() - set(kept):
            self.drop(name)

    def get(self, name: str, inputs: object, make: Callable[[], Made]) -> Made:
        """The resource called `name`, made of these `inputs`, which are compared by ==."""
        found = self._made.get(name)
        if found is not None and found[0] == inputs:
            return found[1]  # type: ignore[return-value]  # a name stands for one kind of resource
        self.drop(name)
        made = make()
        self._made[name] = inputs, made
        return made

    def find(self, name: str, kind: type[Made]) -> Made | None:
        """The resource of this name and type as it is; None where it has not been made."""
        _, thing = self._made.get(name, (None, None))
        return thing if isinstance(thing, kind) else None

    def drop(self, name: str) -> None:
        """Free the resource of this name, if there is one."""
        _, thing = self._made.pop(name, (None, None))
        if thing is not None:
            thing.release()
