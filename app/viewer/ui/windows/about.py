"""What this is: version and OpenGL, and where more is written."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.common.version import version
from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import DIALOG


def draw_about(actions: Actions) -> None:
    """Draw the window, where it is open."""
    if not actions.panels.about:
        return
    view, about = imgui.get_main_viewport(), actions.session.renderers[0].about
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.always, (0.5, 0.5))
    flags = imgui.WindowFlags_.always_auto_resize | DIALOG | imgui.WindowFlags_.no_saved_settings
    shown, opened = imgui.begin("about irrsplat", True, flags)
    actions.panels.about = bool(opened)
    if shown:
        imgui.push_text_wrap_pos(0.9 * view.size.x)
        imgui.text_unformatted(f"irrsplat {version()}")
        imgui.text_unformatted("indirect light of diffuse scenes by irradiance cache splatting")
        imgui.separator()
        imgui.text_unformatted(f"OpenGL {about['version']}")
        imgui.text_unformatted(str(about["renderer"]))
        imgui.pop_text_wrap_pos()
    imgui.end()
