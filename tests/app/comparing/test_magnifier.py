"""The magnifier: while its key is down, the pixels around the cursor are squares, and the one in the middle has its value."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.app.viewer.show.magnifier import COUNT, ZOOM, place
from irrsplat.app.viewer.show.screen import Screen
from tests.support.viewing import Driver

SIDE = ZOOM * COUNT


@pytest.mark.parametrize("cursor", [(160, 119), (155, 125), (10, 5), (319, 239)])
def test_each_pixel_is_a_square(driver: Driver, cursor: tuple[int, int]) -> None:
    """Of the picture under the interface, the one under the cursor in the middle, also at the window's edges."""
    canvas, window = driver.canvas(), Screen(driver.wnd.fbo, driver.wnd.buffer_size)
    driver.viewer.copy(driver.viewer.canvas, window)
    driver.viewer.magnifier.draw(window, driver.viewer.canvas.textures[0], cursor)
    left, bottom, width, height = place(driver.wnd.buffer_size, cursor)
    assert (width, height) == (SIDE, SIDE) and 0 <= left <= 320 - SIDE and 0 <= bottom <= 240 - SIDE
    top = 240 - bottom - SIDE
    shown = driver.window()[top : top + SIDE, left : left + SIDE]
    assert (shown[0] == 255).all() and (shown[:, 0] == 255).all(), "the frame"
    centres = shown[ZOOM // 2 :: ZOOM, ZOOM // 2 :: ZOOM]
    corners = shown[ZOOM - 2 :: ZOOM, 1::ZOOM]  # inside of any outline
    rows, columns = (
        np.clip(at + np.arange(COUNT) - COUNT // 2, 0, most - 1) for at, most in zip(cursor[::-1], (240, 320), strict=True)
    )
    expected = canvas[np.ix_(rows, columns)]
    assert np.array_equal(centres, expected) and np.array_equal(corners, expected)
    middle = COUNT // 2 * ZOOM
    outline = shown[middle, middle : middle + ZOOM]
    assert (outline == (255 if expected[COUNT // 2, COUNT // 2].mean() < 127.5 else 0)).all(), "around the one under the cursor"
    outside = driver.window()
    outside[top : top + SIDE, left : left + SIDE] = canvas[top : top + SIDE, left : left + SIDE]
    assert np.array_equal(outside, canvas), "nothing else is touched"


def test_it_is_there_while_the_key_is_down(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the value of the shown buffer; neither where the interface has the cursor nor after the key went up."""
    driver.actions.show("depth")
    driver.move(160.0, 120.0)
    driver.frame(2)
    plain, said = driver.window(), []
    text = driver.viewer.interface.legends._value

    def told(side: int, cursor: tuple[int, int]) -> str:
        said.append((side, cursor))
        return text(side, cursor)

    monkeypatch.setattr(driver.viewer.interface.legends, "_value", told)
    driver.down("U")
    driver.frame(2)
    value = driver.display.value(0, (160, 120))
    assert value is not None and text(0, (160, 120)) == f"{value[0]:.4g} m"
    assert said == 4 * [(0, (160, 120))], "in the legend, and below the magnifier, for two frames"
    assert (driver.window() != plain).any(-1).sum() > 0.5 * SIDE**2
    driver.move(160.0, 5.0)  # over the menus
    driver.frame(2)
    assert driver.viewer.controls.pointer is None
    driver.move(160.0, 120.0)
    driver.up("U")
    driver.frame(2)
    assert np.array_equal(driver.window(), plain)
