"""The panels by the mouse: a widget for every setting, presets, menus, the lights, the buttons over the picture; and Tab."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imgui_bundle import imgui

from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.lamps import Lamp
from irrsplat.app.viewer.session import overrides
from irrsplat.meter.light_scale import LightScale
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Light
from irrsplat.settings import PRESETS, SETTINGS, preset
from tests.support.luminaires import isotropic, photometry
from tests.support.viewing import FAST, Driver, fresh, push, viewing, write_room

TALL = (460, 1400)  # so that the whole panel fits

# a setting, what is typed into its slider or chosen, and what it is then; None: a click on the box
CHANGES: dict[str, tuple[str | None, Any]] = {
    "shadow_size": ("128", 128),
    "seed": ("7", 7),
    "bounces": ("1", 1),
    "gather": ("plane", "plane"),
    "gather_size": ("12", 12),
    "ray_noise": ("2.5", 2.5),
    "light_samples": ("32", 32),
    "texture_memory": ("64", 64),
    "gradients": (None, False),
    "second_order": (None, False),
    "radius": ("harmonic", "harmonic"),
    "a": ("0.8", 0.8),
    "adapt": ("1.5", 1.5),
    "kernel": ("cut", "cut"),
    "in_front": (None, False),
    "walls": (None, False),
    "neighbours": (None, True),
    "radius_min": ("3.5", 3.5),
    "radius_max": ("60", 60.0),  # beyond the slider's span, which is for dragging only
    "coarse": (None, False),
    "tolerance": ("4", 4.0),
    "spread": ("0.7", 0.7),
    "borrow": ("3", 3),
    "placement": ("scan", "scan"),
    "warmup": ("30", 30),
    "max_rounds": ("5", 5),
    "max_records": ("9000", 9000),
    "blend": ("0.9", 0.9),
    "pixel_light_samples": ("4", 4),
    "smooth": (None, True),
    "fill_holes": (None, False),
    "fade": (None, False),
    "exposure": ("-2", -2.0),
    "backdrop": ("black", "black"),
    "samples": ("4", 4),
    "budget": ("25", 25.0),
    "viewer_samples": ("2", 2),
    "quality": ("1", 1.0),
    "viewer_quality": ("2", 2.0),
}


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    """A tall window of few pixels; without bounces, since what is gathered is not of interest to most of these tests."""
    with viewing(write_room(tmp_path_factory.mktemp("room")), TALL, bounces=0) as driver:
        driver.density = 0.25  # drawing takes most of the time
        yield driver


@pytest.fixture(autouse=True)
def unsampled(monkeypatch: pytest.MonkeyPatch) -> None:
    """One sample a pixel, also under presets that add up more of them while nothing moves: no test here looks at them."""
    monkeypatch.setattr(Renderer, "accumulate", lambda self, view, *_: view)


@pytest.fixture
def driver(one: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """The viewer as at first, at rest; it remembers and writes in `tmp_path`."""
    yield from fresh(one, tmp_path, monkeypatch)


@pytest.fixture
def panel(driver: Driver) -> Driver:
    """All stages of the settings' panel unfolded, the cache frozen, and nothing in view, so that frames take little time."""
    driver.session.free_camera.go(Camera((0.0, 0.0, 90.0), (0.0, 0.0, 99.0)))
    driver.actions.panels.settings = driver.actions.panels.expert = driver.session.options.frozen = True
    driver.frame(3)
    for stage in ("view", "composite", "examine", "splat", "gather", "gbuffer", "shadow"):
        if all(d.stage != stage or label(d.name) not in shown(driver) for d in SETTINGS.values()):
            driver.click(*driver.find(stage, header=True).at())
            driver.frame(2)
    return driver


def value(driver: Driver, name: str) -> Any:
    return getattr(driver.session.settings(0)[1], name)


def shown(driver: Driver) -> set[str]:
    """The labels of all widgets but those that unfold others."""
    return {w.label for w in driver.widgets if w.kind != "collapsing_header"}


def label(name: str) -> str:
    return name.replace("_", " ")


# ---- settings ---------------------------------------------------------------------------------------------------------


def test_every_setting_has_its_line() -> None:
    assert set(CHANGES) == set(SETTINGS)


def test_the_panel_shows_every_setting(panel: Driver) -> None:
    assert {label(name) for name in SETTINGS} <= shown(panel)


