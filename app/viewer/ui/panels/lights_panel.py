"""The panel of the scene's lights: pick one, move it, dim it, add and delete; and where they are in the picture."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.editor import KINDS
from irrsplat.app.viewer.editing.light_edit import COLDEST, HOTTEST, LightEdit, light_name
from irrsplat.app.viewer.editing.photometry import light_units
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.ui.layout import AMBER, Layout
from irrsplat.app.viewer.ui.panels.fields import edit_colour, edit_output
from irrsplat.app.viewer.view_options import Point

_OFF, _SHADE = (0.5, 0.5, 0.5, 1.0), (0.0, 0.0, 0.0, 0.7)  # colours of a light that is off, and around each
_WHITE = 6500.0  # kelvin where the slider stands for a colour of its own
_DIMMEST = 2.0**-8  # of its full output that a slider dims a light to
_WIDEST, _NARROWEST = 89.0, 1.0  # degrees: half angles of cones


def draw_lights(actions: Actions, layout: Layout) -> None:
    editor = actions.editor
    if not editor.lights:
        imgui.text_wrapped("no lights: emissive surfaces and the sky light the scene")
    for i, edited in enumerate(editor.lights):
        if imgui.selectable(f"{light_name(edited.light, i)}  ({edited.light.kind})##{i}", i == editor.light)[0]:
            editor.pick_light(i)
    if imgui.begin_combo(layout.label("new light"), "add"):
        for kind in KINDS:
            if imgui.selectable(kind, False)[0]:
                actions.attempt(lambda kind=kind: actions.add_light(kind))  # type: ignore[misc]
        imgui.end_combo()
    imgui.set_item_tooltip("where the camera looks")
    if editor.light is not None:
        imgui.separator()
        _draw_light(actions, layout, editor.light)


def _draw_light(actions: Actions, layout: Layout, number: int) -> None:
    """Draw the widgets of a light, and apply their changes."""
    editor = actions.editor
    before = editor.lights[number]
    if before.light.photometry is not None:
        imgui.text_disabled(Path(before.light.photometry.path).name)
    changed, on = imgui.checkbox("on", before.on)
    edited = replace(before, on=on) if changed else before
    for unit, full in light_units(edited.light).items():
        output = edit_output(layout, unit, full * 2.0**edited.stops, full * _DIMMEST, full / _DIMMEST)
        edited = replace(edited, stops=math.log2(output / full)) if output and full else edited
    edited = _coloured(layout, _placed(actions, layout, edited))
    if imgui.button("reset"):
        edited = LightEdit.of(edited.loaded)
    imgui.same_line()
    if imgui.button("delete"):
        actions.attempt(lambda: editor.delete_light(number))
    elif edited != before:
        actions.attempt(lambda: editor.set_light(number, edited))


def _placed(actions: Actions, layout: Layout, edited: LightEdit) -> LightEdit:
    """Return the light after the widgets of place, aim and cone."""
    session, light = actions.session, edited.light
    step = session.scene.diagonal / 500.0 if not light.directional else 0.01
    label = "towards" if light.directional else "position"
    moved, place = _dragged(session, layout, label, light.position, step, light.directional)
    if moved and (any(place) or not light.directional) and place != light.spot_target:
        edited = edited.moved(place)
    if light.spot_target is None:
        return edited
    moved, aim = _dragged(session, layout, "aims at", light.spot_target, step)
    if moved and aim != tuple(edited.light.position):
        edited = edited.aimed(aim)
    if not light.has_cone:
        return edited
    cutoff, inner = light.spot_cutoff, light.spot_inner
    wider, cutoff = imgui.slider_float(layout.label("cone"), cutoff, _NARROWEST, max(_WIDEST, cutoff), "%.1f°")
    imgui.set_item_tooltip("half angle of the cone, where the light ends")
    softer, inner = imgui.slider_float(layout.label("inner cone"), inner, 0.0, cutoff, "%.1f°")
    imgui.set_item_tooltip("half angle of full intensity")
    return edited.coned(cutoff, inner) if wider or softer else edited


def _dragged(
    session: Session, layout: Layout, label: str, place: Point, step: float, direction: bool = False
) -> tuple[bool, Point]:
    """Draw the widget of a place or a direction. Return True if it has changed, and its present value.

    Far from 0 0 0, where a widget's float32 is too coarse, a place is relative to the scene's origin, and world space stands
    below it.
    """
    moved, (x, y, z) = imgui.drag_float3(layout.label(label), list(place), step, 0, 0, layout.metres)
    if any(session.origin) and not direction:
        imgui.text_disabled("in the file: " + " ".join(f"{v:.3f}" for v in np.add((x, y, z), session.origin)))
    return moved, (x, y, z)


def _coloured(layout: Layout, edited: LightEdit) -> LightEdit:
    """Return the light after the widgets of its colour."""
    brightest = max(*edited.loaded.color, 1e-30)  # as loaded, so that black is no dead end
    changed, tint = edit_colour(layout.label("colour"), [c / brightest for c in edited.light.color])
    if changed:
        edited = edited.coloured((tint[0] * brightest, tint[1] * brightest, tint[2] * brightest))
    text = "%.0f K" if edited.kelvin is not None else "own colour"
    changed, kelvin = imgui.slider_float(layout.label("kelvin"), edited.kelvin or _WHITE, COLDEST, HOTTEST, text)
    imgui.set_item_tooltip("the colour of a black body of that temperature, as bright as before")
    return edited.heated(round(min(max(kelvin, COLDEST), HOTTEST))) if changed and any(edited.light.color) else edited


def draw_rings(actions: Actions, layout: Layout) -> None:
    """Draw a ring in the picture where each light is, while the panel is open; that of the selected light is filled."""
    editor = actions.editor
    if not actions.panels.lights:
        return
    with layout.over_picture() as draw:
        for i, edited in enumerate(editor.lights):
            place = None if edited.light.directional else layout.seen(actions.session.camera, edited.light.position)
            if place is None:
                continue
            colour = imgui.get_color_u32(AMBER if edited.on else _OFF)
            draw.add_circle(place, 9.0, imgui.get_color_u32(_SHADE), 0, 4.0)
            draw.add_circle(place, 9.0, colour, 0, 2.0)
            if i == editor.light:
                draw.add_circle_filled(place, 5.0, colour)
