"""Sections of the side panel (lights, objects, the measuring plane, the light of a point, settings), and marks in the picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
from imgui_bundle import imgui, imgui_ctx

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.shown_buffer import Legend
from irrsplat.app.viewer.editing import objects
from irrsplat.app.viewer.input.prompts import OF_RENDERS
from irrsplat.app.viewer.session import overrides
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.light.measuring_plane import scene_height
from irrsplat.app.viewer.ui.layout import AMBER, WHITE, Layout
from irrsplat.app.viewer.ui.legends import draw_scale
from irrsplat.app.viewer.view_options import Point
from irrsplat.core.color import LUMINOUS_EFFICACY, linear_from_srgb, srgb
from irrsplat.core.vectors import vector
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.scene import ray_caster
from irrsplat.settings import PRESETS, SETTINGS, Declaration, SettingValues, preset


def edit_colour(label: str, linear: Sequence[float]) -> tuple[bool, tuple[float, float, float]]:
    """Draw the field of a linear colour, with 0..255 and hex values in sRGB. Return True if the user changed it, and the colour.

    A component above 1 sets the scale: the field shows the colour relative to the largest component.
    """
    scale = max(1.0, *linear)
    shown = srgb(np.asarray(linear, float) / scale).tolist()
    changed, values = imgui.color_edit3(label, shown)
    red, green, blue = (scale * linear_from_srgb(np.clip(values, 0.0, 1.0))).tolist() if changed else linear
    return changed, (red, green, blue)


def edit_tint(layout: Layout, label: str, color: Point, lit: Point) -> Point:
    """Draw the field of an emitted colour relative to its largest component; return the colour after it, as bright as before.

    lit: from Editor.last_lit, the colour to show.
    """
    changed, tint = edit_colour(layout.label(label), tint_of(lit))
    return scaled(tint_of(tint), max(color) or 1.0) if changed and max(tint) > 0.0 else color


def edit_outputs(
    layout: Layout, color: Point, lit: Point, units: Callable[[Point], dict[str, float]], least: float = 0.0
) -> Point:
    """Draw a field for each output of an emitted colour, with the unit as its label; return the colour after them.

    lit: from Editor.last_lit, the colour that is scaled. units: a call that returns the outputs of a colour by unit. least: the
    least scale of the colour.
    """
    tint = tint_of(lit)
    full = units(tint)
    for unit, value in units(color).items():
        form = "%.0f" if value >= 1000.0 else "%.4g"  # avoid powers of ten, which %g prints for large values
        changed, output = imgui.drag_float(layout.label(unit), value, max(_STEP * value, _STEP), 0.0, 0.0, form)
        quantity, radiometric = objects.WORDS[unit]
        imgui.set_item_tooltip(f"{quantity}; {value / LUMINOUS_EFFICACY:.4g} {radiometric}; Ctrl+click: type it")
        if changed and math.isfinite(output) and full[unit]:
            color = scaled(tint, max(output / full[unit], least))
    return color


def tint_of(color: Point) -> Point:
    """Return the colour with a greatest component of 1; white for black."""
    return vector([c / max(color) for c in color]) if max(color) > 0.0 else (1.0, 1.0, 1.0)


def scaled(color: Point, factor: float) -> Point:
    return vector([factor * c for c in color])


_OFF, _SHADE = (0.5, 0.5, 0.5, 1.0), (0.0, 0.0, 0.0, 0.7)  # ring colours: a light that is off, the outline
_CONES = 1.0, 89.0  # degrees: the ends of a spot's angle by the slider; 90 and 180 mean no cone in scene files
_STEP = 0.01  # share of an output or a setting by which a drag of one pixel changes it


def draw_lights(actions: Actions, layout: Layout) -> None:
    editor = actions.editor
    if not editor.scene.lights:
        imgui.text_wrapped("no lights; emissive surfaces and a sky are not in this list")

    def row(i: int) -> None:
        light = editor.scene.lights[i]
        if layout.chosen(f"{objects.light_name(light, i)}  ({light.kind})", i == editor.light, i):
            editor.pick_light(i)

    _draw_list(len(editor.scene.lights), row)
    if editor.light is not None:
        imgui.separator()
        _draw_light(actions, layout, editor.light)


def _draw_light(actions: Actions, layout: Layout, number: int) -> None:
    """Draw the widgets of a light, and apply their changes."""
    before = light = actions.editor.scene.lights[number]
    if light.photometry is not None:
        imgui.text_disabled(Path(light.photometry.path).name)
    lit = actions.editor.last_lit(lambda scene: scene.lights[number].color)
    color = edit_outputs(layout, light.color, lit, lambda color: objects.light_units(replace(before, color=color)))
    light = replace(light, color=edit_tint(layout, "colour", color, lit))
    kelvin = objects.kelvin_of(light.color if any(light.color) else lit)
    changed, kelvin = imgui.slider_float(layout.label("kelvin"), kelvin, objects.COLDEST, objects.HOTTEST, "%.0f K")
    imgui.set_item_tooltip("the nearest black body; a drag sets its colour, as bright as before")
    if changed and math.isfinite(kelvin):
        light = objects.heated(light, round(min(max(kelvin, objects.COLDEST), objects.HOTTEST)))
    if light.has_cone:
        changed, cone = imgui.slider_float(layout.label("cone"), light.spot_cutoff, *_CONES, "%.3g°")
        imgui.set_item_tooltip("the angle between the axis and the edge of the light")
        light = replace(light, spot_cutoff=min(max(cone, _CONES[0]), _CONES[1])) if changed else light
    if light != before:
        actions.editor.set_light(number, light)


def draw_rings(actions: Actions, layout: Layout) -> None:
    """Draw a ring in the picture at each light while the panel of lights is open; fill the selected light's ring."""
    editor = actions.editor
    if not actions.session.options.lights:
        return
    with layout.over_picture() as draw:
        for i, light in enumerate(editor.scene.lights):
            place = None if light.directional else layout.seen(actions.session.camera, light.position)
            if place is None:
                continue
            colour = imgui.get_color_u32(AMBER if any(light.color) else _OFF)
            draw.add_circle(place, 9.0, imgui.get_color_u32(_SHADE), 0, 4.0)
            draw.add_circle(place, 9.0, colour, 0, 2.0)
            if i == editor.light:
                draw.add_circle_filled(place, 5.0, colour)


