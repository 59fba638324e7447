"""The settings: declared once, checked at the border, and the same in the README as in the code."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.settings import PRESETS, SETTINGS, Declaration, Settings, SettingValues, preset
from tests.support.programs import program

ROOT = Path(__file__).resolve().parents[2]


def test_the_tables_of_the_reference_are_current() -> None:
    text = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    assert program("tables").filled(text) == text, "run: python docs/programs/tables.py"


@pytest.mark.parametrize("declaration", SETTINGS.values(), ids=SETTINGS)
def test_defaults_are_legal_and_ranges_hold(declaration: Declaration) -> None:
    assert declaration.check(declaration.default) == declaration.check(np.array(declaration.default)[()]) == declaration.default
    assert declaration.help
    if declaration.low is not None and declaration.high is not None:
        for value in (declaration.low, declaration.high):
            assert declaration.check(type(declaration.low)(value)) == value
        for value in (declaration.low - 1, declaration.high + 1):
            with pytest.raises(InputError, match=declaration.name):
                declaration.check(value)
    refused: tuple[object, ...] = (float("nan"), float("inf"), None, [], "nonsense")
    for wrong in refused:
        with pytest.raises(InputError, match=declaration.name):
            declaration.check(wrong)


@pytest.mark.parametrize("declaration", SETTINGS.values(), ids=SETTINGS)
def test_words_that_are_no_value(declaration: Declaration) -> None:
    for text in ("", "nonsense", "nan", "inf", "-inf", "1e999"):
        with pytest.raises(InputError, match=f"({declaration.flag}|'{declaration.name}') takes"):
            declaration.parse(text)


def test_words_that_are_values() -> None:
    assert SETTINGS["a"].parse("0.3") == 0.3
    assert SETTINGS["seed"].parse("7") == 7
    assert SETTINGS["tolerance"].parse("AUTO") == "auto"
    assert (SETTINGS["bounces"].parse("All"), SETTINGS["bounces"].parse("3")) == ("all", 3)
    assert SETTINGS["gradients"].parse("on") is True
    assert SETTINGS["gather"].parse("plane") == "plane"


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_legal_and_overrides_win(name: str) -> None:
    assert asdict(preset(name)) == asdict(Settings()) | PRESETS[name]
    assert preset(name, a=0.7).a == 0.7


def test_auto_tolerance_is_one_over_a() -> None:
    assert preset(a=0.25).threshold == 4.0
    assert preset(a=0.25, tolerance=9).threshold == 9.0


def test_all_bounces_are_as_many_as_the_range_has() -> None:
    assert [preset(bounces=n).most_bounces for n in (0, 1, 7, "all")] == [0, 1, 7, 64]
    assert preset().bounces == "all" and preset("paper").bounces == 1
    with pytest.raises(InputError, match=r"'bounces' takes 0..64 or all, not 'auto'"):
        preset(bounces="auto")  # type: ignore[arg-type]


def test_the_keywords_for_type_checkers_are_the_settings() -> None:
    assert get_type_hints(SettingValues) == get_type_hints(Settings)
    assert list(SettingValues.__annotations__) == list(SETTINGS)


def test_unknown_names() -> None:
    with pytest.raises(InputError, match=r"setting 'walls' was removed: .*; leave it out"):
        Settings().with_values({"walls": True})
    with pytest.raises(InputError, match="setting 'kernel' was removed: the setting weights replaces it, hessian for smooth"):
        Settings().with_values({"kernel": "cut"})
    with pytest.raises(InputError, match="setting 'overture' was removed: its name is fill_holes now"):
        preset(overture=False)  # type: ignore[call-arg]
    with pytest.raises(InputError, match=r"takes auto\|plane\|trace\|embree, not 'raster'; 'raster' was removed: rays see"):
        preset(gather="raster")
    with pytest.raises(InputError, match="unknown preset 'fast'; the presets are default"):
        preset("fast")
    with pytest.raises(InputError, match="unknown setting 'alpha'"):
        preset(alpha=1)  # type: ignore[call-arg]
