"""The handles in the picture that move and turn the picked object or light. ImGuizmo draws them."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from imgui_bundle import imgui, imguizmo

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.light_edit import LightEdit
from irrsplat.app.viewer.editing.picking import pixel_of
from irrsplat.app.viewer.editing.scene_edit import bounds_of
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.ui.layout import AMBER, Layout, line
from irrsplat.app.viewer.view_options import Point, point_of
from irrsplat.scene.model import Light
from irrsplat.scene.stand_ins.up_axis import axes as upright_axes

_gizmo = imguizmo.im_guizmo
_NEAR, _FAR = 1e-3, 1e3  # scene diagonals: the clip planes of the handles' projection
_SIZE = 0.16  # share of the picture: the size of the handles
_NOISE = 1e-6  # scene diagonals, and absolute in rotations: rounding of ImGuizmo's float32


def draw_handles(actions: Actions, layout: Layout) -> None:
    """Draw handles over the picture at the selection. A drag changes the edit continuously."""
    editor = actions.editor
    if not actions.session.views or actions.session.options.inspect:  # a click inspects a record in that mode
        return
    if editor.mesh is not None:
        number, edit = editor.mesh, editor.edit.objects[editor.mesh]
        _draw_box(actions.session, layout, number)
        origin = bounds_of(editor.loaded.meshes[number]).mean(0)
        axes = np.array(edit.turn)
        place, turn = _dragged(actions, layout, origin + edit.offset, axes, True, True)
        if not np.array_equal(place, origin + edit.offset):
            edit = replace(edit, offset=point_of(place - origin))
        if turn is not axes:
            edit = replace(edit, turn=(point_of(turn[0]), point_of(turn[1]), point_of(turn[2])))
        if edit != editor.edit.objects[number]:
            actions.attempt(lambda: editor.set_object(number, edit))
    elif editor.light is not None and actions.panels.lights:
        light_number, edited = editor.light, editor.lights[editor.light]
        light = edited.light
        at = _middle(actions.session) if light.directional else light.position
        axes, turns = _axes_of(light), light.directional or light.spot_target is not None
        place, turn = _dragged(actions, layout, np.asarray(at), axes, not light.directional, turns)
        if not np.array_equal(place, at) and point_of(place) != light.spot_target:  # a spot's target never lies at its own place
            edited = edited.moved(point_of(place))
        if turn is not axes:
            edited = _aimed(edited, turn[:, 2])
        if edited != editor.lights[light_number]:
            actions.attempt(lambda: editor.set_light(light_number, edited))


def _draw_box(session: Session, layout: Layout, number: int) -> None:
    """Draw the edges of the picked object's bounding box, a bright line on a dark one."""
    ends = bounds_of(session.scene.meshes[number])
    corners = [layout.seen(session.camera, point_of(ends[bits, range(3)])) for bits in product((0, 1), repeat=3)]
    with layout.over_picture() as draw:
        for i, axis in product(range(8), (1, 2, 4)):
            if not i & axis:
                line(draw, corners[i], corners[i | axis], AMBER, 1.5 * layout.scale)


def _dragged(
    actions: Actions, layout: Layout, place: np.ndarray, axes: np.ndarray, moves: bool, turns: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Draw handles at a place (3,) with axes (3, 3). Return the place and the axes after a drag.

    An unchanged place has equal values; unchanged axes are the same array.
    """
    editor, camera, (width, height) = actions.editor, actions.session.camera, layout.picture_size
    _gizmo.begin_frame()
    _gizmo.set_drawlist(imgui.get_background_draw_list())
    _gizmo.set_orthographic(False)
    _gizmo.allow_axis_flip(False)
    _gizmo.set_gizmo_size_clip_space(_SIZE)
    _gizmo.set_rect(*layout.picture[:2], width, height)
    unit = editor.loaded.diagonal  # ImGuizmo hides handles within a millimetre of the eye
    view_from_world, matrix = camera.view_from_world.copy(), np.eye(4)
    view_from_world[:3, 3] /= unit
    views = _matrix16(view_from_world), _matrix16(camera.clip_from_view(width / max(height, 1.0), _NEAR, _FAR))
    matrix[:3, :3], matrix[:3, 3] = axes, place / unit
    found = [place, axes]
    for i, operation in enumerate((_gizmo.OPERATION.translate, _gizmo.OPERATION.rotate)):
        if not (moves, turns)[i]:
            continue
        placed = _matrix16(matrix)
        _gizmo.push_id(i)
        changed = _gizmo.manipulate(*views, operation, _gizmo.MODE.world, placed) and _gizmo.is_using()
        editor.dragging |= _gizmo.is_using()
        editor.handles_used |= _gizmo.is_using() or _gizmo.is_over(operation)
        _gizmo.pop_id()
        after = np.asarray(placed.values, float).reshape(4, 4).T
        if changed and np.isfinite(after).all():
            turned = after[:3, :3] / np.linalg.norm(after[:3, :3], axis=0)
            found[i] = (after[:3, 3] * unit, turned)[i]
    noise = np.abs(found[0] - place) < _NOISE * unit
    return np.where(noise, place, found[0]), axes if np.abs(found[1] - axes).max() < _NOISE else found[1]


def _middle(session: Session) -> Point:
    """Return the place of a directional light's handles: the middle of the scene, or the camera's target if the middle is not
    in the picture."""
    camera, size = session.camera, session.size
    middle = point_of(session.scene.bounds.mean(0))
    return middle if pixel_of(camera, size, middle) is not None else point_of(np.asarray(camera.target, float))


def _aimed(edited: LightEdit, axis: np.ndarray) -> LightEdit:
    """Return the light with its direction along `axis`: a directional light comes from there, a spot aims the other way."""
    light = edited.light
    if light.directional:
        return edited.moved(point_of(axis * np.linalg.norm(light.position)))
    assert light.spot_target is not None
    distance = np.linalg.norm(np.subtract(light.spot_target, light.position))
    return edited.aimed(point_of(np.asarray(light.position) - axis * distance))


def _axes_of(light: Light) -> np.ndarray:
    """Return (3, 3) columns at right angles, the last one against the direction of the light."""
    if light.spot_target is None and not light.directional:
        return np.eye(3)
    against = np.asarray(light.position, float)
    against = against if light.spot_target is None else against - light.spot_target
    right, back, front = upright_axes(point_of(against))
    return np.stack([front, right, back], axis=1)


def _matrix16(matrix: np.ndarray) -> _gizmo.Matrix16:
    """Return a matrix (4, 4) in ImGuizmo's layout, column by column."""
    taken: _gizmo.Matrix16 = _gizmo.Matrix16(matrix.T.ravel().tolist())
    return taken
