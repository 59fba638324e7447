"""The memo: results hold exactly as long as their inputs do, and an interrupted stage is not current."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irrsplat.core.memo import Memo
from irrsplat.scene.model import Mesh, Scene


def test_a_result_holds_until_its_inputs_differ() -> None:
    memo = Memo()
    made: list[tuple[object, ...]] = []

    def get(*inputs: object) -> object:
        def make() -> object:
            made.append(inputs)
            return object()

        return memo.get("stage", inputs, make)

    first = get(1, (2.0, "x"))
    assert get(1, (2.0, "x")) is first and memo.get("stage", (1, (2.0, "x")), object) is first
    second = get(1, (3.0, "x"))
    assert second is not first and get(1, (2.0, "x")) not in (first, second), "only the last result is kept"
    assert made == [(1, (2.0, "x")), (1, (3.0, "x")), (1, (2.0, "x"))]


def test_stages_do_not_share_results() -> None:
    memo = Memo()
    assert memo.get("a", (), lambda: "of a") == "of a" and memo.get("b", (), lambda: "of b") == "of b"
    assert (memo.current("a", str), memo.current("c", str), memo.current("a", int)) == ("of a", None, None)
    memo.forget()
    assert memo.current("a", str) is None


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_a_stage_that_was_interrupted_is_not_current(error: type[BaseException]) -> None:
    """Neither by the new inputs nor by the old ones, over whose result it may have drawn."""
    memo = Memo()
    memo.get("stage", 1, lambda: "old")

    def interrupted() -> str:
        raise error

    with pytest.raises(error):
        memo.get("stage", 2, interrupted)
    assert memo.current("stage", str) is None and not memo.holds("stage", 1) and not memo.holds("stage", 2)
    assert memo.get("stage", 1, lambda: "made anew") == "made anew"


def test_meshes_and_bundles_of_handles_are_inputs_by_identity() -> None:
    """Arrays have no single answer to ==; a mesh, and what holds meshes, compares without asking them."""
    triangle = Mesh(np.eye(3, dtype="f4"), np.eye(3, dtype="f4"), np.array([[0, 1, 2]]))
    scene, memo = Scene((triangle,), (), ()), Memo()
    first = memo.get("stage", (scene, 1), object)
    assert memo.get("stage", (Scene((triangle,), (), ()), 1), object) is first
    assert memo.get("stage", (replace(scene, meshes=(replace(triangle),)), 1), object) is not first
