"""Editing in the viewer: picking, handles, panels, undo and redo."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.app.film.background import FilmInBackground
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.editor import Editor
from irrsplat.app.viewer.editing.objects import bounds_of
from irrsplat.core.color import LUMINANCE
from irrsplat.core.vectors import vector
from irrsplat.scene.motion import transformed
from tests.support.viewing import RIGHT, SIZE, Driver, Widget, brighter, push

WALLS, _, BOX = range(3)


@pytest.fixture
def editor(driver: Driver) -> Editor:
    """Freeze the records of the view; return its editor."""
    driver.session.options.frozen = True
    return driver.actions.editor


def box_at(driver: Driver) -> tuple[float, float]:
    """Return the window coordinates of the box's centre."""
    x, y, z = bounds_of(driver.session.scene.meshes[BOX]).mean(0).tolist()
    return driver.seen((x, y, z))


def hidden(editor: Editor) -> list[int]:
    return [number for number, mesh in enumerate(editor.scene.meshes) if mesh.is_point]


def shift(editor: Editor, x: float) -> None:
    """Move the box by x metres along x from its loaded place."""
    way = np.eye(4)
    way[0, 3] = x
    editor.set_mesh(BOX, transformed(editor.loaded.meshes[BOX], way))


def test_a_picked_object_is_hidden_by_its_key_and_shown_by_undo(driver: Driver) -> None:
    """Without the box its pixel shows the wall, and the converged view is covered."""
    editor, records = driver.actions.editor, driver.session.renderers[0].cache.count
    push(driver, "Delete")
    assert "not possible" in driver.said and editor.scene is editor.loaded, "nothing is selected"
    assert driver.session.renderers[0].cache.count == records
    editor.mesh = BOX
    driver.resize(SIZE, density=0.25)
    driver.frame()
    here = int(0.25 * box_at(driver)[0]), int(0.25 * box_at(driver)[1])
    assert driver.display.mesh_at(here) == BOX
    push(driver, "Delete")
    assert hidden(editor) == [BOX] and editor.mesh is None and "box is hidden" in driver.said
    driver.settle()
    assert driver.display.mesh_at(here) == WALLS and driver.session.progress[0].coverage == 1.0
    driver.session.options.frozen = True
    for item, expected in (("Undo", []), ("Redo", [BOX])):
        driver.choose("Edit", item)
        assert hidden(editor) == expected


def test_undo_and_redo_return_each_edit(driver: Driver, editor: Editor) -> None:
    """Undo and redo return each earlier scene, by both keys of redo; a refused edit adds no step. Unmoved meshes are shared."""
    states = [editor.scene]
    for x in (0.1, 0.2):
        shift(editor, x)
        driver.frame()
        states.append(editor.scene)
    assert states[1].meshes[:2] == states[0].meshes[:2] and states[1].meshes[BOX].positions == pytest.approx(
        states[0].meshes[BOX].positions + np.array([0.1, 0.0, 0.0]), abs=1e-6
    )
    driver.actions.attempt(lambda: shift(editor, 1e39))
    assert editor.scene is states[-1] and "32-bit" in driver.said
    for expected in (states[1], states[0], states[0]):
        push(driver, "Ctrl+Z")
        assert editor.scene is expected
    assert not editor.past and driver.session.scene.meshes is editor.loaded.meshes
    for key, expected in (("Ctrl+Y", states[1]), ("Ctrl+Shift+Z", states[2]), ("Ctrl+Y", states[2])):
        push(driver, key)
        assert editor.scene is expected
    assert not editor.future
    assert driver.session.tracing.traced is None, "Ctrl+Y is not Y"


