"""The handles in the picture by which the picked object or light is moved and turned: ImGuizmo's."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
from imgui_bundle import imgui, imguizmo

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.light_edit import LightEdit, Vector
from irrsplat.app.viewer.editing.picking import on_screen
from irrsplat.app.viewer.editing.scene_edit import angles, middle, rotation
from irrsplat.app.viewer.ui.layout import AMBER, Layout
from irrsplat.scene.model import Light

_gizmo = imguizmo.im_guizmo
_NEAR, _FAR = 1e-2, 1e4  # metres
_SIZE = 0.16  # of the handles, share of the picture
_ARROW = 0.25  # length of a directional light's, share of the distance to its handles
_NOISE = 1e-6  # of the scene's diagonal


class Handles:
    """Draws them over the picture, below all windows, and moves by them what is picked."""

    def __init__(self, actions: Actions, layout: Layout) -> None:
        self.actions, self.layout = actions, layout

    def draw(self) -> None:
        """Draw them where something is picked; a drag changes the edit as it goes."""
        editor = self.actions.editor
        matrix = self._matrix()
        if matrix is None or not self.actions.session.views:
            editor.handles_used = editor.dragging = False
            return
        turning = editor.turning if editor.mesh is not None else self._sun is not None
        camera, (width, height) = self.actions.session.camera, self.layout.picture_size
        _gizmo.begin_frame()
        _gizmo.set_drawlist(imgui.get_background_draw_list())
        _gizmo.set_orthographic(False)
        _gizmo.allow_axis_flip(False)
        _gizmo.set_gizmo_size_clip_space(_SIZE)
        _gizmo.set_rect(*self.layout.picture[:2], width, height)
        placed = _matrix16(matrix)
        if (sun := self._sun) is not None:
            self._draw_arrow(sun.light)
        changed = _gizmo.manipulate(
            _matrix16(camera.view_from_world),
            _matrix16(camera.clip_from_view(width / max(height, 1.0), _NEAR, _FAR)),
            _gizmo.OPERATION.rotate if turning else _gizmo.OPERATION.translate,
            _gizmo.MODE.world,
            placed,
        )
        editor.dragging = _gizmo.is_using()
        editor.handles_used = editor.dragging or _gizmo.is_over()
        if changed and editor.dragging:
            self._place(np.asarray(placed.values, float).reshape(4, 4).T, turning)

    def _matrix(self) -> np.ndarray | None:
        """(4, 4) where the handles are, and how they are turned; None for nowhere."""
        editor, matrix = self.actions.editor, np.eye(4)
        if self.actions.session.options.inspect:  # then a click is for records
            return None
        if editor.mesh is not None:
            edit = editor.object(editor.mesh)
            matrix[:3, :3] = rotation(edit.turn)
            matrix[:3, 3] = middle(editor.loaded.meshes[editor.mesh]) + edit.offset
            return matrix
        if editor.light is None or not self.actions.panels.lights:
            return None
        light = editor.lights[editor.light].light
        if light.directional:
            matrix[:3, :3], matrix[:3, 3] = _axes_of(light.position), self._middle()
            return matrix
        matrix[:3, 3] = light.spot_target if editor.aiming and light.spot_target is not None else light.position
        return matrix

    @property
    def _sun(self) -> LightEdit | None:
        """The directional light that is picked, and no object; None for none."""
        editor = self.actions.editor
        edited = None if editor.light is None or editor.mesh is not None else editor.lights[editor.light]
        return edited if edited is not None and edited.light.directional else None

    def _middle(self) -> Vector:
        """Where the handles of a light without a place are: in the middle of the scene, or, where that is not in the picture, at
        what the camera looks at."""
        camera, size = self.actions.session.camera, self.actions.session.size
        middle = _vector(self.actions.session.scene.bounds.mean(0))
        at = on_screen(camera, size, middle)
        inside = at is not None and all(0.0 < a < s for a, s in zip(at, size, strict=True))
        return middle if inside else _vector(np.asarray(camera.target, float))

    def _draw_arrow(self, light: Light) -> None:
        """Draw an arrow from where a directional light comes to its handles."""
        session, end = self.actions.session, np.asarray(self._middle())
        depth = float(session.camera.axes[2] @ (np.asarray(session.camera.eye) - end))
        towards = np.asarray(light.position) / np.linalg.norm(light.position)
        tip, start = (self.layout.seen(session.camera, _vector(p)) for p in (end, end + _ARROW * depth * towards))
        if tip is None or start is None:
            return
        draw = imgui.get_background_draw_list()
        for colour, width in (((0.0, 0.0, 0.0, 0.7), 4.0), (AMBER, 2.0)):
            draw.add_line(start, tip, imgui.get_color_u32(colour), width)
            draw.add_circle_filled(start, 3.0 + width, imgui.get_color_u32(colour))

    def _place(self, matrix: np.ndarray, turning: bool) -> None:
        """Put what is picked where the handles are now."""
        actions, editor = self.actions, self.actions.editor
        place = matrix[:3, 3]
        if not np.isfinite(matrix).all():
            return
        if editor.mesh is not None:
            number, edit = editor.mesh, editor.object(editor.mesh)
            if turning:
                edit = replace(edit, turn=angles(matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)))
            else:
                offset = place - middle(editor.loaded.meshes[number])
                edit = replace(edit, offset=_vector(self._without_noise(offset, edit.offset)))
            actions.attempt(lambda: editor.set_object(number, edit))
        elif editor.light is not None:
            light_number, edited = editor.light, editor.lights[editor.light]
            if edited.light.directional:
                turned = _turned(edited, matrix[:3, 2])
                actions.attempt(lambda: editor.set_light(light_number, turned))
                return
            aims = editor.aiming and edited.light.spot_target is not None
            if edited.light.spot_target is not None and np.allclose(
                place, edited.light.position if aims else edited.light.spot_target
            ):
                return  # a spot does not look at its own place
            was = edited.light.spot_target if aims and edited.light.spot_target is not None else edited.light.position
            there = _vector(self._without_noise(place, was))
            edited = edited.aimed(there) if aims else edited.moved(there)
            actions.attempt(lambda: editor.set_light(light_number, edited))

    def _without_noise(self, place: np.ndarray, before: Vector) -> np.ndarray:
        """A place in which coordinates that differ from those before by no more than ImGuizmo's float32 are as before."""
        least = _NOISE * self.actions.session.scene.diagonal
        return np.where(np.abs(place - before) < least, before, place)


