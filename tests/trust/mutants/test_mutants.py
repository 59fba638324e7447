"""Each deliberate fault has its place in the code, and its test. That the tests find them: `run.py`, which takes hours."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.trust.mutants.mutants import MUTANTS, Mutant

REPOSITORY = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_fault_has_its_place_and_its_test(mutant: Mutant) -> None:
    assert (REPOSITORY / mutant.file).read_text(encoding="utf-8").count(mutant.old) == 1
    for test in mutant.tests:
        file, _, name = test.partition("::")
        source = (REPOSITORY / file).read_text(encoding="utf-8")
        assert not name or re.search(rf"^def {re.escape(name.partition('[')[0])}\(", source, re.M), test
