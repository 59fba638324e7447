"""Hands on the scene: picking, handles, panels, undo and redo."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.app.viewer.editing.editor import KINDS, Editor
from irrsplat.app.viewer.editing.lamps import Vector
from irrsplat.app.viewer.editing.picking import on_screen
from irrsplat.app.viewer.editing.scene_edit import AS_LOADED, ObjectEdit, middle
from irrsplat.app.viewer.input.keys import KEYS
from irrsplat.app.viewer.ui.layout import Layout
from tests.support.viewing import SIZE, Cases, Driver, push

WALLS, LEFT_WALL, BOX = range(3)

CASES = Cases("lights and objects")
case = CASES.case


@pytest.fixture(autouse=True)
def panels_beside_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Panels stand where they would in a large window: pulled into this small one they would lie over what is clicked."""
    monkeypatch.setattr(Layout, "keep_inside", lambda layout, name: True)
    monkeypatch.setattr(Layout, "_free_place", lambda layout, *taken: (360.0, 30.0))


def editor(driver: Driver) -> Editor:
    return driver.actions.editor


def place(driver: Driver, point: np.ndarray | Vector) -> tuple[float, float]:
    """Where a world point is in the window."""
    x, y, z = np.asarray(point, float).tolist()
    found = on_screen(driver.session.camera, SIZE, (x, y, z))
    assert found is not None
    return found


def box_at(driver: Driver) -> tuple[float, float]:
    """Where the middle of the box is in the window."""
    return place(driver, middle(driver.session.scene.meshes[BOX]))


# ---- keys ------------------------------------------------------------------------------------------------------------------


def test_every_key_has_its_case() -> None:
    CASES.check()


@pytest.mark.parametrize("shown", CASES.keys)
def test_a_key_does_what_it_says(driver: Driver, shown: str) -> None:
    CASES.run(driver, shown)


@case("O")
def turn_handles(driver: Driver, shown: str) -> None:
    """It turns the picked box about its middle, and moves it again at the next press."""
    editor(driver).pick_mesh(BOX)
    push(driver, shown)
    assert editor(driver).turning and driver.said == "handles turn"
    push(driver, shown)
    assert not editor(driver).turning


@case("Backspace")
def hide_object(driver: Driver, shown: str) -> None:
    push(driver, shown)
    assert "nothing is picked" in driver.said and not editor(driver).changed
    editor(driver).pick_mesh(BOX)
    before = driver.display.mesh_at((int(box_at(driver)[0]), int(box_at(driver)[1])))
    here = int(box_at(driver)[0]), int(box_at(driver)[1])
    push(driver, shown)
    assert editor(driver).hidden == [BOX] and editor(driver).mesh is None and "box is hidden" in driver.said
    driver.settle()
    assert before == BOX and driver.display.mesh_at(here) == WALLS, "what is behind it"
    driver.actions.show_hidden(BOX)
    driver.settle()
    assert driver.display.mesh_at(here) == BOX and driver.session.progress[0].coverage == 1.0


@case("Ctrl+Z", "Ctrl+Y", "Ctrl+Shift+Z")
def undo_and_redo(driver: Driver, shown: str) -> None:
    """Two steps are undone, and done again by either key."""
    states = [editor(driver).edit]
    for x in (0.1, 0.2):
        editor(driver).set_object(BOX, ObjectEdit(offset=(x, 0.0, 0.0)))
        driver.frame()
        states.append(editor(driver).edit)
    for expected in (states[1], states[0], states[0]):
        push(driver, "Ctrl+Z")
        assert editor(driver).edit == expected
    assert driver.said.endswith("there is nothing to undo") and driver.session.scene.meshes is editor(driver).loaded.meshes
    again = "Ctrl+Y" if shown == "Ctrl+Z" else shown
    for expected in states[1:]:
        push(driver, again)
        assert editor(driver).edit == expected
    push(driver, again)
    assert driver.said.endswith("there is nothing to do again") and driver.session.scene.meshes[BOX].positions[:, 0].max() > 0.6
    assert not driver.session.options.points and driver.session.truths.traced is None, "the keys without Ctrl are others"


