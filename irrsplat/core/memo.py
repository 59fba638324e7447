"""A memo of stages: results that hold while their inputs are equal."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from irrsplat.core.timing.input_waits import stop_for_input

T = TypeVar("T")


class Memo:
    """Results of stages by name, each valid until its inputs change.

    Inputs are compared by ==: values, or objects equal only to themselves (bundles of GPU handles, meshes).
    """

    def __init__(self) -> None:
        self._made: dict[str, tuple[object, object]] = {}

    def get(self, stage: str, inputs: object, make: Callable[[], T]) -> T:
        """Return the stage's result for these inputs, made by `make` if the inputs have changed.

        The old result is dropped before `make` begins, which may overwrite it. The new one counts as current only after `make`
        has returned, so an interruption leaves no invalid result. Raises InputWaits after `make` if input waits: the result is
        kept for the next call.
        """
        found = self._made.get(stage)
        if found is not None and found[0] == inputs:
            return found[1]  # type: ignore[return-value]  # a stage has one kind of result
        self._made.pop(stage, None)
        made = make()
        self._made[stage] = inputs, made
        stop_for_input()
        return made

    def current(self, stage: str, kind: type[T]) -> T | None:
        """Return the stage's present result of this type, or None."""
        _, found = self._made.get(stage, (None, None))
        return found if isinstance(found, kind) else None

    def holds(self, stage: str, inputs: object) -> bool:
        """True if the stage has a result for these inputs."""
        return stage in self._made and self._made[stage][0] == inputs

    def forget(self, *, but: tuple[str, ...] = ()) -> None:
        """Drop all results `but` those of these stages."""
        self._made = {stage: made for stage, made in self._made.items() if stage in but}
