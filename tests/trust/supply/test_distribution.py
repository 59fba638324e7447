"""The short form of distribution.py, without the net: the long one builds, installs and runs irrsplat in new environments."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import irrsplat
from tests.trust.supply import distribution

ROOT = Path(__file__).resolve().parents[3]
OFFERED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]


def test_nothing_of_one_system_is_taken_for_granted() -> None:
    (line,) = distribution.assumptions()
    assert re.match(r"\d{3} shaders", line)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("#version 430\n", True),
        ("layout(local_size_x = 8) in;", True),
        ("layout(binding = 1) uniform sampler2D t;", True),
        ("#version 330\nlayout(location = 0) out vec4 c;", False),
    ],
)
def test_shaders_beyond_opengl_4_1_are_noticed(text: str, found: bool) -> None:
    assert bool(distribution.BEYOND.search(text)) == found


def test_every_extra_is_tried_and_all_has_those_of_users() -> None:
    assert set(OFFERED) - {"all"} <= set(distribution.NEEDS)
    assert set(distribution.in_all()) == set(OFFERED) - {"all", "dev", "docs", "embree"}


def test_the_version_is_one_and_the_changelog_has_it() -> None:
    version = distribution.PROJECT["version"]
    assert irrsplat.__version__ == version
    assert re.search(rf"^version: {re.escape(version)}$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    log = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"^## (\d+\.\d+\.\d+) - (\d{4}-\d\d-\d\d)$", log, re.M)
    assert released[0][0] == version
    numbers = [tuple(map(int, one.split("."))) for one, _ in released]
    days = [day for _, day in released]
    assert numbers == sorted(numbers, reverse=True) and days == sorted(days, reverse=True)
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}  # of Keep a Changelog
    assert set(re.findall(r"^### (.*)$", log, re.M)) <= kinds
    assert set(re.findall(r"^## (.*)$", log, re.M)) <= {"Unreleased", *(f"{one} - {day}" for one, day in released)}
