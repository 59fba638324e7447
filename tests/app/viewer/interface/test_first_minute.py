"""First use of the viewer: early input, menus and the palette of actions."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

import pytest
from imgui_bundle import imgui

from irrsplat.app.viewer.input.commands import COMMANDS, MENUS
from irrsplat.app.viewer.window import Desktop
from tests.support.viewing import LEFT, RIGHT, Driver, push


def test_keys_and_clicks_before_the_first_picture_end_nothing(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before the first frame of a new scene, each action runs or gives a message."""
    monkeypatch.setattr(type(driver.actions), "trace", lambda self: None)  # takes minutes
    driver.actions.open("furnace")
    assert not driver.session.views
    for key in COMMANDS:
        if key.action != "quit":
            driver.actions.press(key)
    for button in (LEFT, RIGHT):
        driver.button(True, button)
        driver.button(False, button)
    assert not driver.session.views


def test_no_title_of_a_menu_is_cut_off(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """All titles of menus fit into 640 pixels at scale 2. Esc closes a menu and its submenus."""
    driver.resize((640, 400), density=0.25)
    driver.frame(2)
    driver.choose("Help")
    assert any(w.label.startswith("Keys") for w in driver.widgets)
    push(driver, "Esc")
    driver.frame()
    assert not any(w.label.startswith("Keys") for w in driver.widgets)
    driver.choose("Help", "Keys")
    assert driver.actions.prompt is not None
    push(driver, "Esc")
    assert driver.actions.prompt is None
    monkeypatch.setattr(Desktop, "scale", 2.0)
    driver.frame(6)
    assert [w.label for w in driver.widgets if w.kind == "begin_menu" and w.box[2] <= 640] == list(MENUS)


def test_every_action_has_a_method_and_a_name_of_its_own(driver: Driver) -> None:
    """The palette finds an action by its name, which must be unique; `enabled` is a property of the actions."""
    names = [(one.menu, one.title) for one in COMMANDS if not (one.action == "editor.redo" and one.shift)]
    assert len(set(names)) == len(names)
    for one in COMMANDS:
        assert callable(attrgetter(one.action)(driver.actions)) and one.menu.split("/")[0] in MENUS
        assert driver.actions.can(one) in (True, False) and driver.actions.is_active(one) in (True, False)
    grey = {one.title for one in COMMANDS if one.menu == "Edit" and not driver.actions.can(one)}
    assert grey == {"Undo", "Redo", "Delete"}, "nothing is changed or selected"


@pytest.mark.parametrize(("typed", "found"), [
    ("record discs", lambda driver: driver.session.options.discs),
    ("preset preview", lambda driver: driver.session.renderers[0].preset == "preview"),
    ("setting radius max", lambda driver: driver.session.options.settings),
    ("open furnace", lambda driver: driver.actions.source == "furnace"),
])  # fmt: skip
def test_the_palette_finds_actions_settings_and_scenes(
    driver: Driver, typed: str, found: Callable[[Driver], bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Enter runs the first match of the typed words; without a match the list shows a message, and typing continues."""
    said = list[str]()
    monkeypatch.setattr(imgui, "text_disabled", said.append)
    driver.session.options.frozen = True
    driver.resize((640, 400), density=0.25)
    assert not found(driver)
    push(driver, "Ctrl+P")
    driver.frame(3)
    driver.type(typed)
    driver.press("ENTER")
    driver.frame(2)
    assert found(driver) and driver.actions.prompt is None
    push(driver, "Ctrl+P")
    driver.frame(3)
    driver.type("none of that")
    assert any(words.startswith("nothing has these words") for words in said)
    driver.press("ENTER")
    driver.frame(2)
    driver.type("!")
    assert driver.actions.prompt is not None and driver.actions.prompt.text == "none of that!"
