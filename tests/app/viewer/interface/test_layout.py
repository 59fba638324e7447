"""How the interface looks: what is remembered of it, what fits into small and large windows, and which settings it offers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.app.viewer import preferences, viewer
from irrsplat.app.viewer.buffers.tiles import Margins, tiling
from irrsplat.app.viewer.input.idle_settings import BASIC, why_idle
from irrsplat.app.viewer.session import overrides
from irrsplat.app.viewer.view_options import Appearance
from irrsplat.app.viewer.window import LARGEST, open_window, within_screen
from irrsplat.core.errors import InputError
from irrsplat.renderer import Renderer
from irrsplat.settings import SETTINGS, preset
from tests.support.viewing import FAST, Driver, push, viewing, write_room

# ---- the window ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "screen", "taken"), [
    ((800, 600), (1920, 1080), (800, 600)), ((3000, 600), (1920, 1080), (1920, 600)), ((3000, 2000), (1920, 1080), (1920, 1080)),
    ((3000, 2000), None, (3000, 2000)),
])  # fmt: skip
def test_a_window_is_no_larger_than_its_screen(size: Any, screen: Any, taken: Any) -> None:
    assert within_screen(size, screen) == taken


def test_a_size_that_no_window_can_have_is_refused_before_it_opens() -> None:
    with pytest.raises(InputError, match="at most 16384"):
        open_window((LARGEST + 1, 100), headless=True)


# ---- what is remembered --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kept", [
    None, 7, [], {"scale": 9.0}, {"scale": "1"}, {"scale": True}, {"scale": float("nan")}, {"light": 1}, {"windows": 3},
    {"windows": "é"},
])  # fmt: skip
def test_what_cannot_be_is_left_out(kept: object) -> None:
    assert Appearance.of({"appearance": kept}) == Appearance()


def test_the_appearance_comes_back() -> None:
    one = Appearance(1.75, True, "[Window][settings]\nPos=9,9\n")
    assert Appearance.of({"appearance": asdict(one)}) == one


def test_panels_stand_where_they_were_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dragged by its title and its corner; and in a smaller window next time, all of it is inside."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    room = write_room(tmp_path)
    kept = preferences.Preferences(values=dict(FAST))  # type: ignore[arg-type]
    with viewing(room, (700, 500), kept) as driver:
        driver.frame(4)
        driver.drag((100, 42), (250, 82))
        driver.frame(3)
        right = driver.viewer.interface.layout.panel_right
        driver.actions.appearance.light = True
        monkeypatch.setattr(driver.viewer, "release", lambda: None)
        assert driver.viewer.close() is None
        monkeypatch.undo()
        monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    remembered, notices = preferences.load()
    assert notices == [] and "settings" in str(remembered.ui["appearance"])
    with viewing(room, (700, 500), remembered) as driver:
        driver.frame(4)
        assert driver.viewer.interface.layout.panel_right == pytest.approx(right, abs=1.0) and right > 450
        assert driver.actions.appearance.light
    with viewing(room, (400, 300), remembered) as driver:
        driver.frame(6)
        assert driver.viewer.interface.layout.panel_right <= 400


# ---- sizes ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "scale"), [((640, 400), 1.0), ((640, 400), 1.5), ((640, 400), 2.5), ((1280, 720), 1.0)])
def test_everything_fits(driver: Driver, size: tuple[int, int], scale: float) -> None:
    """Panels end above the legend and before the numbers, these above the window's end; every menu is in the bar."""
    driver.resize(size, density=0.25)
    driver.actions.panels.settings = driver.actions.panels.hud = True
    driver.actions.appearance.scale = scale
    driver.frame(8)
    layout = driver.viewer.interface.layout
    bar = {w.label: w.box for w in driver.widgets if w.kind == "begin_menu"}
    assert max(box[2] for box in bar.values()) <= size[0]
    assert len(bar) == 10 if scale == 1.0 else "More" in bar
    assert layout.statistics_size[1] <= size[1] and layout.panel_right <= size[0]
    for title in ("Scene", "Window", "Help"):
        if title in bar:
            driver.choose(title)
        else:
            driver.choose("More")
            driver.click(*driver.find(title, header=True).at())
        assert [w for w in driver.widgets if w.kind == "menu_item"]
        push(driver, "Esc")
        driver.frame(2)
        assert not [w for w in driver.widgets if w.kind == "menu_item"], "Esc closes menus"
    driver.actions.appearance.scale = 1.0


def test_a_message_stands_clear_of_panels_and_numbers(driver: Driver) -> None:
    """Between them, over several lines; where there is no room for it, all of it is in front of them."""
    driver.actions.panels.settings = driver.actions.panels.hud = True
    for size in ((900, 700), (640, 400)):
        driver.resize(size)
        driver.actions.messages.lines.clear()
        driver.settle()
        driver.frame(8)
        layout, before = driver.viewer.interface.layout, driver.window()
        driver.actions.say("WWWW a message as long as this one takes more than a line of what is free WWWW", error=True)
        driver.frame(6)
        rows, columns = np.nonzero(red(driver.window()) & ~red(before))
        assert rows.min() < 40 and len(rows) > 5000
        if size[0] == 900:
            free = layout.panel_right, size[0] - layout.statistics_size[0]
            assert free[0] < columns.min() and columns.max() < free[1]
        else:
            assert columns.min() < 0.5 * layout.panel_right and columns.max() > size[0] - 0.5 * layout.statistics_size[0]
    driver.actions.messages.lines.clear()


