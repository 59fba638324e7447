"""What is needed from others has a least version, a licence that can be lived with, and an exact version in CI."""

from __future__ import annotations

import pytest

from tests.trust.dependencies import LOCK, SILENT, allowed, declared, installed, least, licence, named, needed


def parts(version: str) -> list[int]:
    """The numbers of a version, of which tuples compare."""
    return [int(part) for part in version.split(".") if part.isdigit()]


def locked() -> dict[str, str]:
    lines = LOCK.read_text(encoding="utf-8").splitlines()
    return dict(line.split("==") for line in lines if line and not line.startswith("#"))


@pytest.mark.parametrize("requirement", declared())
def test_a_requirement_has_a_least_version_and_one_in_ci(requirement: str) -> None:
    name = named(requirement)
    assert name in locked(), f"{name} has no version in {LOCK.name}: run tests/trust/dependencies.py lock"
    for version in (locked()[name], installed(name)):
        assert not version or parts(version) >= parts(least(requirement))


def test_what_others_need_has_a_version_in_ci_as_well() -> None:
    assert set(needed()) - {"irrsplat"} <= set(locked())


@pytest.mark.parametrize("name", list(needed()))
def test_licences_ask_for_no_more_than_a_notice(name: str) -> None:
    assert allowed(licence(name)) or name in SILENT, f"{name}: {licence(name) or 'no licence is named'}"