@case("Ctrl+S")
def save(driver: Driver, shown: str) -> None:
    """It asks for a name, and proposes one that is free; nothing flies off while it is typed."""
    push(driver, shown)
    assert driver.actions.panels.save and not driver.viewer.controls.pressed
    driver.frame(2)
    assert driver.viewer.interface.save_dialog.typed == "room-2.scene"
    driver.choose("save")
    assert not driver.actions.panels.save and "room-2.scene is written" in driver.said
    push(driver, shown)
    driver.frame(2)
    assert driver.find("overwrite").kind == "button", "never unasked"
    push(driver, "Esc")
    assert not driver.actions.panels.save


def test_no_two_keys_are_one() -> None:
    assert len({(key.name, key.ctrl, key.shift) for key in KEYS}) == len(KEYS)


# ---- picking ---------------------------------------------------------------------------------------------------------------


def test_a_click_picks_what_is_seen_and_outlines_it(driver: Driver) -> None:
    """The line lies around the box and nowhere else; nothing of the core is drawn for it, and Esc or a click beside lets go."""
    canvas = driver.canvas()
    driver.click(*box_at(driver))
    assert editor(driver).mesh == BOX and driver.session.at_rest
    assert np.array_equal(driver.canvas(), canvas), "the picture itself is as before"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver.viewer.interface, "draw", lambda *args, **more: None)
        driver.frame()
        outlined = driver.window()
    changed = (outlined != canvas).any(-1)
    assert (outlined[changed] == (255, 184, 64)).all(-1).sum() > 100, "bright"
    assert (outlined[changed].max(-1) < 90).sum() > 50, "and a dark seam"
    x, y = box_at(driver)
    rows, columns = np.nonzero(changed)
    assert columns.min() < x - 15 and columns.max() > x + 15 and abs(columns.mean() - x) < 15 and abs(rows.mean() - y) < 15
    assert changed.mean() < 0.03 and not changed[int(y), int(x)]
    push(driver, "Esc")
    assert editor(driver).mesh is None
    driver.click(*box_at(driver))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver.display, "mesh_at", lambda cursor: None)  # this room leaves no pixel empty
        driver.click(60.0, 100.0)
    assert editor(driver).mesh is None and editor(driver).light is None


def test_a_drag_picks_nothing(driver: Driver) -> None:
    before = driver.session.camera
    driver.drag(box_at(driver), (box_at(driver)[0] + 30.0, box_at(driver)[1]))
    assert editor(driver).mesh is None and driver.session.camera != before


def test_a_ring_is_picked_while_the_lights_are_shown(driver: Driver) -> None:
    """Else what is behind it."""
    ring = place(driver, driver.session.scene.lights[0].position)
    driver.click(*ring)
    assert editor(driver).mesh == WALLS
    driver.actions.panels.lights = True
    editor(driver).pick_light(None)
    editor(driver).pick_mesh(BOX)
    driver.frame()
    driver.click(ring[0] + 4.0, ring[1])
    assert editor(driver).light == 0 and editor(driver).mesh is None


# ---- handles ---------------------------------------------------------------------------------------------------------------


