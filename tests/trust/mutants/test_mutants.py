"""Each fault has one place in the shaders and a test; the long form runs these tests."""

from __future__ import annotations

import re

import pytest

from tests.trust.mutants.mutants import MUTANTS
from tests.trust.mutants.run import REPOSITORY, missed


def test_each_fault_has_one_place_and_a_test() -> None:
    places = {mutant.name: len(list(mutant.made(REPOSITORY / "shaders"))) for mutant in MUTANTS}
    assert len(places) == len(MUTANTS) >= 40 and set(places.values()) == {1}, places
    for mutant in MUTANTS:
        file, _, name = mutant.test.partition("::")
        source = (REPOSITORY / file).read_text(encoding="utf-8")
        assert re.search(rf"^def {name.partition('[')[0] or 'test_'}", source, re.M), mutant


@pytest.mark.long
def test_the_tests_find_each_fault() -> None:
    assert not missed(MUTANTS)
