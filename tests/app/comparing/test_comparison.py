"""Both sides of a split in one place: one after the other, their difference in numbers, and FLIP."""

from __future__ import annotations

import time

import numpy as np
import pytest

from irrsplat.app.verify import error_image
from irrsplat.app.viewer.buffers.shown_buffer import GROUND
from irrsplat.app.viewer.buffers.truth import NO_TRUTH
from irrsplat.app.viewer.show import comparison as comparisons
from irrsplat.app.viewer.view_options import Compare
from irrsplat.image.frame import Frame
from irrsplat.image.tonemap import viridis
from irrsplat.image.view import read
from tests.support.viewing import Driver, Tracer


def buffers(driver: Driver, left: str, right: str, compare: Compare = "divided") -> None:
    """Two buffers of the same view, compared in this way."""
    driver.session.split("buffers")
    driver.session.options.buffers = [left, right]
    driver.session.options.compare = compare
    driver.frame()


def alone(driver: Driver, name: str) -> np.ndarray:
    """The picture of a buffer that is shown alone."""
    driver.session.split("off")
    driver.actions.show(name)
    driver.frame()
    return driver.canvas()


def wait_for_flip(driver: Driver) -> np.ndarray:
    """The map, (H, W), top row first, once it is computed and shown."""
    flip = driver.display.comparison.flip
    for _ in range(400):
        driver.frame()
        if flip.texture is not None and not flip.working:
            driver.frame()
            width, height = flip.texture.size
            return np.frombuffer(flip.texture.read(), "f4").reshape(height, width)[::-1]
        time.sleep(0.01)
    pytest.fail("no FLIP after 400 frames")


# ---- one after the other ---------------------------------------------------------------------------------------------------


def test_the_sides_take_turns_twice_a_second(driver: Driver) -> None:
    pictures = [alone(driver, "image"), alone(driver, "irradiance")]
    buffers(driver, "image", "irradiance")
    driver.actions.compare_by("flip")
    shown = []
    for _ in range(45):
        driver.frame(dt=0.05)
        shown.append(next(i for i, picture in enumerate(pictures) if np.array_equal(picture, driver.canvas())))
        assert driver.session.side_at(0) == driver.session.side_at(driver.wnd.width - 1) == shown[-1]
    turns = np.flatnonzero(np.diff(shown)) + 1
    assert len(turns) == 4 and (np.diff(turns) == 10).all() and shown[0] == 0


# ---- the difference --------------------------------------------------------------------------------------------------------


def array(frame: Frame, name: str) -> np.ndarray:
    """(H, W, channels) a buffer of a frame."""
    values: np.ndarray = getattr(frame, name)
    return values if values.ndim == 3 else values[..., None]


@pytest.mark.slow
def test_the_difference_of_two_presets_is_what_the_buffers_say(driver: Driver) -> None:
    """Of every kind of buffer: in the colours of the scale, and by number under the cursor."""
    driver.split_presets()
    frames = [read(view, r.cache.read(), {}) for r, view in zip(driver.session.renderers, driver.session.views, strict=True)]
    seen = np.isfinite(frames[0].depth)
    driver.session.options.compare = "difference"
    some = False
    for name in ("image", "direct", "indirect", "irradiance", "weight", "depth", "normal", "albedo", "alpha"):
        driver.session.options.buffers = [name, name]
        driver.frame()
        left, right = (np.nan_to_num(array(frame, name), posinf=0.0) for frame in frames)
        expected = np.abs(left - right).mean(axis=-1)
        legend = driver.display.comparison.legend()
        colours = np.where(
            (seen | (name in ("image", "alpha")))[..., None], viridis(np.clip(expected / float(legend.high), 0, 1)), GROUND
        )
        off = np.abs(driver.canvas() / 255.0 - colours).max(axis=-1)
        assert (off < 0.02).mean() > 0.999, f"{name}: {off.max()}"
        some |= bool((expected > 0.2 * float(legend.high)).any())
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


def test_nothing_differs_from_itself(driver: Driver) -> None:
    buffers(driver, "image", "image", "difference")
    assert np.allclose(driver.canvas() / 255.0, viridis(np.zeros(1))[0], atol=0.01)
    value = driver.display.value(0, (160, 120))
    assert value is not None and value[0] == 0.0


