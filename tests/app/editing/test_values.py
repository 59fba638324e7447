"""What is edited, as values: the history, where objects stand, colours by temperature, and the scene that comes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.editing.colour_temperature import COLDEST, HOTTEST, blackbody, tristimulus
from irrsplat.app.viewer.editing.history import MOST, History
from irrsplat.app.viewer.editing.lamps import Lamp
from irrsplat.app.viewer.editing.picking import mesh_of, triangles_of
from irrsplat.app.viewer.editing.scene_edit import EditedScene, ObjectEdit, SceneEdit, angles, describe, middle, rotation
from irrsplat.core.color import LUMINANCE
from irrsplat.scene.change import SceneChange
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Scene
from tests.support.viewing import write_room

BOX = 2  # the room's meshes are its walls, the left one, and a box


@pytest.fixture
def room(tmp_path: Path) -> Scene:
    return irrsplat.load(write_room(tmp_path))


def test_a_step_undone_and_done_again_is_the_same_state() -> None:
    history = History(0)
    for state in (1, 1, 2, 3):
        history = history.then(state)
    assert history == History(3, (0, 1, 2)), "the same state again is no step"
    back = history.undone().undone()
    assert back.present == 1 and back.redone().redone() == history and back.redone().undone() == back
    assert back.then(7) == History(7, (0, 1)), "what was undone is given up"
    assert History(0).undone() == History(0) == History(0).redone()


def test_a_history_has_an_end() -> None:
    history = History(-1)
    for state in range(2 * MOST):
        history = history.then(state)
    assert len(history.past) == MOST and history.past[-1] == 2 * MOST - 2


def test_angles_say_the_same_turn() -> None:
    """Any turn, and those straight up and down, where two of the angles turn about one axis."""
    draw = np.random.default_rng(4)
    for turn in [*draw.uniform(-180.0, 180.0, (50, 3)), (20.0, 90.0, 40.0), (20.0, -90.0, 40.0), (0.0, 0.0, 0.0)]:
        matrix = rotation((float(turn[0]), float(turn[1]), float(turn[2])))
        assert rotation(angles(matrix)) == pytest.approx(matrix, abs=1e-9)
        assert matrix @ matrix.T == pytest.approx(np.eye(3)) and np.linalg.det(matrix) == pytest.approx(1.0)


def test_a_turn_is_about_the_middle_of_the_box(room: Scene) -> None:
    edit = ObjectEdit(offset=(0.1, 0.2, 0.3), turn=(10.0, 20.0, 30.0))
    pivot = middle(room.meshes[BOX])
    assert edit.matrix(pivot) @ [*pivot, 1.0] == pytest.approx([*(pivot + edit.offset), 1.0])
    assert edit.matrix(pivot)[:3, :3] == pytest.approx(rotation(edit.turn))


@pytest.mark.parametrize(("kelvin", "x", "y"), [(2000.0, 0.5267, 0.4133), (2856.0, 0.4476, 0.4074), (6500.0, 0.3135, 0.3237)])
def test_black_bodies_have_their_chromaticities(kelvin: float, x: float, y: float) -> None:
    """2856 K is illuminant A (ISO 11664-2); the others are of the Planckian locus (Wyszecki and Stiles 2000). The fits of the
    matching functions are good to a hundredth."""
    X, Y, Z = tristimulus(kelvin)
    assert pytest.approx((x, y), abs=0.006) == (X / (X + Y + Z), Y / (X + Y + Z))


def test_hotter_is_bluer_at_the_same_luminance() -> None:
    colours = np.array([blackbody(k) for k in np.linspace(COLDEST, HOTTEST, 40)])
    assert colours @ LUMINANCE == pytest.approx(1.0) and (colours >= 0.0).all()
    assert (np.diff(colours[:, 0]) < 0.0).all() and (np.diff(colours[:, 2]) >= 0.0).all()
    assert np.array(blackbody(6500.0)) == pytest.approx(1.0, abs=0.06), "about white"


def test_a_lamp_by_kelvin_keeps_its_luminance(room: Scene) -> None:
    lamp = Lamp.of(replace(room.lights[0], color=(3.0, 1.0, 0.2)))
    warm = lamp.heated(2700.0)
    assert LUMINANCE @ np.array(warm.light.color) == pytest.approx(LUMINANCE @ np.array(lamp.light.color))
    assert warm.light.color[0] > warm.light.color[1] > warm.light.color[2] and warm.kelvin == 2700.0
    assert warm.coloured((1.0, 1.0, 1.0)).kelvin is None
    assert Lamp.of(lamp.light).emitted == lamp.light and replace(lamp, on=False).emitted.color == (0.0, 0.0, 0.0)


def test_what_an_edit_leaves_alone_is_the_same_mesh(room: Scene) -> None:
    """So that renderers do not take it for moved; painted meshes share their triangles, hidden ones lie within what is shown."""
    made, edit = EditedScene(room), SceneEdit.of(room)
    assert made.scene(edit).meshes is room.meshes and made.scene(edit).lights == room.lights
    moved = edit.with_object(BOX, ObjectEdit(offset=(0.1, 0.0, 0.0)))
    first = made.scene(moved)
    assert first.meshes[:2] == room.meshes[:2] and first.meshes[BOX].positions == pytest.approx(
        room.meshes[BOX].positions + np.array([0.1, 0.0, 0.0]), abs=1e-6
    )
    assert made.scene(moved).meshes is first.meshes
    painted = made.scene(moved.with_object(BOX, replace(moved.objects[BOX], albedo=(0.1, 0.2, 0.3))))
    assert painted.meshes[BOX].positions is first.meshes[BOX].positions and painted.meshes[BOX].material.albedo == (0.1, 0.2, 0.3)
    change = SceneChange.between(first, painted)
    assert (change.moved, change.repainted, change.relit, change.hides) == ((), (BOX,), False, False)
    gone = made.scene(moved.with_object(0, ObjectEdit(hidden=True)))
    assert gone.meshes[0].is_point and SceneChange.between(first, gone).hides
    shown = np.concatenate([mesh.positions for mesh in gone.meshes[1:]])
    assert gone.bounds == pytest.approx(np.array([shown.min(0), shown.max(0)]))
    assert made.scene(edit).meshes is room.meshes


def test_triangles_are_those_of_their_meshes(room: Scene) -> None:
    """As flatten numbers them, closed meshes first."""
    vertices, faces, _ = flatten(room)
    for number, mesh in enumerate(room.meshes):
        first, count = triangles_of(room, number)
        assert vertices[faces[first : first + count], :3] == pytest.approx(mesh.positions[mesh.faces])
        assert {mesh_of(room, i) for i in range(first, first + count)} == {number}
    assert triangles_of(room, BOX)[0] == 0 and mesh_of(room, len(faces)) is None and mesh_of(room, -1) is None


def test_a_step_is_said_in_words(room: Scene) -> None:
    edit = SceneEdit.of(room)
    lamp = edit.lamps[0]
    for after, words in (
        (edit.with_object(BOX, ObjectEdit(offset=(1.0, 0.0, 0.0))), "box: move"),
        (edit.with_object(BOX, ObjectEdit(turn=(1.0, 0.0, 0.0))), "box: turn"),
        (edit.with_object(1, ObjectEdit(hidden=True)), "left: hide"),
        (edit.with_object(0, ObjectEdit(albedo=(0.0, 0.0, 0.0))), "walls: colour"),
        (edit.with_lamp(0, lamp.moved((0.0, 0.0, 0.0))), "lamp: move"),
        (edit.with_lamp(0, replace(lamp, on=False)), "lamp: off"),
        (edit.with_lamp(0, lamp.heated(3000.0)), "lamp: colour"),
        (replace(edit, lamps=()), "delete a light"),
        (replace(edit, lamps=(lamp, lamp)), "add a light"),
        (edit, "nothing"),
    ):
        assert describe(edit, after, room) == words