def test_a_scene_is_saved_under_the_name_of_a_prompt(driver: Driver, editor: Editor) -> None:
    """Without a dialog of the desktop, a prompt suggests a name in the scene's folder. The file is the newest recent scene."""
    push(driver, "Ctrl+S")
    driver.frame(2)
    driver.press("ENTER")
    driver.frame(2)
    saved = os.path.join(os.path.dirname(driver.source), "room-2.scene")
    assert f"{saved} is written" in driver.said
    editor.set_light(0, brighter(editor.scene.lights[0]))
    bright = driver.session.scene.lights
    push(driver, "Ctrl+S")
    assert driver.actions.prompt is None, "the second save replaces the first file without a prompt"
    assert irrsplat.load(saved).lights == bright and driver.actions.title == "room-2"
    assert driver.actions.preferences.recent[0] == saved
    os.utime(saved, (0, 0))
    push(driver, "Ctrl+S")
    assert driver.actions.prompt and "has changed since" in driver.said, "another program has written the file"
    push(driver, "Esc")
    push(driver, "Ctrl+Shift+S")
    assert (prompt := driver.actions.prompt) and prompt.text == saved and [*prompt.entries(saved[:-6])] == [f"replace {saved}"]
    assert prompt.entries("~") and prompt.entries("~nobody/a") and prompt.entries(300 * "a"), "names without a place"
    push(driver, "Esc")


def test_a_click_selects_and_outlines_the_visible_object(driver: Driver, editor: Editor) -> None:
    """The corners of the box's bounds are marked over an unchanged picture. Esc deselects, and a drag selects nothing."""
    canvas = driver.canvas()
    driver.click(*box_at(driver))
    assert editor.mesh == BOX and np.array_equal(driver.canvas(), canvas), "the outline is no part of the picture"
    window, positions, layout = driver.window(), driver.session.scene.meshes[BOX].positions, driver.viewer.interface.layout
    for corner in product(*zip(positions.min(0).tolist(), positions.max(0).tolist(), strict=True)):
        place = layout.seen(driver.session.camera, corner)
        assert place is not None
        if place[1] > 120.0:  # the legend hides it
            continue
        around = window[int(place[1]) - 2 : int(place[1]) + 3, int(place[0]) - 2 : int(place[0]) + 3].astype(int)
        assert (around[..., 0] - around[..., 2] > 80).any(), "the mark is amber"
    x, y = box_at(driver)
    push(driver, "Esc")
    assert editor.mesh is None
    driver.drag((x, y), (x + 30.0, y))
    assert editor.mesh is None


def test_a_right_click_opens_a_menu_and_the_outliner_selects(driver: Driver, editor: Editor) -> None:
    """A right click without a drag opens the menu of the object; a right drag rotates the camera."""
    x, y = box_at(driver)
    driver.move(x, y)
    driver.frame()
    driver.button(True, RIGHT)
    for _ in range(2):  # the first motion of a captured mouse is a jump
        driver.move(0.0, 0.0, 40.0, 0.0)
    driver.button(False, RIGHT)
    driver.frame(2)
    assert editor.mesh is None
    push(driver, "Home")
    driver.frame(3)
    driver.click(x, y, RIGHT)
    assert editor.mesh == BOX
    driver.choose("Delete")
    assert hidden(editor) == [BOX] and editor.mesh is None
    push(driver, "Ctrl+Z")
    assert hidden(editor) == []
    driver.actions.toggle("outliner")
    driver.resize((760, 640), density=0.125)
    driver.frame(3)
    driver.choose(editor.loaded.meshes[WALLS].name)
    assert editor.mesh == WALLS


def test_a_drag_of_a_handle_is_one_step_of_undo(driver: Driver) -> None:
    """Dragging the arrow along x moves the box with the mouse, as one step of undo, with a still camera and no hole."""
    editor = driver.actions.editor
    camera, before = driver.session.camera, bounds_of(editor.scene.meshes[BOX])
    editor.mesh = BOX
    driver.resize(SIZE, density=0.5)
    driver.frame(2)
    x, y = box_at(driver)
    driver.drag((x + 25.0, y), (x + 65.0, y))
    offset = bounds_of(editor.scene.meshes[BOX]) - before
    assert (offset[:, 0] > 0.1).all() and offset[:, 1:] == pytest.approx(0.0, abs=1e-5) and driver.session.camera == camera
    assert box_at(driver) == pytest.approx((x + 40.0, y), abs=4.0), "the box follows the mouse"
    assert editor.mesh == BOX and len(editor.past) == 1
    driver.settle()
    assert driver.session.progress[0].coverage == 1.0
    driver.actions.editor.undo()
    assert driver.session.scene is editor.loaded