@pytest.mark.parametrize("name", SETTINGS)
def test_a_widget_changes_its_setting_alone_and_the_arrow_takes_it_back(panel: Driver, name: str) -> None:
    """Typed by Ctrl+click, chosen from a list or clicked; the camera stays."""
    typed, expected = CHANGES[name]
    old, camera = panel.session.settings(0)[1], panel.session.camera
    if SETTINGS[name].word and value(panel, name) == SETTINGS[name].word:
        panel.click(*panel.find("auto", beside=label(name)).at())
        assert value(panel, name) == pytest.approx(old.threshold if name == "tolerance" else panel.session.exposure, abs=1e-3)
    widget = panel.find(label(name))
    if SETTINGS[name].kind == "choice":
        panel.click(*widget.at())
        x, y = widget.at()
        step = widget.box[3] - widget.box[1]
        for row in range(1, 6):
            if value(panel, name) == typed:
                break
            panel.click(x, y + row * 0.8 * step)
            if value(panel, name) != typed:
                panel.click(*panel.find(label(name)).at())
    elif typed is None:
        panel.click(widget.box[0] + 8.0, widget.at()[1])
    else:
        panel.enter(widget, typed)
    assert value(panel, name) == expected
    changed = panel.session.settings(0)[1]
    assert [n for n in SETTINGS if getattr(changed, n) != getattr(old, n)] == [name]
    assert panel.session.camera == camera
    panel.click(*panel.find("←", beside=label(name)).at())
    assert value(panel, name) == getattr(preset("default"), name)


@pytest.mark.parametrize("name", ["a", "blend", "max_rounds", "seed"])
def test_a_slider_is_dragged(panel: Driver, name: str) -> None:
    """From end to end: the least and the greatest value of its span. What all records hang on waits for the button to go up."""
    widget, seen = panel.find(label(name)), []
    panel.move(*widget.at())
    panel.frame(2)
    panel.button(True)
    for along in (0.3, 0.6, 0.99):
        panel.move(*widget.at(along))
        panel.frame()
        seen.append(value(panel, name))
    panel.button(False)
    panel.frame(2)
    declaration = SETTINGS[name]
    most = {"max_rounds": 200, "seed": 100}.get(name, declaration.high)
    assert value(panel, name) == pytest.approx(most, rel=0.03)
    assert seen == [0] * 3 if name == "seed" else seen == sorted(set(seen)), "waits, or follows"
    panel.drag(panel.find(label(name)).at(0.97), panel.find(label(name)).at(0.0))
    assert value(panel, name) == pytest.approx(declaration.low, abs=0.011)


def test_a_logarithmic_slider_has_its_geometric_mean_in_the_middle(panel: Driver) -> None:
    """Of 0.01..2 that is √0.02 = 0.14, where a linear one has 1."""
    panel.drag(panel.find("a").at(0.9), panel.find("a").at(0.5))
    assert value(panel, "a") == pytest.approx(0.02**0.5, rel=0.1)


def test_switching_auto_exposure_off_keeps_the_exposure(panel: Driver) -> None:
    """Switched off, the value stays where it is: the picture does not jump."""
    assert value(panel, "exposure") == FAST["exposure"]
    panel.click(*panel.find("auto", beside="exposure").at(0.1))
    assert value(panel, "exposure") == "auto"
    panel.settle()
    shown = panel.session.exposure
    panel.click(*panel.find("auto", beside="exposure").at(0.1))
    assert value(panel, "exposure") == pytest.approx(shown, abs=2e-3)


def test_switching_all_bounces_off_keeps_their_number(panel: Driver) -> None:
    """Switched off, it stays at the number that was made."""
    panel.session.options.frozen = False
    panel.session.change(0, budget=2000.0, radius_min=10.0)
    panel.frame()
    panel.click(*panel.find("all", beside="bounces").at(0.1))
    assert value(panel, "bounces") == "all"
    panel.settle()
    made = panel.session.frame().stats["bounces"]
    assert 2 < made < 64
    panel.click(*panel.find("all", beside="bounces").at(0.1))
    assert value(panel, "bounces") == made


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_in_the_list_and_in_the_menu(panel: Driver, name: str) -> None:
    for way in ("menu", "list"):
        panel.session.use_preset(0, "preview" if name != "preview" else "default")
        panel.frame(2)
        panel.choose("Preset" if way == "menu" else "preset")
        panel.choose(name)
        assert panel.session.settings(0)[0] == name, way
        assert overrides(*panel.session.settings(0)).keys() <= {"exposure", "budget"}