def red(picture: np.ndarray) -> np.ndarray:
    """(H, W) where it is as red as the ground of an error."""
    r, g, b = picture.transpose(2, 0, 1).astype(int)
    found: np.ndarray = (r > 140) & (g < 90) & (b < 90)
    return found


def test_in_a_small_window_a_new_panel_folds_those_that_it_covers(driver: Driver) -> None:
    """Their titles stay, clear of it; in a large one all stay open."""
    for size, folds in (((640, 400), True), ((1280, 720), False)):
        driver.resize(size)
        panels = driver.actions.panels
        panels.settings, panels.hud, panels.lights = True, True, False
        driver.viewer.interface.layout.restore()
        driver.frame(8)
        panels.lights = True
        driver.frame(10)
        boxes = driver.viewer.interface.layout._drawn
        settings, lights = boxes["settings"], boxes["lights"]
        assert (settings[3] - settings[1] < 40) == folds and lights[3] - lights[1] > 100
        assert lights[1] >= settings[3] or lights[0] >= settings[2] or settings[0] >= lights[2]
        panels.lights = False
        driver.frame(2)


def test_a_legend_that_is_too_long_scrolls(driver: Driver) -> None:
    """It takes two fifths of the height, and the wheel moves it, not the camera; one that fits lets the mouse through."""
    driver.session.options.frozen = driver.session.options.points = True
    driver.resize((640, 400))
    for scale, scrolls in ((1.0, False), (2.5, True)):
        driver.actions.appearance.scale = scale
        driver.actions.show("irradiance")
        driver.frame(6)
        layout = driver.viewer.interface.layout
        driver.move(40.0, 370.0)
        driver.frame(3)
        assert driver.viewer.backend.wants_mouse == scrolls and layout.legend_height < 0.45 * 400
    before, camera = driver.window(), driver.session.camera
    driver.viewer.controls.wheel(0.0, -3.0)
    driver.frame(4)
    assert driver.session.camera == camera and (driver.window() != before)[260:].any(-1).sum() > 500


def test_the_size_of_the_interface_is_set_in_the_menu(driver: Driver) -> None:
    driver.resize((640, 400))
    driver.frame(2)
    driver.choose("Window")
    driver.enter(driver.find("size of the interface"), "1.5")
    assert driver.actions.appearance.scale == pytest.approx(1.5) and driver.viewer.backend.scale == pytest.approx(1.5)
    driver.actions.enlarge(77.0)
    assert driver.actions.appearance.scale == 2.5


def test_light_colours_are_light(driver: Driver) -> None:
    driver.frame(2)
    dark = driver.window()[4:16, 200:].mean()
    driver.actions.appearance.light = True
    driver.frame(3)
    assert driver.window()[4:16, 200:].mean() > 180 > 100 > dark
    driver.actions.appearance.light = False
    driver.frame(2)
    assert driver.window()[4:16, 200:].mean() == pytest.approx(dark, abs=2.0)


def test_tiles_stand_clear_of_the_panels(driver: Driver) -> None:
    """In a large window the shadow maps lie between settings and numbers; with the interface hidden they have all of it."""
    driver.resize((1280, 720))
    driver.actions.panels.settings = driver.actions.panels.hud = True
    driver.actions.show("shadow")
    driver.frame(6)
    layout = driver.viewer.interface.layout
    ground = driver.canvas()[360, 2]
    columns = np.flatnonzero((driver.canvas() != ground).any(-1).any(0))
    assert columns.min() >= layout.panel_right and columns.max() <= 1280 - layout.statistics_size[0]
    driver.actions.panels.hidden = True
    driver.frame(3)
    wider = np.flatnonzero((driver.canvas() != ground).any(-1).any(0))
    assert len(wider) > len(columns)


def test_margins_leave_an_area() -> None:
    assert Margins().area((300, 200)) == (0, 0, 300, 200)
    assert Margins(0.1, 0.2, 0.25, 0.05).area((300, 200)) == (30, 10, 210, 140)
    plain, moved = tiling(6, (64, 64), (0, 0, 210, 140)), tiling(6, (64, 64), (30, 10, 210, 140))
    assert (moved.left - plain.left, moved.top - plain.top) == (30.0, 10.0) and moved.per_row == plain.per_row


def test_all_messages_are_in_the_log(driver: Driver) -> None:
    driver.resize((640, 400), density=0.25)
    driver.frame(2)
    driver.actions.say("something was said")
    driver.actions.messages.lines.clear()
    driver.choose("Window", "messages")
    driver.frame(3)
    assert driver.actions.panels.log
    push(driver, "Esc")
    assert not driver.actions.panels.log


