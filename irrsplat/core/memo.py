"""A memo of stages: results that hold until what they were made of is something else."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from irrsplat.core.timing.input_waits import stop_for_input

T = TypeVar("T")


class Memo:
    """Results of stages by name, each kept until its inputs are others: the one place that knows what is current.

    Inputs are compared by ==, so that they are values, or things that are equal to nothing but themselves (bundles of GPU
    handles, meshes).
    """

    def __init__(self) -> None:
        self._made: dict[str, tuple[object, object]] = {}

    def get(self, stage: str, inputs: object, make: Callable[[], T]) -> T:
        """The stage's result for these inputs, made by `make` where the present one was made of others.

        The old result is forgotten before `make` begins, since it may draw over it, and the new one counts as current only once
        `make` has returned: whoever interrupts it leaves nothing that counts as current and is not. Raises InputWaits after
        `make` where input waits: the result is kept for the next call.
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
        """The stage's present result, of this type; None where there is none."""
        _, found = self._made.get(stage, (None, None))
        return found if isinstance(found, kind) else None

    def holds(self, stage: str, inputs: object) -> bool:
        """Whether the stage has a result, made of these inputs."""
        return stage in self._made and self._made[stage][0] == inputs

    def forget(self, *, but: tuple[str, ...] = ()) -> None:
        """Make everything anew when it is wanted next, `but` for these stages."""
        self._made = {stage: made for stage, made in self._made.items() if stage in but}
