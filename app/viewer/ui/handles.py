"""The handles in the picture that move the picked object, or move and aim the picked light. ImGuizmo draws them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from math import dist

import numpy as np
from imgui_bundle import imgui, imguizmo

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.objects import bounds_of, pixel_of
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.ui.layout import Layout, line
from irrsplat.app.viewer.view_options import Point
from irrsplat.core.vectors import unit, vector
from irrsplat.scene.model import Light, Mesh
from irrsplat.scene.motion import transformed

_gizmo = imguizmo.im_guizmo
_NEAR, _FAR = 1e-3, 1e3  # scene diagonals: the clip planes of the handles' projection
_SIZE = 0.16  # share of the picture: the size of the handles
_SUN = 0.2  # share of the distance from the eye: the length of the axis of a directional light
_LABELLED = 0.1, 1e4  # metres: the diagonals of scenes whose handles have metres as their unit, which labels of drags show
_NOISE = 1e-6  # scene diagonals: rounding of ImGuizmo's float32


def draw_handles(actions: Actions, layout: Layout) -> None:
    """Draw handles over the picture at the selection. A drag changes the edit continuously."""
    editor, session = actions.editor, actions.session
    if not session.views or session.options.inspect:  # a click inspects a record in that mode
        return
    _gizmo.begin_frame()
    if editor.mesh is not None:
        number, mesh = editor.mesh, editor.scene.meshes[editor.mesh]
        _draw_box(session, layout, mesh)
        origin = bounds_of(mesh).mean(0)
        if (place := _dragged(actions, layout, 0, origin)) is not None:
            way = np.eye(4)
            way[:3, 3] = place - origin
            actions.attempt(lambda: editor.set_mesh(number, transformed(mesh, way)))
    elif editor.light is not None and actions.session.options.lights:
        chosen, light = editor.light, editor.scene.lights[editor.light]
        for i, (point, move) in enumerate(_points(session, light)):
            if (place := _dragged(actions, layout, i, np.asarray(point))) is not None:
                actions.attempt(lambda place=place, move=move: editor.set_light(chosen, move(vector(place))))  # type: ignore[misc]
        if axis := _axis(session, light):
            with layout.over_picture() as draw:
                line(draw, layout.seen(session.camera, axis[0]), layout.seen(session.camera, axis[1]))


def _points(session: Session, light: Light) -> list[tuple[Point, Callable[[Point], Light]]]:
    """Return the places of a light's handles, and the light after a move of each one.

    The first one moves a light with its direction. A spot has a second one, which aims it.
    """
    axis = _axis(session, light)
    if light.directional and axis is not None:
        length = np.linalg.norm(light.position)
        return [(axis[1], lambda place: replace(light, position=vector(length * unit(np.subtract(place, axis[0])[None])[0])))]
    moves: list[tuple[Point, Callable[[Point], Light]]] = [
        (light.position, lambda place: light.shifted(np.subtract(place, light.position)))
    ]
    return moves if axis is None else [*moves, (axis[1], lambda place: replace(light, spot_target=place))]


def _axis(session: Session, light: Light) -> tuple[Point, Point] | None:
    """Return the ends of the axis of a spot, or of a directional light; None for any other light.

    The latter begins in the middle of the scene, or at the camera's target if the middle is out of view.
    """
    if not light.directional:
        return None if light.spot_target is None else (light.position, light.spot_target)
    camera, middle = session.camera, vector(session.scene.bounds.mean(0))
    if pixel_of(camera, session.size, middle) is None:
        middle = vector(np.asarray(camera.target, float))
    away = _SUN * dist(camera.eye, middle) * unit(np.asarray(light.position, float)[None])[0]
    return middle, vector(middle + away)


def _draw_box(session: Session, layout: Layout, mesh: Mesh) -> None:
    """Draw the edges of the picked object's bounding box, a bright line on a dark one."""
    ends = bounds_of(mesh)
    corners = [layout.seen(session.camera, vector(ends[bits, range(3)])) for bits in product((0, 1), repeat=3)]
    with layout.over_picture() as draw:
        for i, axis in product(range(8), (1, 2, 4)):
            if not i & axis:
                line(draw, corners[i], corners[i | axis], 1.5 * layout.scale)


def _dragged(actions: Actions, layout: Layout, number: int, place: np.ndarray) -> np.ndarray | None:
    """Draw handle `number` at a place (3,). Return the place (3,) after a drag; None for no motion."""
    editor, camera, (width, height) = actions.editor, actions.session.camera, layout.picture_size
    _gizmo.set_drawlist(imgui.get_background_draw_list())
    _gizmo.set_orthographic(False)
    _gizmo.allow_axis_flip(False)
    _gizmo.set_gizmo_size_clip_space(_SIZE)
    _gizmo.set_rect(*layout.picture[:2], width, height)
    diagonal = editor.loaded.diagonal
    metres = 1.0 if _LABELLED[0] <= diagonal <= _LABELLED[1] else diagonal  # ImGuizmo hides handles within 0.001 of the eye
    view_from_world, matrix = camera.view_from_world.copy(), np.eye(4)
    view_from_world[:3, 3] /= metres
    views = (
        _matrix16(view_from_world),
        _matrix16(camera.clip_from_view(width / max(height, 1.0), _NEAR * diagonal / metres, _FAR * diagonal / metres)),
    )
    matrix[:3, 3] = place / metres
    placed = _matrix16(matrix)
    _gizmo.push_id(number)
    changed = _gizmo.manipulate(*views, _gizmo.OPERATION.translate, _gizmo.MODE.world, placed) and _gizmo.is_using()
    editor.dragging |= _gizmo.is_using()
    editor.handles_used |= _gizmo.is_using() or _gizmo.is_over(_gizmo.OPERATION.translate)
    _gizmo.pop_id()
    after = np.asarray(placed.values, float)[12:15] * metres
    if not changed or not np.isfinite(after).all():
        return None
    after = np.where(np.abs(after - place) < _NOISE * diagonal, place, after)
    return None if np.array_equal(after, place) else after


def _matrix16(matrix: np.ndarray) -> _gizmo.Matrix16:
    """Return a matrix (4, 4) in ImGuizmo's layout, column by column."""
    return _gizmo.Matrix16(matrix.T.ravel().tolist())
