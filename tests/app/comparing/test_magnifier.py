"""The magnifier: while its key is down, the pixels around the cursor are squares."""

from __future__ import annotations

import numpy as np

from irrsplat.app.viewer.show.magnifier import COUNT, ZOOM, place
from tests.support.viewing import Driver

SIDE = ZOOM * COUNT


def test_each_pixel_around_the_cursor_is_a_square_while_the_key_is_down(driver: Driver) -> None:
    """The squares are pixels of the picture under the interface, at the window's edge too."""
    driver.session.options.frozen = True
    for cursor in ((160, 119), (315, 119)):
        driver.move(*cursor)
        driver.frame(2)
        plain, canvas = driver.window(), driver.canvas()
        driver.down("U")
        driver.frame(2)
        left, bottom, width, height = place(driver.wnd.buffer_size, cursor)
        assert (width, height) == (SIDE, SIDE) and 0 <= left <= 320 - SIDE and 0 <= bottom <= 240 - SIDE
        top = 240 - bottom - SIDE
        shown = driver.window()[top : top + SIDE, left : left + SIDE]
        rows, columns = (
            np.clip(at + np.arange(COUNT) - COUNT // 2, 0, most - 1) for at, most in zip(cursor[::-1], (240, 320), strict=True)
        )
        expected = canvas[np.ix_(rows, columns)]
        same = (shown[ZOOM // 2 :: ZOOM, ZOOM // 2 :: ZOOM] == expected).all(-1)
        assert same[COUNT // 3 : -COUNT // 3].mean() > 0.9, "above and below there may be text"
        driver.up("U")
        driver.frame(2)
        assert np.array_equal(driver.window(), plain)
