"""Both sides of a split in one place: their difference in numbers."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.app.viewer.buffers.shown_buffer import GROUND
from irrsplat.app.viewer.view_options import Compare
from irrsplat.image.tonemap import viridis
from irrsplat.image.view import read
from tests.support.viewing import Driver


def buffers(driver: Driver, left: str, right: str, compare: Compare = "divided") -> None:
    """Two buffers of the same view, compared in this way."""
    driver.session.split("buffers")
    driver.session.options.buffers = [left, right]
    driver.session.options.compare = compare
    driver.frame()


def test_the_difference_of_two_presets_is_what_the_buffers_say(driver: Driver) -> None:
    """The picture has the colours of the scale, and the pixel under the cursor the number."""
    driver.split_presets()
    frames = [read(view, r.cache.read(), {}) for r, view in zip(driver.session.renderers, driver.session.views, strict=True)]
    seen = np.isfinite(frames[0].depth)
    driver.session.options.compare = "difference"
    some = False
    for name in ("image", "irradiance", "depth"):
        driver.session.options.buffers = [name, name]
        driver.frame()
        left, right = (np.nan_to_num(np.atleast_3d(getattr(frame, name)), posinf=0.0) for frame in frames)
        expected = np.abs(left - right).mean(axis=-1)
        high = float(driver.display.comparison.legend().high)
        colours = np.where((seen | (name == "image"))[..., None], viridis(np.clip(expected / high, 0, 1)), GROUND)
        off = np.abs(driver.canvas() / 255.0 - colours).max(axis=-1)
        assert (off < 0.02).mean() > 0.999, f"{name}: {off.max()}"
        some |= bool((expected > 0.2 * high).any())
        for x, y in ((60, 120), (200, 180), (150, 40)):
            if seen[y, x]:
                value = driver.display.value(0, (x, y))
                assert value is not None and float(value[0]) == pytest.approx(float(expected[y, x]), rel=1e-4, abs=1e-5), name
    assert some


def test_buffers_of_different_kinds_have_no_difference(driver: Driver) -> None:
    for left, right in (("image", "normal"), ("image", "irradiance"), ("shadow", "shadow"), ("weight", "normal")):
        buffers(driver, left, right, "difference")
        assert "no difference" in driver.display.comparison.legend().text
        assert np.allclose(driver.canvas() / 255.0, GROUND, atol=0.003)
        assert driver.display.value(0, (160, 120)) is None
