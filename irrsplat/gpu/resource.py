"""Ownership of GPU resources: each owner lists the resources that it frees."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property, partial
from typing import Protocol, Self, TypeVar
from weakref import finalize

import moderngl

from irrsplat.gpu import context
from irrsplat.scene.model.checks import check_type


class Resource(Protocol):
    """Anything with `release`: textures, buffers, programs, and their owners."""

    def release(self) -> object:
        """Free it."""


Made = TypeVar("Made", bound=Resource)


def _free(things: Iterable[Resource | None]) -> None:
    for thing in things:
        if thing is not None:
            thing.release()


class Owner:
    """An owner of resources, freed at the end of a `with` block or by `release`; resources of others are not listed.

    An owner that replaces resources overrides `owned`. Others pass each resource to `own`.
    """

    @cached_property
    def _own(self) -> list[Resource]:
        """The resources passed to `own`."""
        return []

    def own(self, thing: Made) -> Made:
        """Return `thing`, which `release` frees from now on."""
        self._own.append(thing)
        return thing

    def owned(self) -> Sequence[Resource | None]:
        """Return the resources that `release` frees; None for one not made yet."""
        return tuple(self._own)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free all owned resources; a second call does nothing."""
        _free(self.owned())


class Tenant(Owner):
    """An owner with an OpenGL context: its own, freed with it, or a caller's, which the caller makes current.

    When nothing refers to it any more, its own context is freed, or its first resources in a caller's context.
    """

    ctx: moderngl.Context
    about: context.Description
    _owns_ctx: bool
    _native: tuple[int, ...]  # the system's handles of a given context
    _end: finalize[..., Tenant]

    @contextmanager
    def _moving_in(self, ctx: moderngl.Context | None) -> Iterator[None]:
        """Own resources made in `ctx` (None: a new context); all are freed if the block fails."""
        check_type("ctx", ctx, moderngl.Context, None)
        self._owns_ctx = ctx is None
        self.ctx = ctx or context.create()
        self._native = context.current()
        if not self._owns_ctx:
            context.free_deferred(self.ctx)
        with ExitStack() as made:
            if self._owns_ctx:
                made.callback(self.ctx.release)
            made.callback(super().release)
            self.about = context.describe(self.ctx)
            yield
            made.pop_all()
        free = self.ctx.release if self._owns_ctx else partial(_free, self._own)
        self._end = finalize(self, context.free_or_defer, self.ctx, self._native, free)
        self._end.atexit = False

    def _use(self) -> None:
        """Make the owned context current; a given one is made current by its owner.

        Raises GLError if the context has been released, was made in another thread or process, or is given and not current.
        """
        context.check_alive(self.ctx)
        if self._owns_ctx:
            context.make_current(self.ctx)
        else:
            context.check_current(self._native)
            context.free_deferred(self.ctx)

    def release(self) -> None:
        """Free all GPU resources, and the context if it is owned; a second call does nothing."""
        if context.is_gone(self.ctx):
            return
        if self.ctx.extra:  # made by context.create, so it can be made current here, whoever owns it
            context.make_current(self.ctx)
        self._use()
        self._end.detach()
        if self._owns_ctx:
            self.ctx.release()
        else:
            super().release()


class Workshop(Owner):
    """Resources made at first use, and replaced when their inputs change."""

    def __init__(self) -> None:
        self._made: dict[str, tuple[object, Resource]] = {}

    def owned(self) -> tuple[Resource, ...]:
        """Return the resources that have been made and not freed."""
        return tuple(thing for _, thing in self._made.values())

    def clear(self) -> None:
        """Free all resources; each is made again at its next use."""
        for name in list(self._made):
            self.drop(name)

    def get(self, name: str, inputs: object, make: Callable[[], Made]) -> Made:
        """Return the resource `name`, made of `inputs`, which are compared by ==."""
        found = self._made.get(name)
        if found is not None and found[0] == inputs:
            return found[1]  # type: ignore[return-value]  # a name stands for one kind of resource
        self.drop(name)
        made = make()
        self._made[name] = inputs, made
        return made

    def find(self, name: str, kind: type[Made]) -> Made | None:
        """Return the resource of this name and type, or None if it has not been made."""
        _, thing = self._made.get(name, (None, None))
        return thing if isinstance(thing, kind) else None

    def drop(self, name: str) -> None:
        """Free the resource of this name, if it exists."""
        _, thing = self._made.pop(name, (None, None))
        if thing is not None:
            thing.release()