def test_a_setting_is_changed_on_the_selected_side(panel: Driver) -> None:
    panel.session.split("presets")
    panel.quicken()
    panel.frame(3)
    panel.choose("right")
    panel.enter(panel.find("blend"), "0.25")
    assert [r.settings.blend for r in panel.session.renderers] == [0.5, 0.25]
    panel.enter(panel.find("budget"), "33")
    assert [r.settings.budget for r in panel.session.renderers] == [33.0, 33.0], "which holds for both"
    panel.session.split("off")
    panel.frame(2)
    panel.enter(panel.find("blend"), "0.75")
    assert [r.settings.blend for r in panel.session.renderers] == [0.75, 0.25], "the right side is out of sight"


# ---- Tab ---------------------------------------------------------------------------------------------------------------


def test_in_a_field_tab_goes_on_to_the_next(panel: Driver) -> None:
    """Esc leaves the fields: then Tab splits the view again."""
    panel.down("LEFT_CTRL")
    panel.click(*panel.find("a").at())
    panel.press("A")
    panel.up("LEFT_CTRL")
    panel.type("0.8")
    panel.press("TAB")
    panel.frame(2)
    assert panel.viewer.backend.wants_keyboard and panel.session.options.split == "off"
    assert value(panel, "a") == pytest.approx(0.8)
    panel.press("ESCAPE")
    panel.frame(2)
    assert not panel.viewer.backend.wants_keyboard
    panel.press("TAB")
    assert panel.session.options.split == "buffers"


def test_tab_comes_to_two_presets_and_round_again(panel: Driver) -> None:
    """Also after a click into the panel, which gives its window imgui's focus; and a key after it is typed into no setting."""
    for way in ("buffers", "presets", "off", "buffers", "presets"):
        panel.press("TAB")
        panel.frame(3)
        assert panel.session.options.split == way and not panel.viewer.backend.wants_keyboard
        if way == "off":
            for _ in range(2):
                panel.click(*panel.find("gradients").at())
    before, panel.actions.side = [renderer.settings for renderer in panel.session.renderers], 0
    push(panel, "5")
    panel.type("5")
    assert panel.session.options.buffers[0] == "weight"
    assert [renderer.settings for renderer in panel.session.renderers] == before
    panel.press("TAB", ctrl=True)
    panel.frame(3)
    assert not panel.viewer.backend.wants_keyboard and panel.session.options.split == "presets", "imgui opens no list of windows"


# ---- menus -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUFFERS)
def test_the_menu_shows_every_buffer(driver: Driver, name: str) -> None:
    driver.session.options.buffers[0] = "albedo" if name != "albedo" else "image"
    driver.frame()
    before = driver.canvas()
    driver.choose("Show", BUFFERS[name].title)
    assert driver.session.options.buffers[0] == name and (driver.canvas() != before).any()


@pytest.mark.parametrize(("menu", "item", "attribute"), [
    ("Over it", "record points", "points"), ("Over it", "record discs: how far each reaches", "discs"),
    ("Over it", "record normals", "normals"), ("Over it", "wireframe", "wire"),
    ("Over it", "colour records by age instead of by radius", "by_age"),
    ("Over it", "the record under the cursor", "inspect"), ("Cache", "freeze the cache, to see it from elsewhere", "frozen"),
])  # fmt: skip
def test_the_menus_toggle(driver: Driver, menu: str, item: str, attribute: str) -> None:
    for wanted in (True, False):
        driver.choose(menu, item)
        assert getattr(driver.session.options, attribute) is wanted


def test_the_camera_menu_has_the_scene_s_cameras_and_bookmarks(driver: Driver) -> None:
    corner = driver.session.scene.camera("corner")
    driver.choose("Camera", "corner")
    assert driver.session.camera == corner
    driver.choose("Camera", "keep the camera as a bookmark of this scene")
    driver.choose("Camera", "back to the first camera")
    assert driver.session.camera == driver.session.scene.camera()
    driver.choose("Camera", "bookmark 1", "go there")
    assert driver.session.camera.eye == corner.eye
    driver.choose("Camera", "bookmark 1", "forget it")
    assert driver.actions.bookmarks == []


def test_the_split_from_the_menu(driver: Driver) -> None:
    driver.session.options.frozen = True
    driver.resize((480, 400), density=0.25)  # so that the menu is all there
    driver.frame(2)
    for word, way in (("two buffers", "buffers"), ("two presets", "presets"), ("one picture", "off")):
        driver.choose("Compare", word)
        assert driver.session.options.split == way


def test_the_buttons_over_the_picture(driver: Driver) -> None:
    driver.actions.panels.hud = True
    driver.frame(3)
    driver.session.change(0, bounces=1, radius_min=10.0)
    driver.settle()
    driver.choose("freeze")
    assert driver.session.options.frozen
    assert driver.session.renderers[0].cache.count > 0
    driver.choose("clear")
    assert driver.session.renderers[0].cache.count == 0
    driver.choose("thaw")
    assert not driver.session.options.frozen