def test_a_drag_on_the_handles_moves_the_object_and_is_one_step(driver: Driver) -> None:
    """The arrow along x points to the right; the camera stays, records follow in every frame, and there is no hole after it."""
    camera, edit = driver.session.camera, editor(driver).edit
    editor(driver).pick_mesh(BOX)
    driver.frame(2)
    x, y = box_at(driver)
    driver.move(x + 25.0, y)
    driver.frame(2)
    assert editor(driver).handles_used
    driver.drag((x + 25.0, y), (x + 65.0, y))
    offset = editor(driver).object(BOX).offset
    assert offset[0] > 0.1 and offset[1:] == pytest.approx((0.0, 0.0), abs=1e-5) and driver.session.camera == camera
    now = box_at(driver)
    assert now[0] - x == pytest.approx(40.0, abs=4.0) and now[1] == pytest.approx(y, abs=1.0), "it goes with the mouse"
    assert editor(driver).mesh == BOX and len(editor(driver).history.past) == 1 and editor(driver).undoes == "box: move"
    driver.settle()
    assert driver.session.progress[0].coverage == 1.0
    assert editor(driver).handles_used, "the mouse is still there"
    driver.actions.undo()
    assert editor(driver).edit == edit and driver.session.scene.meshes is editor(driver).loaded.meshes


def test_the_handles_turn_it_in_place(driver: Driver) -> None:
    editor(driver).pick_mesh(BOX)
    editor(driver).turning = True
    driver.frame(2)
    x, y = box_at(driver)
    radius = next(r for r in range(20, 70, 2) if turns_at(driver, x + r, y))
    driver.drag((x + radius, y), (x + radius, y - 30.0))
    edit = editor(driver).object(BOX)
    assert any(abs(a) > 2.0 for a in edit.turn) and edit.offset == (0.0, 0.0, 0.0)
    assert middle(driver.session.scene.meshes[BOX]) == pytest.approx(middle(editor(driver).loaded.meshes[BOX]), abs=0.02)


def turns_at(driver: Driver, x: float, y: float) -> bool:
    """Whether the handles are under the mouse there."""
    driver.move(x, y)
    driver.frame()
    return editor(driver).handles_used


def test_the_handles_move_a_light_and_aim_a_spot(driver: Driver) -> None:
    driver.actions.panels.lights = True
    driver.actions.add_light("spot")
    driver.frame(3)
    number = editor(driver).light
    assert number == 1
    before = driver.session.scene.lights[number]
    for aiming in (False, True):
        editor(driver).aiming = aiming
        point = before.spot_target if aiming else before.position
        assert point is not None
        driver.frame(2)
        x, y = place(driver, point)
        driver.drag((x, y), (x + 20.0, y + 5.0))  # the middle moves it in the plane of the screen
        light = driver.session.scene.lights[number]
        now = light.spot_target if aiming else light.position
        assert now is not None and place(driver, now) == pytest.approx((x + 20.0, y + 5.0), abs=4.0)
    assert len(editor(driver).history.past) == 3, "added, moved, aimed"


def test_the_handles_turn_a_directional_light(driver: Driver) -> None:
    """In the middle of the scene, by a drag on a ring; its strength stays, and the drag is one step."""
    driver.actions.panels.lights = True
    driver.actions.add_light("directional")
    driver.frame(3)
    before = np.asarray(driver.session.scene.lights[1].position)
    x, y = place(driver, driver.session.scene.bounds.mean(0))
    radius = next(r for r in range(20, 70, 2) if turns_at(driver, x + r, y))
    driver.drag((x + radius, y), (x + radius, y - 30.0))
    after = np.asarray(driver.session.scene.lights[1].position)
    cosine = after @ before / np.linalg.norm(before) ** 2
    assert np.linalg.norm(after) == pytest.approx(np.linalg.norm(before)) and 0.3 < cosine < 0.999
    assert editor(driver).undoes == "directional 1: turn" and len(editor(driver).history.past) == 2
    driver.actions.undo()
    assert driver.session.scene.lights[1].position == pytest.approx(tuple(before))


# ---- panels ----------------------------------------------------------------------------------------------------------------


def widen(driver: Driver) -> None:
    """A window in which a panel has room; records stay as they are."""
    driver.session.options.frozen = True
    driver.resize((760, 640))
    driver.frame(3)