def choose_handles(other: str, chosen: bool) -> bool:
    """Draw the choice of the handles: move, or the `other`. Return True if the other is chosen."""
    for what, value in (("move", False), (other, True)):
        if imgui.radio_button(what, chosen == value):
            chosen = value
        if not value:
            imgui.same_line()
    imgui.set_item_tooltip("what the handles in the picture do; O switches")
    return chosen


def _turned(edited: LightEdit, towards: np.ndarray) -> LightEdit:
    """A directional light that comes from another direction; the same where that is another one by float32's noise alone."""
    before = np.asarray(edited.light.position)
    towards = towards / np.linalg.norm(towards) * np.linalg.norm(before)
    return edited if np.abs(towards - before).max() < _NOISE * np.linalg.norm(before) else edited.moved(_vector(towards))


def _axes_of(towards: Vector) -> np.ndarray:
    """(3, 3) columns at right angles, the last one of which is a direction."""
    z = np.asarray(towards, float) / np.linalg.norm(towards)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    axes: np.ndarray = np.stack([x, np.cross(z, x), z], axis=1)
    return axes


def _matrix16(matrix: np.ndarray) -> _gizmo.Matrix16:
    """A matrix (4, 4) as ImGuizmo takes it, column by column."""
    taken: _gizmo.Matrix16 = _gizmo.Matrix16(matrix.T.ravel().tolist())
    return taken


def _vector(values: np.ndarray) -> Vector:
    return cast(Vector, tuple(values.tolist()))
