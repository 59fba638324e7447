"""The question about unsaved changes, before the window closes or another scene opens."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import DIALOG


def draw_unsaved(actions: Actions) -> None:
    """Draw the question while an action waits for its answer; the save dialog takes its place."""
    if actions.pending is None or actions.panels.save:
        return
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
    flags = imgui.WindowFlags_.always_auto_resize | DIALOG | imgui.WindowFlags_.no_saved_settings
    shown, opened = imgui.begin("unsaved changes", True, flags)
    if shown:
        imgui.text_unformatted(f"{actions.session.scene.name} has changes that no file has.")
        if imgui.button("save…"):
            actions.save_dialog()
        imgui.same_line()
        if imgui.button("discard"):
            actions.discard()
        imgui.same_line()
        if imgui.button("cancel"):
            actions.pending = None
    imgui.end()
    if not opened:
        actions.pending = None