def test_a_moved_spot_keeps_its_direction_and_the_legend_of_light_draws_nothing(driver: Driver, editor: Editor) -> None:
    """The shadow maps, and the direct light with them, follow a move at the next tick and not for a legend."""
    lamp = editor.scene.lights[0]
    editor.set_light(0, replace(lamp, spot_target=vector(np.subtract(lamp.position, (0.1, 0.3, 0.0))), spot_cutoff=40.0))
    driver.actions.toggle("lights")
    driver.resize(SIZE, density=0.5)
    driver.frame(2)
    before, (x, y) = editor.scene.lights[0], driver.seen(lamp.position)
    driver.drag((x + 25.0, y), (x + 65.0, y))
    moved = editor.scene.lights[0]
    assert moved.position[0] > before.position[0] + 0.05 and moved.spot_target is not None
    assert np.subtract(moved.position, moved.spot_target) == pytest.approx((0.1, 0.3, 0.0))
    editor.set_light(0, before)
    assert BUFFERS["light"].legend(driver.session.source(0)).unit == "lux"
    assert driver.session.renderers[0].shadows is None


def test_the_object_panel_sets_the_emission(driver: Driver, editor: Editor) -> None:
    editor.mesh, driver.session.options.controls = BOX, True
    driver.resize((760, 640), density=0.25)
    driver.frame(3)
    driver.enter(driver.find("cd/m²"), "358")
    assert driver.session.scene.meshes[BOX].material.emission == pytest.approx((2.0, 2.0, 2.0))
    push(driver, "Ctrl+Z")
    assert driver.session.scene is editor.loaded and len(editor.future) == 1
    driver.enter(driver.find("cd/m²"), "1e38")  # beyond the limit of a material
    assert driver.session.scene is editor.loaded and "emission" in driver.actions.messages.errors[0].text


def test_lights_change_their_temperature_and_are_deleted(driver: Driver, editor: Editor) -> None:
    """A colour temperature keeps the luminance, and a dimmed light its colour. Without lights, the converged view is covered."""
    driver.actions.toggle("lights")
    driver.resize((760, 900), density=0.125)
    driver.frame(3)
    bright = np.array(driver.session.scene.lights[0].color)
    driver.enter(driver.find("kelvin"), "2700")
    light = driver.session.scene.lights[0]
    driver.enter(driver.find("candela"), "1e38")  # beyond the limit of a light
    driver.enter(driver.find("kelvin"), "nan")
    assert "color" in driver.actions.messages.errors[0].text and driver.session.scene.lights[0] == light
    assert light.color[0] > light.color[2]
    assert LUMINANCE @ light.color == pytest.approx(LUMINANCE @ bright, rel=1e-4)
    for candela in ("0", "179"):
        driver.enter(driver.find("candela"), candela)
    dimmed = np.array(driver.session.scene.lights[0].color)
    assert dimmed / dimmed.max() == pytest.approx(np.array(light.color) / max(light.color), rel=1e-4)
    driver.session.options.frozen = False
    push(driver, "Delete")
    assert not editor.scene.lights and editor.light is None
    driver.settle()
    assert driver.session.progress[0].coverage == 1.0
    driver.actions.editor.undo()
    assert editor.light == 0  # the restored light is selected again
    while driver.actions.editor.undo():
        pass
    assert driver.session.scene.lights == editor.loaded.lights


