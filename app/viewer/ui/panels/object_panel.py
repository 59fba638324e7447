"""The panel of the picked object: place, reflectance and emission, as numbers; and the list of objects."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.photometry import surface_units
from irrsplat.app.viewer.editing.scene_edit import AS_LOADED, ObjectEdit, object_name
from irrsplat.app.viewer.ui.layout import Layout
from irrsplat.app.viewer.ui.panels.fields import edit_colour, edit_output
from irrsplat.app.viewer.view_options import point_of
from irrsplat.scene.model import Material, Mesh

_DARKEST = 1e-3  # W/(m² sr): the least emission where none would be drawn otherwise
_ROWS = 10  # of the list that are in sight; more are scrolled to
_BRIGHTEST = 1000.0  # W/(m² sr) of the strongest channel that the sliders go to


def draw_object(actions: Actions, layout: Layout) -> None:
    editor, number = actions.editor, actions.editor.mesh
    if number is None:
        return
    mesh, edit = editor.loaded.meshes[number], editor.edit.objects[number]
    imgui.text_wrapped(object_name(editor.loaded, number))
    imgui.text_disabled(f"{len(mesh.faces)} triangles, {describe_material(mesh)}")
    after = _painted(_placed(edit, layout, actions.session.scene.diagonal / 500.0), mesh, layout)
    if imgui.button("reset"):
        after = AS_LOADED
    if after != edit:
        actions.attempt(lambda: editor.set_object(number, after))


def _placed(edit: ObjectEdit, layout: Layout, step: float) -> ObjectEdit:
    """Return the edit after the widgets of its place. step: metres for a pixel of a drag."""
    moved, offset = imgui.drag_float3(layout.label("translation"), list(edit.offset), step, 0, 0, layout.metres)
    imgui.set_item_tooltip("metres from its place in the file")
    if moved:
        edit = replace(edit, offset=point_of(offset))
    turned, turn = imgui.drag_float3(layout.label("rotation"), list(edit.turn), 0.5, 0, 0, "%.1f")
    imgui.set_item_tooltip("degrees about x, then y, then z, through its middle")
    return replace(edit, turn=point_of(turn)) if turned else edit


def _painted(edit: ObjectEdit, mesh: Mesh, layout: Layout) -> ObjectEdit:
    """Return the edit after the widgets of its material."""
    material = mesh.material
    if mesh.colors is None and not material.unlit:
        changed, albedo = edit_colour(layout.label("reflectance"), edit.albedo or material.albedo)
        imgui.set_item_tooltip("diffuse reflectance as an sRGB colour; multiplies the texture where there is one")
        if changed:
            edit = replace(edit, albedo=albedo)
    emission = edit.emission if edit.emission is not None else material.emission
    least = _DARKEST if needs_emission(material) else 0.0
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


def draw_outliner(actions: Actions) -> None:
    """Draw the names of all meshes; hidden ones are grey, and have a button that shows them again."""
    editor = actions.editor
    count = len(editor.edit.objects)
    height = (min(count, _ROWS) + 1) * imgui.get_text_line_height_with_spacing()
    if imgui.begin_child("objects", (0.0, height)):
        clipper = imgui.ListClipper()
        clipper.begin(count)
        while clipper.step():
            for number in range(clipper.display_start, clipper.display_end):
                title = f"{object_name(editor.loaded, number)}##{number}"
                if editor.edit.objects[number].hidden:
                    if imgui.small_button(f"show##{number}"):
                        actions.attempt(lambda number=number: editor.hide(number, False))  # type: ignore[misc]
                    imgui.same_line()
                    imgui.text_disabled(title.split("##")[0])
                elif imgui.selectable(title, number == editor.mesh)[0]:
                    editor.mesh = number
    imgui.end_child()


def needs_emission(material: Material) -> bool:
    """True if the material must keep some emission: it has a texture of emission, or it filters light and emits."""
    return any(material.emission) and (material.emission_texture is not None or material.filters)


def describe_material(mesh: Mesh) -> str:
    """A mesh's material in a few words."""
    material = mesh.material
    words = ["unlit"] if material.unlit else []
    words += ["emissive"] if any(material.emission) else []
    words += ["texture"] if material.albedo_texture is not None else []
    words += ["normal map"] if material.normal_texture is not None else []
    words += ["vertex colours"] if mesh.colors is not None else []
    words += ["transparent"] if material.filters else ["alpha mask"] if material.alpha_mode == "mask" else []
    return ", ".join(words) or "plain"
