"""Dependencies have a least version, an acceptable licence, and an exact version in CI."""

from __future__ import annotations

from tests.trust.dependencies import LOCK, SILENT, allowed, declared, installed, least, licence, named, needed


def parts(version: str) -> list[int]:
    """Return the numbers of a version, for comparisons."""
    return [int(part) for part in version.split(".") if part.isdigit()]


def test_each_requirement_has_a_least_version_and_one_in_ci() -> None:
    lines = LOCK.read_text(encoding="utf-8").splitlines()
    locked = dict(line.split("==") for line in lines if line and not line.startswith("#"))
    assert {named(one) for one in declared()} | set(needed()) - {"irrsplat"} <= set(locked), (
        "run: tests/trust/dependencies.py lock"
    )
    for requirement in declared():
        for version in (locked[named(requirement)], installed(named(requirement))):
            assert not version or parts(version) >= parts(least(requirement)), requirement


def test_licences_require_at_most_a_notice() -> None:
    found = {name: licence(name) for name in needed() if name not in SILENT}
    assert len(found) > 20 and [name for name, words in found.items() if not allowed(words)] == []