def test_lights_and_views_are_added(driver: Driver, editor: Editor, tmp_path: Path) -> None:
    """A copy has the output of its original and another place. A light that copies none or a sun is in front of the camera.

    The saved scene has the added lights, and the kept view as a camera.
    """
    before, count = editor.scene.lights[0], len(editor.scene.lights)
    push(driver, "Insert")
    assert editor.light == count and driver.session.options.lights
    copy = editor.scene.lights[count]
    assert copy.color == before.color and copy.position != before.position
    editor.set_light(0, replace(before, directional=True))
    editor.pick_light(0)
    push(driver, "Insert")
    made = editor.scene.lights[editor.light or 0]
    middle = 0.5 * np.add(driver.session.camera.eye, driver.session.camera.target)
    assert made.position == pytest.approx(middle) and max(made.color) > 0.0 and not made.directional
    driver.session.free_camera.turn(0.3, 0.0)
    editor.keep_view()
    driver.actions.save(str(tmp_path / "more.scene"))
    saved = irrsplat.load(tmp_path / "more.scene")
    assert len(saved.lights) == count + 2 and saved.cameras[-1].target == pytest.approx(driver.session.camera.target)
    while editor.undo():
        pass
    assert editor.scene.lights == editor.loaded.lights and editor.scene.cameras == editor.loaded.cameras


def test_colour_fields_are_srgb(driver: Driver, editor: Editor) -> None:
    """In sRGB, 128 of 255 is a linear 0.2159 (IEC 61966-2-1); colours of lights are relative to the brightest component."""
    driver.resize((760, 640), density=0.125)
    editor.mesh, driver.session.options.controls = 1, True
    driver.frame(4)
    driver.enter(Widget("color_edit3", "", _third(driver.find("reflectance"))), "128")
    assert editor.scene.meshes[1].material.albedo[0] == pytest.approx(0.2159, abs=1e-4)
    editor.mesh = None
    driver.actions.toggle("lights")
    driver.frame(4)
    driver.enter(Widget("color_edit3", "", _third(driver.find("colour"))), "128")
    assert editor.scene.lights[0].color[0] / max(editor.loaded.lights[0].color) == pytest.approx(0.2159, abs=1e-4)
    editor.set_light(0, replace(editor.scene.lights[0], color=(3.0, 0.3, 0.3)))
    driver.frame(2)
    driver.enter(Widget("color_edit3", "", _third(driver.find("colour"))), "128")
    assert editor.scene.lights[0].color == pytest.approx((3.0, 3.0 * 0.1 / 0.2159, 3.0 * 0.1 / 0.2159), rel=1e-2), "not dimmed"


def _third(field: Widget) -> tuple[float, float, float, float]:
    """Return the box of the red component of a colour field."""
    left, top, right, bottom = field.box
    return left, top, left + 0.2 * (right - left), bottom


def test_unsaved_changes_give_a_prompt(driver: Driver, editor: Editor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Quitting and opening another scene prompt for unsaved changes, with the answers cancel, discard and save.

    Quitting during a film gives a warning, and the film's progress messages do not replace the warning.
    """
    with monkeypatch.context() as filming:
        filming.setattr(FilmInBackground, "busy", True)
        push(driver, "Ctrl+Q")
        driver.actions.say(driver.actions.film.progress, topic="film")
        assert not driver.actions.quitting and "Quit again" in driver.said
    assert not editor.unsaved
    driver.actions.editor.set_light(0, brighter(editor.scene.lights[0]))
    push(driver, "Ctrl+Q")
    driver.frame(2)
    assert not driver.actions.quitting
    driver.choose("cancel")
    assert driver.actions.prompt is None and editor.unsaved
    push(driver, "Ctrl+Q")
    driver.frame(2)
    driver.press("ENTER")  # the first answer, save
    driver.frame(4)
    driver.press("ENTER")  # the suggested name
    driver.frame(2)
    assert driver.actions.quitting and not editor.unsaved and os.path.exists(driver.actions.saved_as)
    driver.actions.quitting = driver.wnd.is_closing = False
    driver.actions.editor.set_light(0, brighter(editor.scene.lights[0]))
    driver.actions.open("furnace")
    driver.frame(3)
    assert driver.session.scene.name == "room"
    driver.choose("discard")
    assert driver.session.scene.name == "furnace"
