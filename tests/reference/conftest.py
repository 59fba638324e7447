"""Fixtures that tests of the reference share."""

from __future__ import annotations

from typing import Any

import pytest

from irrsplat.core.errors import IrrsplatError


@pytest.fixture(scope="module")
def mitsuba() -> Any:
    """The module of the tracer, in a variant that runs here."""
    pytest.importorskip("mitsuba")
    from irrsplat.reference import path_tracer

    try:
        path_tracer.choose_variant()
    except IrrsplatError as error:
        pytest.skip(str(error))
    return path_tracer