_DARKEST = 1e-3  # W/(m² sr): the least emission of a surface with an emission texture
_ROWS = 10.5  # rows of a list in sight; half a row shows that there are more


def draw_object(actions: Actions, layout: Layout) -> None:
    editor, number = actions.editor, actions.editor.mesh
    if number is None:
        return
    mesh = editor.scene.meshes[number]
    imgui.text_wrapped(objects.object_name(editor.scene, number))
    imgui.text_disabled(f"{len(mesh.faces)} triangles")
    material = mesh.material
    if mesh.colors is None and not material.unlit:
        changed, albedo = edit_colour(layout.label("reflectance"), material.albedo)
        imgui.set_item_tooltip("diffuse reflectance as an sRGB colour; multiplies the texture where there is one")
        if changed:
            material = replace(material, albedo=albedo)
    emission = material.emission
    textured = material.emission_texture is not None or material.filters
    least = _DARKEST if textured and any(emission) else 0.0  # at 0, a textured emitter would need another way of drawing
    lit = editor.last_lit(lambda scene: scene.meshes[number].material.emission)
    emission = edit_outputs(layout, emission, lit, lambda emission: objects.surface_units(mesh, emission), least)
    material = replace(material, emission=edit_tint(layout, "emission colour", emission, lit) if any(emission) else emission)
    if material != mesh.material:
        editor.set_mesh(number, replace(mesh, material=material))


def draw_outliner(actions: Actions, layout: Layout) -> None:
    """Draw the names of all meshes. A hidden mesh is grey."""
    editor = actions.editor

    def row(i: int) -> None:
        title = objects.object_name(editor.scene, i)
        if editor.scene.meshes[i].is_point:
            imgui.text_disabled(title)
        elif layout.chosen(title, i == editor.mesh, i):
            editor.mesh = i

    _draw_list(len(editor.scene.meshes), row)


def _draw_list(count: int, row: Callable[[int], object]) -> None:
    """Draw the rows of a list in sight, in a part of the panel that scrolls on its own."""
    if imgui.begin_child("list", (0.0, min(max(count, 1), _ROWS) * imgui.get_text_line_height_with_spacing())):
        clipper = imgui.ListClipper()
        clipper.begin(count)
        while clipper.step():
            for number in range(clipper.display_start, clipper.display_end):
                row(number)
    imgui.end_child()


_MOST_VALUES = 81  # about: values drawn over the picture
_NEARER = 0.999  # share of the way from the eye to a point of the plane: the point itself may lie on a surface


