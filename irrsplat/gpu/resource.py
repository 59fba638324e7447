"""Who owns what on the GPU: an owner lists what it frees, in the open."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Protocol, Self, TypeVar
from weakref import finalize

import moderngl

from irrsplat.gpu import context


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


class Tenant(Owner):
    """Owns what it makes in an OpenGL context: a caller's, who makes it current, or one of its own, which is freed with it.
    When nothing refers to a tenant any more, what is in its own context is freed, or what it has made at first in a caller's."""

    ctx: moderngl.Context
    about: context.Description
    _owns_ctx: bool
    _native: tuple[int, ...]  # a given context, as the system knows it
    _end: finalize[..., Tenant]

    @contextmanager
    def _moving_in(self, ctx: moderngl.Context | None) -> Iterator[ExitStack]:
        """A `with` block that makes what is owned in `ctx` (None: in a new context), and enters it into the stack: all of that is
        freed where the block fails."""
        self._owns_ctx = ctx is None
        self.ctx = ctx or context.create()
        self._native = context.current()
        if not self._owns_ctx:
            context.free_left(self.ctx)
        with ExitStack() as made:
            if self._owns_ctx:
                made.callback(self.ctx.release)
            self.about = context.describe(self.ctx)
            yield made
            free = self.ctx.release if self._owns_ctx else made.pop_all().close
            made.pop_all()
        self._end = finalize(self, context.leave, self.ctx, self._native, free)
        self._end.atexit = False

    def _use(self) -> None:
        """Make its own OpenGL context the current one; a given one is its owner's to make current. Raises GLError where it has
        been released, where an own one was made in another thread or process, and where a given one is not current."""
        context.check_alive(self.ctx)
        if self._owns_ctx:
            context.make_current(self.ctx)
        else:
            context.check_current(self._native)
            context.free_left(self.ctx)

    def release(self) -> None:
        """Free everything on the GPU, the context too where it was made for this; twice does no harm."""
        if context.is_gone(self.ctx):
            return
        if self.ctx.extra:  # made by context.create, so that it can be made current here, whoever owns it
            context.make_current(self.ctx)
        self._use()
        self._end.detach()
        if self._owns_ctx:
            self.ctx.release()
        else:
            super().release()


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