# ---- FLIP ------------------------------------------------------------------------------------------------------------------


def test_flip_is_that_of_the_pictures(driver: Driver) -> None:
    """The same mean and map as FLIP of the two pictures alone; and anew once one is another."""
    pytest.importorskip("flip_evaluator")
    pictures = {name: alone(driver, name) / np.float32(255.0) for name in ("image", "direct", "irradiance")}
    for right in ("direct", "irradiance"):
        buffers(driver, "image", right, "FLIP")
        driver.settle()
        found = wait_for_flip(driver)
        known = error_image.flip(pictures[right], pictures["image"])
        assert known is not None and driver.display.comparison.flip.mean == pytest.approx(known[1], abs=2e-3)
        assert found.mean() == pytest.approx(known[1], abs=2e-3)
        assert np.abs(driver.canvas() / 255.0 - viridis(found)).max() < 0.02
        assert f"mean {driver.display.comparison.flip.mean:.4f}" in driver.display.comparison.legend().text
        value = driver.display.value(0, (160, 120))
        assert value is not None and value[0] == pytest.approx(found[120, 160], abs=1e-6)


def test_flip_against_the_truth_is_by_the_pixels_that_are_traced(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("flip_evaluator")
    tracer = Tracer(monkeypatch, early=2)
    buffers(driver, "irradiance", "reference", "FLIP")
    driver.settle()
    assert driver.display.comparison.legend().text == NO_TRUTH and not driver.display.comparison.flip.working
    driver.actions.trace()
    tracer.wait(driver)
    found = wait_for_flip(driver)
    (truth,) = driver.session.truths.kept
    assert found.shape[::-1] == truth.lattice.count and truth.lattice.stride > 1
    pictures = []
    for name in ("irradiance", "reference"):
        picture = alone(driver, name) / np.float32(255.0)
        places = [truth.lattice.middle((i, i), truth.size) for i in range(max(truth.lattice.count))]
        columns, rows = [x for x, _ in places][: found.shape[1]], [y for _, y in places][: found.shape[0]]
        pictures.append(picture[np.ix_(rows, columns)])
    import flip_evaluator

    size = {"ppd": error_image.PIXELS_PER_DEGREE / truth.lattice.stride}
    _, mean, _ = flip_evaluator.evaluate(*(np.ascontiguousarray(p) for p in pictures[::-1]), "LDR", parameters=size)
    assert float(found.mean()) == pytest.approx(float(mean), abs=2e-3)

    buffers(driver, "irradiance", "reference", "difference")
    driver.frame()
    assert "no difference yet" in driver.display.comparison.legend().text
    assert driver.display.comparison.value(160, 120) is None
    tracer.finish(driver)
    buffers(driver, "irradiance", "reference", "FLIP")
    driver.settle()
    driver.frame(2)
    assert wait_for_flip(driver).shape == driver.session.size[::-1], "of the latest pass, which is over all pixels"
    buffers(driver, "irradiance", "reference", "difference")
    driver.frame(2)
    E, E_ref = driver.session.frame().irradiance, driver.session.truths.kept[0].estimate.irradiance
    value = driver.display.value(0, (160, 120))
    assert value is not None and value[0] == pytest.approx(np.abs(E - E_ref)[120, 160].mean(), rel=1e-4)


def test_without_the_package_flip_is_left_out(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparisons, "find_spec", lambda name: None)
    buffers(driver, "image", "direct", "FLIP")
    assert "pip install" in driver.display.comparison.legend().text and not driver.display.comparison.flip.working
    buffers(driver, "irradiance", "reference", "difference")
    driver.actions.compare()
    assert driver.session.options.compare == "divided"
    driver.resize((480, 400), density=0.25)  # so that the menu is all there
    driver.frame(2)
    driver.choose("Compare", "FLIP: what an eye sees of it")
    assert driver.session.options.compare == "divided", "it is greyed out"
    driver.click(20.0, 390.0)  # closes the menu
    driver.frame(2)