def draw_plane(actions: Actions, layout: Layout) -> None:
    session = actions.session
    plane = session.plane
    height = imgui.slider_float(layout.label("height"), plane.height, 0.0, scene_height(session.scene), "%.4g m")[1]
    imgui.set_item_tooltip("above the lowest point of the scene; Ctrl+click: type it")
    if math.isfinite(height):
        plane.height = max(float(f"{height:.4g}"), 0.0)  # imgui's values are float32
    share, measured = plane.share, plane.measured
    imgui.text_disabled("" if share is None else "measuring…" if share == 0.0 else f"measuring: {100.0 * share:.0f} %")
    if measured is None:
        return
    scale = measured.scale
    found, (low, high) = measured.readings.summary(scale.unit), scale.ends
    if found["mean"] is not None:
        imgui.text(f"mean {light_digits(found['mean'])} {scale.shown_unit}, at {measured.height:g} m")
        imgui.text(f"{light_digits(found['minimum'])} … {light_digits(found['maximum'])} {scale.shown_unit}")
        if found["uniformity"] is not None:
            imgui.text(f"uniformity {found['uniformity']:.2f} (least/mean)")
    lines = f"a line every {light_digits((high - low) / STEPS)} {scale.shown_unit}"
    legend = Legend(lines, light_digits(low), light_digits(high), scale.shown_unit, false_colours())
    draw_scale(legend, layout.scale, layout.room)


