"""The layout of the interface: the picture and the panel in small and large windows, and the help of settings."""

from __future__ import annotations

from importlib import resources
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import ImageFont

from irrsplat.app.viewer.input import prompts
from irrsplat.app.viewer.ui.imgui_backend import FONT_SIZE, FONTS
from irrsplat.app.viewer.window import Desktop
from tests.support.viewing import ROOM, Driver, write_room

SIZE = (1000, 640)


@pytest.mark.parametrize(("size", "scale"), [((640, 400), 1.0), ((640, 400), 2.0), ((1280, 720), 1.5)])
def test_the_picture_is_fitted_beside_the_panel(
    driver: Driver, size: tuple[int, int], scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The unscaled picture is next to the panel and below the menus, or fills the window; a click selects the pixel's mesh."""
    driver.session.options.frozen = driver.session.options.controls = True
    monkeypatch.setattr(Desktop, "scale", scale)
    driver.resize(size)
    driver.frame(8)
    left, top, width, height = driver.viewer._place
    assert driver.session.size == (width, height) and left >= 0.3 * size[0] and top > 0 and left + width <= size[0]
    x, y = driver.session.size[0] // 2, driver.session.size[1] // 4
    assert np.array_equal(driver.window()[top : top + height // 3, left + 8 : left + width], driver.canvas()[: height // 3, 8:])
    expected = driver.display.mesh_at((x, y))
    driver.click(left + x, top + y)
    assert expected is not None and driver.actions.editor.mesh == expected
    driver.actions.editor.mesh = None
    named = [w for w in driver.widgets if w.label.lstrip("#") in ("a", "blend", "buffer")]
    assert len(named) == 3 and all(w.box[2] < left for w in named)
    driver.session.options.controls = False
    driver.frame(3)
    assert driver.session.size == size and np.array_equal(driver.canvas().shape[:2], size[::-1])


def test_titles_and_numbers_fit_into_the_narrowest_panel(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 640×400 and scale 2, the title of a section fits between its arrow and cross, and a slider's number fits."""
    options = driver.session.options
    options.frozen = options.controls = True
    monkeypatch.setattr(Desktop, "scale", 2.0)
    driver.resize((640, 400))
    options.lights = options.outliner = options.settings = options.why = options.plane = True
    driver.frame(6)
    with resources.as_file(resources.files("imgui_bundle") / "assets" / "fonts" / FONTS[0]) as path:
        font = ImageFont.truetype(str(path), 2.0 * FONT_SIZE)
    headers = {w.label: w for w in driver.widgets if w.kind == "collapsing_header"}
    for title in driver.viewer.interface.open_titles:
        left, _, right, _ = headers[title].box
        assert right - left >= font.getlength(title) + 2.0 * 2.0 * FONT_SIZE + 12.0, title
    sliders = [w for w in driver.widgets if w.label in ("##tolerance", "##exposure")]
    assert len(sliders) == 4 and all(w.box[2] - w.box[0] >= 80.0 for w in sliders), "in the first settings, and in all"


def test_questions_and_legends_fit_into_a_small_window(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 640×400 and scale 2, the prompt for unsaved changes and a legend with a colour scale fit into the window."""
    driver.session.options.frozen = driver.session.options.controls = True
    monkeypatch.setattr(Desktop, "scale", 2.0)
    driver.resize((640, 400))
    driver.actions.show("weight")
    driver.actions.prompt = prompts.unsaved(driver.actions, driver.session.free_camera.home)
    driver.frame(6)
    for name in ("prompt", "legend 0"):
        window = imgui.internal.find_window_by_name(name)
        assert window.content_size.x <= window.size.x - 2.0 * window.window_padding.x, name
        assert window.content_size.y <= window.size.y - 2.0 * window.window_padding.y, name
        assert window.pos.x >= 0.0 and window.pos.x + window.size.x <= 640.0 and window.pos.y >= 0.0, name


def test_a_name_longer_than_the_panel_is_in_full_under_the_mouse(driver: Driver, tmp_path: Path) -> None:
    name, path = "a long name of a chair " * 3, write_room(tmp_path)
    (tmp_path / "box.obj").rename(tmp_path / f"{name}.obj")
    path.write_text(ROOM.replace("box.obj", f"{name}.obj"))
    driver.actions.open(str(path))
    driver.session.options.frozen = driver.session.options.controls = driver.session.options.outliner = True
    driver.resize(SIZE, density=0.25)
    driver.frame(6)
    driver.move(*driver.find(name).at(0.1))
    driver.frame(6, dt=0.5)
    tooltip = imgui.internal.find_window_by_name("##Tooltip_00")
    assert tooltip.active and tooltip.size.x > imgui.calc_text_size(name).x > driver.viewer.interface.layout.panel


def test_no_text_is_behind_another_window(driver: Driver) -> None:
    """Windows over the picture do not overlap, and a prompt hides the text behind it."""
    options = driver.session.options
    options.frozen = options.inspect = options.discs = options.profile = options.controls = True
    driver.resize((800, 600))
    driver.frame(3)
    driver.actions.say("an error that takes more than a line " * 3, error=True)
    left, top, width, height = driver.viewer._place
    driver.move(left + 0.3 * width, top + 0.5 * height)
    driver.frame(6)
    found = [imgui.internal.find_window_by_name(name) for name in ("legend 0", "record", "along a line", "errors")]
    for a, b in combinations([w.rect() for w in found], 2):
        assert not a.overlaps(b), (a, b)
    driver.actions.prompt = prompts.unsaved(driver.actions, driver.session.free_camera.home)
    driver.frame(3)
    box, shown = imgui.internal.find_window_by_name("prompt").rect(), driver.window()
    options.hidden = True
    driver.frame(3)
    inside = slice(int(box.min.y) + 6, int(box.max.y) - 6), slice(int(box.min.x) + 6, int(box.max.x) - 6)
    assert np.array_equal(driver.window()[inside], shown[inside])
