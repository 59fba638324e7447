"""Sections of the side panel that edit the scene: lights, the selected object, and the list of objects.

The rings that mark lights in the picture are drawn here, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.light_edit import COLDEST, HOTTEST, LightEdit, described, light_name, light_units, surface_units
from irrsplat.app.viewer.editing.scene_edit import AS_LOADED, ObjectEdit, object_name
from irrsplat.app.viewer.ui.layout import AMBER, Layout
from irrsplat.app.viewer.view_options import point_of
from irrsplat.core.color import linear_from_srgb, srgb
from irrsplat.scene.model import Mesh


def edit_colour(label: str, linear: Sequence[float]) -> tuple[bool, tuple[float, float, float]]:
    """Draw the field of a linear colour, with 0..255 and hex values in sRGB. Return True if the user changed it, and the colour.

    A component above 1 sets the scale: the field shows the colour relative to the largest component.
    """
    scale = max(1.0, *linear)
    shown = srgb(np.asarray(linear, float) / scale).tolist()
    changed, values = imgui.color_edit3(label, shown)
    red, green, blue = (scale * linear_from_srgb(np.clip(values, 0.0, 1.0))).tolist() if changed else linear
    return changed, (red, green, blue)


def edit_output(layout: Layout, unit: str, value: float, least: float, most: float) -> float | None:
    """Draw a logarithmic slider with the unit as its label; return the new value if the user changed it to one of 0 or more."""
    form = "%.0f" if value >= 1000.0 else "%.4g"  # avoid powers of ten, which %g prints for large values
    changed, output = imgui.slider_float(layout.label(unit), value, least, most, form, imgui.SliderFlags_.logarithmic)
    imgui.set_item_tooltip(described(unit, value))
    return output if changed and output >= 0.0 else None


_OFF, _SHADE = (0.5, 0.5, 0.5, 1.0), (0.0, 0.0, 0.0, 0.7)  # ring colours: a light that is off, the outline
_WHITE = 6500.0  # kelvin: the slider's position for a light with a colour of its own
_DIMMEST = 2.0**-8  # the least share of its full output that a slider gives a light; the greatest share is the inverse


def draw_lights(actions: Actions, layout: Layout) -> None:
    editor = actions.editor
    if not editor.lights:
        imgui.text_wrapped("no lights: emissive surfaces and the sky light the scene")
    for i, edited in enumerate(editor.lights):
        if layout.chosen(f"{light_name(edited.light, i)}  ({edited.light.kind})", i == editor.light, i):
            editor.pick_light(i)
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
        if output is not None and full:
            edited = replace(edited, stops=math.log2(output / full)) if output else replace(edited, on=False)
    edited = _coloured(layout, edited)
    if imgui.button("reset"):
        edited = LightEdit.of(edited.loaded)
    if edited != before:
        actions.attempt(lambda: editor.set_light(number, edited))


def _coloured(layout: Layout, edited: LightEdit) -> LightEdit:
    """Draw the widgets of a light's colour; return the light after them."""
    brightest = max(*edited.loaded.color, 1e-30)  # of the loaded colour, so that a light set to black can get a colour again
    changed, tint = edit_colour(layout.label("colour"), [c / brightest for c in edited.light.color])
    if changed:
        edited = edited.coloured((tint[0] * brightest, tint[1] * brightest, tint[2] * brightest))
    text = "%.0f K" if edited.kelvin is not None else "own colour"
    changed, kelvin = imgui.slider_float(layout.label("kelvin"), edited.kelvin or _WHITE, COLDEST, HOTTEST, text)
    imgui.set_item_tooltip("the colour of a black body of that temperature, as bright as before")
    return edited.heated(round(min(max(kelvin, COLDEST), HOTTEST))) if changed and any(edited.light.color) else edited


def draw_rings(actions: Actions, layout: Layout) -> None:
    """Draw a ring in the picture at each light while the panel of lights is open; fill the selected light's ring."""
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


_DARKEST = 1e-3  # W/(m² sr): the least emission of a surface with an emission texture
_ROWS = 10  # rows of the list in sight; the user scrolls to further rows
_BRIGHTEST = 1000.0  # W/(m² sr) of the strongest channel: the upper end of the sliders


def draw_object(actions: Actions, layout: Layout) -> None:
    editor, number = actions.editor, actions.editor.mesh
    if number is None:
        return
    mesh, edit = editor.loaded.meshes[number], editor.edit.objects[number]
    imgui.text_wrapped(object_name(editor.loaded, number))
    imgui.text_disabled(f"{len(mesh.faces)} triangles")
    after = _object_painted(edit, mesh, layout)
    if imgui.button("reset"):
        after = AS_LOADED
    if after != edit:
        actions.attempt(lambda: editor.set_object(number, after))


def _object_painted(edit: ObjectEdit, mesh: Mesh, layout: Layout) -> ObjectEdit:
    """Draw the widgets of an object's material; return the edit after them."""
    material = mesh.material
    if mesh.colors is None and not material.unlit:
        changed, albedo = edit_colour(layout.label("reflectance"), edit.albedo or material.albedo)
        imgui.set_item_tooltip("diffuse reflectance as an sRGB colour; multiplies the texture where there is one")
        if changed:
            edit = replace(edit, albedo=albedo)
    emission = edit.emission if edit.emission is not None else material.emission
    textured = material.emission_texture is not None or material.filters
    least = _DARKEST if textured and any(material.emission) else 0.0  # at 0, a textured emitter would need another way of drawing
    brightest = max(emission)
    tint = point_of([c / brightest for c in emission] if brightest > 0.0 else [1.0, 1.0, 1.0])
    full, now = surface_units(mesh, tint), surface_units(mesh, emission)
    for unit, one in full.items():
        output = edit_output(layout, unit, now[unit], least * one, _BRIGHTEST * one)
        if output is not None and one:
            edit = replace(edit, emission=point_of([c * max(output / one, least) for c in tint]))
    if brightest > 0.0:
        changed, tint = edit_colour(layout.label("emission colour"), tint)
        if changed and max(tint) > 0.0:
            edit = replace(edit, emission=point_of([c * brightest for c in tint]))
    return edit


def draw_outliner(actions: Actions, layout: Layout) -> None:
    """Draw the names of all meshes. A hidden mesh is grey, and has a button that shows it again."""
    editor = actions.editor
    count = len(editor.edit.objects)
    height = (min(count, _ROWS) + 1) * imgui.get_text_line_height_with_spacing()
    if imgui.begin_child("objects", (0.0, height)):
        clipper = imgui.ListClipper()
        clipper.begin(count)
        while clipper.step():
            for number in range(clipper.display_start, clipper.display_end):
                title = object_name(editor.loaded, number)
                if editor.edit.objects[number].hidden:
                    if imgui.small_button(f"show##{number}"):
                        actions.attempt(lambda number=number: editor.hide(number, False))  # type: ignore[misc]
                    imgui.same_line()
                    imgui.text_disabled(title)
                elif layout.chosen(title, number == editor.mesh, number):
                    editor.mesh = number
    imgui.end_child()