# ---- lights ------------------------------------------------------------------------------------------------------------


def test_lights_are_moved_dimmed_switched_and_put_back(driver: Driver) -> None:
    """Switched off, the room is black, for nothing else lights it."""
    loaded = driver.session.scene.lights
    driver.actions.panels.lights = True
    driver.settle()
    canvas = driver.canvas()

    def light() -> Any:
        return driver.session.scene.lights[0]

    driver.enter(driver.find("stops"), "-1")
    driver.settle()
    assert light().color == pytest.approx(np.array(loaded[0].color) / 2) and light().position == loaded[0].position
    assert driver.canvas().mean() < canvas.mean()
    driver.drag(driver.find("position").at(0.15), driver.find("position").at(0.3))
    assert light().position[0] > loaded[0].position[0] and light().position[1:] == pytest.approx(loaded[0].position[1:])
    driver.choose("to the eye")
    assert light().position == driver.session.camera.eye
    driver.click(*driver.find("on").at(0.2))
    driver.settle()
    assert light().color == (0.0, 0.0, 0.0)
    assert not driver.canvas()[100:900].any(), "but for the legend"
    driver.choose("as loaded")
    driver.settle()
    assert driver.session.scene.lights == loaded
    assert np.abs(driver.canvas().astype(float) - canvas).mean() < 1.0


def test_a_luminaire_says_what_it_sends_out_and_keeps_its_direction_when_moved(
    driver: Driver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its file, lumens and candela stand over the widgets. Moved, it is aimed as before; its aim can be dragged."""
    said: list[str] = []
    monkeypatch.setattr(imgui, "text_disabled", said.append)
    shape = replace(photometry([0, 90, 180], [0], isotropic), path="lamps/round.ies")
    light = Light((0.0, 1.5, 0.0), (2.0, 2.0, 2.0), physical=True, photometry=shape, spot_target=(0.0, 0.5, 0.0))
    driver.actions.panels.lights = True
    driver.actions.editor.set_lamp(0, Lamp.of(light))
    driver.settle()
    assert said[-1] == "round.ies\n2,513 lm, at most 200 cd"
    driver.enter(driver.find("stops"), "1")
    driver.settle()
    assert said[-1] == "round.ies\n5,027 lm, at most 400 cd"
    driver.drag(driver.find("position").at(0.15), driver.find("position").at(0.3))
    moved = driver.session.scene.lights[0]
    assert moved.position[0] > 0.0 and np.allclose(moved.frame, light.frame, atol=1e-6)
    driver.drag(driver.find("aims at").at(0.15), driver.find("aims at").at(0.3))
    assert not np.allclose(driver.session.scene.lights[0].frame, light.frame, atol=1e-3)


def test_a_black_light_gets_its_colour_back(driver: Driver) -> None:
    driver.actions.panels.lights = True
    driver.actions.editor.set_lamp(0, driver.actions.editor.lamps[0].coloured((0.0, 0.0, 0.0)))
    driver.frame(3)
    box = driver.find("colour").box
    driver.drag((box[0] + 15.0, box[1] + 10.0), (box[0] + 215.0, box[1] + 10.0))
    assert driver.session.scene.lights[0].color[0] > 0.1


# ---- the scale of light --------------------------------------------------------------------------------------------------


def test_the_scale_of_light_is_set_by_its_panel(driver: Driver) -> None:
    """It is there while light is shown in false colours, and the picture follows."""
    assert "logarithmic" not in shown(driver)
    driver.session.options.buffers[0] = "light"
    driver.frame(3)

    def scale() -> LightScale:
        return driver.session.options.light_scale

    before = driver.canvas()
    driver.click(*driver.find("logarithmic").at(0.1))
    driver.frame()
    assert scale().logarithmic and (driver.canvas() != before).any()
    driver.enter(driver.find("decades"), "4")
    assert scale().decades == 4
    found = driver.session.light_scale.highest
    driver.click(*driver.find("auto", beside="maximum").at())
    assert scale().highest == found
    driver.enter(driver.find("maximum"), "250")
    assert scale().highest == 250.0 and driver.session.light_scale.ends == (0.025, 250.0)
    driver.click(*driver.find("lines").at(0.1))
    assert not scale().lines
    driver.session.options.light_scale = LightScale()
    driver.session.options.buffers[0] = "image"
    driver.frame(2)
    assert "logarithmic" not in shown(driver)
