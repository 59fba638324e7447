"""The renderer against path-traced truth of all bounces: what the project promises for its default preset, on 400×400 pixels."""

from __future__ import annotations

import pytest

import irrsplat
from tests.reference.test_truth import FAILURES, keep
from tests.support.truth import SIZE, compare, load_reference


@pytest.mark.parametrize(("name", "rmse"), [("cornell", 0.05), ("curved", 0.06)])
def test_default_preset_is_near_the_truth_of_all_bounces(name: str, rmse: float) -> None:
    reference = load_reference(name)
    frame = irrsplat.render(irrsplat.load(name), size=(SIZE, SIZE), bounces="all")
    found = compare(frame, reference, "all")
    wrong = [f"{k} {found[k]:+.2%}, allowed {v:.1%}" for k, v in {"rmse": rmse, "bias": 0.02}.items() if not abs(found[k]) <= v]
    if wrong:
        keep(name, frame, reference, "all")
    assert not wrong, f"{name}: {'; '.join(wrong)} (all: {found}; pictures in {FAILURES})"


def test_one_bounce_is_far_from_the_truth_of_all() -> None:
    """What is tested above could fail: with one bounce more than a third of the light is missing."""
    reference = load_reference("cornell")
    frame = irrsplat.render(irrsplat.load("cornell"), size=(SIZE, SIZE), bounces=1)
    assert compare(frame, reference, "all")["bias"] < -0.3