# ---- settings ------------------------------------------------------------------------------------------------------------


def test_what_changes_nothing_says_why_and_only_then() -> None:
    default = preset("default")
    assert {name for name in SETTINGS if why_idle(name, default)} == {"samples", "quality", "max_rounds", "warmup"}
    assert {name for name in SETTINGS if why_idle(name, preset("paper"))} == {
        *("samples", "quality", "max_rounds", "second_order", "radius", "viewer_quality")
    }
    without = preset("default", bounces=0)
    assert why_idle("a", without) == why_idle("gather_size", without) == "bounces is 0: there is no indirect light"
    assert all(why_idle(name, without) is None for name in ("bounces", "blend", "exposure", "shadow_size", "budget", "seed"))


def test_without_bounces_what_is_said_to_change_nothing_changes_nothing(driver: Driver) -> None:
    """A change of each such setting leaves the picture bit for bit."""
    session = driver.session
    session.change(0, bounces=0)
    driver.settle()
    before = driver.canvas()
    changes: dict[str, Any] = {
        "a": 1.5,
        "gather_size": 12,
        "walls": False,
        "radius_min": 5.0,
        "smooth": True,
        "fill_holes": False,
    }
    for name, value in changes.items():
        assert why_idle(name, session.settings(0)[1]) is not None
        session.change(0, **{name: value})
        driver.settle()
        assert np.array_equal(driver.canvas(), before), name


@pytest.fixture
def panel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """A window of its own, in which the panel has the height that it has at first; the cache is frozen."""
    monkeypatch.setattr(Renderer, "accumulate", lambda self, view, *_: view)
    with viewing(write_room(tmp_path), (640, 700), bounces=0) as driver, driver.wnd.ctx:
        driver.actions.panels.settings = driver.session.options.frozen = True
        driver.frame(4)
        yield driver


def labels(driver: Driver) -> set[str]:
    return {w.label for w in driver.widgets}


def test_basic_settings_come_first_and_what_differs_is_there_too(panel: Driver) -> None:
    changed = set(overrides(*panel.session.settings(0)))
    wanted = {name.replace("_", " ") for name in {*BASIC, *changed}}
    assert {name.replace("_", " ") for name in SETTINGS} & labels(panel) == wanted
    panel.choose("expert settings too")
    panel.frame(2)
    assert panel.actions.panels.expert and "walls" in labels(panel)


def test_a_click_types_a_number_and_a_double_click_takes_it_back(panel: Driver) -> None:
    slider = panel.find("blend")
    panel.click(slider.box[0] - 30.0, slider.at()[1])
    panel.press("A", ctrl=True)
    panel.type("0.8")
    panel.press("ENTER")
    panel.frame(2)
    assert panel.session.settings(0)[1].blend == pytest.approx(0.8)
    panel.move(*slider.at(0.2))
    panel.frame(2)
    for _ in range(2):
        panel.button(True)
        panel.frame(dt=0.02)
        panel.button(False)
        panel.frame(dt=0.02)
    panel.frame(2)
    assert panel.session.settings(0)[1].blend == preset("default").blend


def test_the_help_is_on_the_whole_row(panel: Driver) -> None:
    """On the number, on the slider and on the name."""
    slider = panel.find("blend")
    for x in (slider.box[0] - 30.0, slider.at()[0], slider.box[2] + 20.0):
        panel.move(620.0, 690.0)
        panel.frame(3)
        before = panel.window()
        panel.move(x, slider.at()[1])
        panel.frame(30, dt=0.1)
        covered = (panel.window()[:, 360:] != before[:, 360:]).any(-1).sum()
        assert covered > 2000, x


def test_a_window_beyond_the_screen_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What was asked for and what is there; by a size remembered from another screen nothing is said."""
    import irrsplat

    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path))
    said: list[str] = []

    def smaller(size: tuple[int, int]) -> Any:
        wnd = open_window(within_screen(size, (200, 150)), headless=True)
        monkeypatch.setattr(type(wnd), "headless", False)
        monkeypatch.setattr(viewer, "Desktop", lambda wnd: Still())
        return wnd

    class Still:
        scale = 1.0
        text = ""
        copy = listen = watch = wait = staticmethod(lambda *_: None)

    def loop(self: viewer.Viewer) -> None:
        said.append("\n".join(m.text for m in self.actions.messages.lines))

    monkeypatch.setattr(viewer, "open_window", smaller)
    monkeypatch.setattr(viewer.Viewer, "loop", loop)
    scene = irrsplat.load(str(write_room(tmp_path)))
    kept = preferences.Preferences(size=(900, 900), values=dict(FAST))  # type: ignore[arg-type]
    for size in ((800, 600), None):
        viewer.run(scene, "room", size, kept)
    assert "200x150" in said[0] and "800x600" in said[0] and said[1] == ""