def test_the_object_panel_names_moves_and_paints(driver: Driver) -> None:
    editor(driver).pick_mesh(BOX)
    widen(driver)
    driver.drag(driver.find("moved by").at(0.15), driver.find("moved by").at(0.4))
    assert editor(driver).object(BOX).offset[0] > 0.0 and len(editor(driver).history.past) == 1
    driver.drag(driver.find("turned by").at(0.5), driver.find("turned by").at(0.8))
    assert editor(driver).object(BOX).turn[1] > 0.0
    driver.enter(driver.find("glows"), "2")
    assert driver.session.scene.meshes[BOX].material.emission == pytest.approx((2.0, 2.0, 2.0))
    driver.choose("as loaded")
    assert editor(driver).object(BOX) == AS_LOADED and driver.session.scene.meshes is editor(driver).loaded.meshes
    assert len(editor(driver).history.past) == 4


def test_lights_are_added_heated_narrowed_and_deleted(driver: Driver) -> None:
    driver.actions.panels.lights = True
    widen(driver)
    for count, kind in enumerate(KINDS, 2):
        driver.choose(f"add {kind}")
        light = driver.session.scene.lights[-1]
        assert len(driver.session.scene.lights) == count and light.kind == kind and editor(driver).light == count - 1
    editor(driver).pick_light(2)
    driver.frame(2)
    bright = np.array(driver.session.scene.lights[2].color)
    driver.enter(driver.find("kelvin"), "2700")
    driver.enter(driver.find("cone"), "12")
    light = driver.session.scene.lights[2]
    assert light.color[0] > light.color[2] and light.spot_cutoff == pytest.approx(12.0) and light.spot_inner <= 12.0
    assert np.dot(light.color, (0.2126, 0.7152, 0.0722)) == pytest.approx(np.dot(bright, (0.2126, 0.7152, 0.0722)), rel=1e-4)
    for count in (3, 2, 1, 0):
        driver.choose("delete")
        assert len(driver.session.scene.lights) == count
    assert editor(driver).light is None
    while driver.actions.editor.undo():
        pass
    assert driver.session.scene.lights == editor(driver).loaded.lights


def test_another_number_of_lights_leaves_no_hole(driver: Driver) -> None:
    """Shaders are compiled for the number of lights and their kinds; each room is lit by all of them, and by none."""
    for kind in KINDS:
        driver.actions.add_light(kind)
    driver.settle()
    assert driver.session.progress[0].coverage == 1.0 and len(driver.session.renderers[0].scene.lights) == 4
    while editor(driver).lamps:
        editor(driver).delete_light(0)
    driver.settle()
    assert driver.session.progress[0].coverage == 1.0 and not driver.session.renderers[0].scene.lights


def test_the_edit_menu_undoes_and_shows_what_is_hidden(driver: Driver) -> None:
    editor(driver).hide(BOX)
    driver.frame(2)
    driver.choose("Edit", "show box")
    assert not editor(driver).hidden
    driver.choose("Edit", "undo: box: show")
    assert editor(driver).hidden == [BOX]
    driver.choose("Edit", "redo: box: show")
    assert not editor(driver).hidden


def test_a_change_that_is_refused_changes_nothing(driver: Driver) -> None:
    edit, scene = editor(driver).edit, driver.session.scene
    assert not driver.actions.attempt(lambda: editor(driver).set_object(BOX, ObjectEdit(offset=(1e39, 0.0, 0.0))))
    assert editor(driver).edit is edit and driver.session.scene is scene and "32-bit" in driver.said
    assert driver.session.renderers[0].scene.meshes == scene.meshes


def test_two_presets_show_the_same_edit(driver: Driver) -> None:
    driver.split_presets()
    editor(driver).set_object(BOX, ObjectEdit(offset=(0.1, 0.0, 0.0), albedo=(0.9, 0.1, 0.1)))
    driver.frame()
    assert [r.scene.meshes[BOX] is driver.session.scene.meshes[BOX] for r in driver.session.renderers] == [True, True]