def draw_values(actions: Actions, layout: Layout) -> None:
    """Draw values over the picture at some visible points of the plane."""
    session = actions.session
    measured = session.plane.measured
    if not session.options.plane or not session.views or measured is None:
        return
    readings = measured.readings
    step = int(np.ceil(np.sqrt(max(measured.rows * measured.columns / _MOST_VALUES, 1.0))))
    numbers = np.arange(measured.rows * measured.columns).reshape(measured.rows, measured.columns)
    some = numbers[step // 2 :: step, step // 2 :: step].ravel()
    some = some[readings.counts[some]]
    points, eye = readings.position[some], np.asarray(session.camera.eye)
    if ray_caster.available():
        seen = session.renderers[0].world.caster.free(np.broadcast_to(eye, points.shape), eye + _NEARER * (points - eye))
        some, points = some[seen], points[seen]
    values = readings.total[some] @ measured.scale.weights
    drawn = list[tuple[float, float]]()
    with layout.over_picture() as draw:
        for point, value in zip(points.tolist(), values.tolist(), strict=True):
            place, text = layout.seen(session.camera, point), light_digits(value)
            size = imgui.calc_text_size(text)
            if place is not None and all(abs(place[0] - x) > size.x or abs(place[1] - y) > size.y for x, y in drawn):
                drawn.append(place)
                left, top = place[0] - 0.5 * size.x, place[1] - 0.5 * size.y
                draw.add_text((left + 1.0, top + 1.0), imgui.get_color_u32(_SHADE), text)
                draw.add_text((left, top), imgui.get_color_u32(WHITE), text)


def draw_why(actions: Actions, display: Display) -> None:
    found, surface = display.point_light(), actions.session.options.surface
    if found is None or surface is None:
        here = ray_caster.available()
        imgui.text_wrapped("click on a surface" if here else f"needs the extra embree: {ray_caster.INSTALL}")
        return
    for source in found.sources:
        lit = f"{light_digits(source.lux)} lux" if not source.reason else source.reason
        imgui.text_wrapped(f"{source.name}: {lit}")
    imgui.text_wrapped(f"sky: {100.0 * found.sky_share:.0f} % of the hemisphere, {light_digits(found.sky_lux)} lux")
    imgui.set_item_tooltip("share weighted by the cosine; transparent surfaces count as opaque")
    total = display.light_at(surface[0])
    if total is None:
        imgui.text_disabled("the point is not in view")
        return
    direct = sum(source.lux for source in found.sources) + found.sky_lux
    imgui.separator()
    imgui.text(f"direct: {light_digits(direct)} lux")
    imgui.text(f"indirect: {light_digits(max(total - direct, 0.0))} lux")
    imgui.set_item_tooltip("reflected by other surfaces: what the picture has there, without direct light")


def light_digits(value: float | None) -> str:
    """Return a value of light with as many digits as a light meter prints; "" for None."""
    return "" if value is None else f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


Value = float | int | bool | str

SLIDERS: dict[str, tuple[float, float]] = {  # the first settings, and the ends of their sliders; the user types other values
    "a": (0.01, 2.0),
    "tolerance": (0.01, 100.0),
    "blend": (0.0, 1.0),
    "exposure": (-10.0, 10.0),
}
_LOGARITHMIC = ("a", "tolerance")
_OPEN = ("splat", "examine", "composite")  # stages that start unfolded
_TOOLTIP = 28.0  # font heights: the width of a tooltip's text


def draw_settings(actions: Actions, layout: Layout) -> None:
    """Draw all settings of the side that panels change, stage by stage."""
    sought = actions.session.options.sought
    for stage in dict.fromkeys(d.stage for d in SETTINGS.values()):
        if sought and SETTINGS[sought].stage == stage:
            imgui.set_next_item_open(True)
        if imgui.collapsing_header(stage, imgui.TreeNodeFlags_.default_open if stage in _OPEN else 0):
            for declaration in SETTINGS.values():
                if declaration.stage == stage and declaration.name not in OF_RENDERS:
                    draw_setting(actions, layout, declaration)


def draw_presets(actions: Actions, layout: Layout) -> None:
    options = actions.session.options
    renderer = actions.session.chosen
    chosen, differs = renderer.preset, bool(overrides(renderer.preset, renderer.settings))
    name = f"preset {('left', 'right')[options.side]}" if options.split else "preset"
    if imgui.begin_combo(layout.label(name), f"{chosen}{' *' if differs else ''}"):
        for name in PRESETS:
            if imgui.selectable(name, name == chosen)[0]:
                actions.attempt(partial(actions.session.use_preset, name))
        imgui.end_combo()
    imgui.set_item_tooltip("all settings at once (*: some differ); paper: the algorithm as published")


def draw_setting(actions: Actions, layout: Layout, d: Declaration) -> None:
    """Draw the line of a setting: its widget, its name, and an arrow back to its word (such as auto) or the preset's value."""
    renderer = actions.session.chosen
    value, base = getattr(renderer.settings, d.name), getattr(preset(renderer.preset), d.name)
    with imgui_ctx.push_id(d.name):
        if d.name == actions.session.options.sought:
            imgui.set_scroll_here_y()
            actions.session.options.sought = ""
        with imgui_ctx.begin_group():
            new = _widget(actions, layout, d, value)
        if imgui.begin_item_tooltip():
            with imgui_ctx.push_text_wrap_pos(_TOOLTIP * imgui.get_font_size()):
                imgui.text_wrapped(d.help)
                imgui.text_disabled(f"{d.flag}  {d.range}; in preset {renderer.preset}: {_in_words(base)}")
                if d.kind in ("int", "float"):
                    imgui.text_disabled("Ctrl+click: type a number")
            imgui.end_tooltip()
        back = d.word if d.word and value != d.word else base
        if value != back:
            imgui.same_line()
            if imgui.small_button("←"):
                new = back
            imgui.set_item_tooltip(f"back to {_in_words(back)}")
    if new != value:
        changed = cast(SettingValues, {d.name: new})
        actions.attempt(lambda: actions.session.change(actions.session.options.side, **changed))


def _widget(actions: Actions, layout: Layout, d: Declaration, value: Value) -> Value:
    """Draw the widget of a setting; return its value afterwards. Numbers in SLIDERS have a slider, others a field to drag."""
    label = layout.label(d.name.replace("_", " "))
    if d.kind == "bool":
        return imgui.checkbox(label, bool(value))[1]
    style = imgui.get_style()
    imgui.set_next_item_width(layout.widget - imgui.calc_text_size("←").x - 2.0 * style.frame_padding.x - style.item_spacing.x)
    if d.kind == "choice":
        return d.choices[imgui.combo(label, d.choices.index(str(value)), list(d.choices))[1]]
    number = _resolved(actions, d) if value == d.word else cast(float, value)
    least, most = d.low or 0, d.high or 0
    unit = f" ({d.word})" if value == d.word else f" {d.unit}".replace("%", "%%") if d.unit and not d.word else ""
    if d.name in SLIDERS:
        flags = imgui.SliderFlags_.logarithmic if d.name in _LOGARITHMIC else 0
        form = f"%.3g{unit}" if math.isfinite(number) else d.word  # auto exposure has no number before the first picture
        moved, now = imgui.slider_float(label, number, *SLIDERS[d.name], form, flags)
    elif d.kind == "int":
        moved, now = imgui.drag_int(label, int(number), max(_STEP * abs(number), 0.1), int(least), int(most), f"%d{unit}")
    else:
        moved, now = imgui.drag_float(label, number, max(_STEP * abs(number), 0.001), least, most, f"%.3g{unit}")
    now = float(f"{now:.6g}") if d.kind == "float" else now  # imgui's values are float32
    return min(max(now, least), most) if moved else value


def _resolved(actions: Actions, d: Declaration) -> float:
    """Return the number that the word of a setting (such as auto) means now."""
    renderer = actions.session.chosen
    if d.name == "bounces":
        return int(str(renderer.scheduler.gatherer.bounces(renderer.settings)["bounces"]))
    return renderer.settings.threshold if d.name == "tolerance" else actions.session.auto_exposure.stops


def _in_words(value: Value) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
