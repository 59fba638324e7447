"""Cases of CIE 171:2006 against closed forms; docs/programs/cie.py derives them."""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.programs import program


@pytest.mark.parametrize("case", program("cie").CASES, ids=lambda case: f"{case.clause} {case.what}")
def test_a_case_of_the_cie(case: Any) -> None:
    found, truth = case.find()
    assert found == pytest.approx(truth, rel=case.goal)
