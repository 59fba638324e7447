"""The list of objects: a click selects one."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions

_ROWS = 10  # that are in sight; more are scrolled to


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
                title = f"{editor.name(number)}##{number}"
                if editor.object(number).hidden:
                    if imgui.small_button(f"show##{number}"):
                        actions.show_hidden(number)
                    imgui.same_line()
                    imgui.text_disabled(title.split("##")[0])
                elif imgui.selectable(title, number == editor.mesh)[0]:
                    editor.pick_mesh(number)
    imgui.end_child()
