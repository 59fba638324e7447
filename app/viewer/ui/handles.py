"""The handles in the picture by which the picked object or light is moved and turned: ImGuizmo's."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from imgui_bundle import imgui, imguizmo

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.light_edit import LightEdit
from irrsplat.app.viewer.editing.picking import on_screen
from irrsplat.app.viewer.editing.scene_edit import ObjectEdit, angles, middle, rotation
from irrsplat.app.viewer.ui.layout import AMBER, Layout, line
from irrsplat.app.viewer.view_options import Point, point_of
from irrsplat.scene.model import Light

_gizmo = imguizmo.im_guizmo
_NEAR, _FAR = 1e-2, 1e4  # metres
_SIZE = 0.16  # of the handles, share of the picture
_NOISE = 1e-6  # of the scene's diagonal, and of 1 in rotations: ImGuizmo's float32


class Handles:
    """Draws them over the picture, below all windows, and moves by them what is picked."""

    def __init__(self, actions: Actions, layout: Layout) -> None:
        self.actions, self.layout = actions, layout

    def draw(self) -> None:
        """Draw them where something is picked; a drag changes the edit as it goes."""
        actions, editor = self.actions, self.actions.editor
        if not actions.session.views or actions.session.options.inspect:  # then a click is for records
            return
        if editor.mesh is not None:
            number, edit = editor.mesh, editor.edit.objects[editor.mesh]
            self._box(number)
            origin = middle(editor.loaded.meshes[number])
            place, turn = self._dragged(origin + edit.offset, rotation(edit.turn), True, True)
            changed = replace(edit, offset=edit.offset if place is None else point_of(place - origin))
            self._apply_object(number, replace(changed, turn=changed.turn if turn is None else angles(turn)))
        elif editor.light is not None and actions.panels.lights:
            light_number, edited = editor.light, editor.lights[editor.light]
            light = edited.light
            at = self._middle() if light.directional else light.position
            place, turn = self._dragged(
                np.asarray(at), _axes_of(light), not light.directional, light.directional or light.spot_target is not None
            )
            if place is not None and point_of(place) != light.spot_target:  # a spot does not look at its own place
                edited = edited.moved(point_of(place))
            if turn is not None:
                edited = _aimed(edited, turn[:, 2])
            if edited != editor.lights[light_number]:
                actions.attempt(lambda: editor.set_light(light_number, edited))

    def _box(self, number: int) -> None:
        """Draw the edges of the picked object's bounding box, a bright line on a dark one."""
        session = self.actions.session
        positions = session.scene.meshes[number].positions
        if not len(positions):
            return
        ends = np.stack([positions.min(0), positions.max(0)]).astype(float)
        corners = [self.layout.seen(session.camera, point_of(ends[bits, range(3)])) for bits in product((0, 1), repeat=3)]
        with self.layout.over_picture() as draw:
            for i, axis in product(range(8), (1, 2, 4)):
                if not i & axis:
                    line(draw, corners[i], corners[i | axis], AMBER, 1.5 * self.layout.scale)

    def _apply_object(self, number: int, edit: ObjectEdit) -> None:
        editor = self.actions.editor
        if edit != editor.edit.objects[number]:
            self.actions.attempt(lambda: editor.set_object(number, edit))

    def _dragged(
        self, place: np.ndarray, axes: np.ndarray, moves: bool, turns: bool
    ) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Draw handles at a place (3,) with axes (3, 3). Return the place and the axes after a drag; None where unchanged."""
        editor, camera, (width, height) = self.actions.editor, self.actions.session.camera, self.layout.picture_size
        _gizmo.begin_frame()
        _gizmo.set_drawlist(imgui.get_background_draw_list())
        _gizmo.set_orthographic(False)
        _gizmo.allow_axis_flip(False)
        _gizmo.set_gizmo_size_clip_space(_SIZE)
        _gizmo.set_rect(*self.layout.picture[:2], width, height)
        views = _matrix16(camera.view_from_world), _matrix16(camera.clip_from_view(width / max(height, 1.0), _NEAR, _FAR))
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = axes, place
        found: list[np.ndarray | None] = [None, None]
        for i, drawn in enumerate((moves, turns)):
            if not drawn:
                continue
            operation, placed = (_gizmo.OPERATION.translate, _gizmo.OPERATION.rotate)[i], _matrix16(matrix)
            _gizmo.push_id(i)
            changed = _gizmo.manipulate(*views, operation, _gizmo.MODE.world, placed) and _gizmo.is_using()
            editor.dragging |= _gizmo.is_using()
            editor.handles_used |= _gizmo.is_using() or _gizmo.is_over(operation)
            _gizmo.pop_id()
            if changed:
                found[i] = np.asarray(placed.values, float).reshape(4, 4).T
        moved, turned = found
        diagonal = self.actions.session.scene.diagonal
        if moved is not None:
            moved = np.where(np.abs(moved[:3, 3] - place) < _NOISE * diagonal, place, moved[:3, 3])
        if turned is not None:
            turned = turned[:3, :3] / np.linalg.norm(turned[:3, :3], axis=0)
        return _unless_same(moved, place), _unless_same(turned, axes)

    def _middle(self) -> Point:
        """Return the place of a directional light's handles: in the middle of the scene, or, if that is not in the picture, at
        the camera's target."""
        camera, size = self.actions.session.camera, self.actions.session.size
        middle = point_of(self.actions.session.scene.bounds.mean(0))
        at = on_screen(camera, size, middle)
        inside = at is not None and all(0.0 < a < s for a, s in zip(at, size, strict=True))
        return middle if inside else point_of(np.asarray(camera.target, float))


def _unless_same(after: np.ndarray | None, before: np.ndarray) -> np.ndarray | None:
    """Return a finite value that differs by more than float32's noise, else None."""
    known = after is not None and np.isfinite(after).all() and np.abs(after - before).max() > _NOISE
    return after if known else None


def _aimed(edited: LightEdit, axis: np.ndarray) -> LightEdit:
    """Return a light that comes from along an axis, or a spot that looks against it."""
    light = edited.light
    if light.directional:
        return edited.moved(point_of(axis * np.linalg.norm(light.position)))
    assert light.spot_target is not None
    distance = np.linalg.norm(np.subtract(light.spot_target, light.position))
    return edited.aimed(point_of(np.asarray(light.position) - axis * distance))


def _axes_of(light: Light) -> np.ndarray:
    """Return (3, 3) columns at right angles, the last one against a light's direction."""
    if light.spot_target is None and not light.directional:
        return np.eye(3)
    z = np.asarray(light.position, float)
    z = z if light.spot_target is None else z - light.spot_target
    z = z / np.linalg.norm(z)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    axes: np.ndarray = np.stack([x, np.cross(z, x), z], axis=1)
    return axes


def _matrix16(matrix: np.ndarray) -> _gizmo.Matrix16:
    """Return a matrix (4, 4) as ImGuizmo takes it, column by column."""
    taken: _gizmo.Matrix16 = _gizmo.Matrix16(matrix.T.ravel().tolist())
    return taken
