"""The slim panel at the side: the settings that a user needs first, the preset and the buffer on show."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.ui.layout import Layout, accent
from irrsplat.app.viewer.ui.settings_panel import SettingsPanel
from irrsplat.settings import SETTINGS

FIRST = ("a", "tolerance", "blend", "exposure")  # settings
_WIDTH, _SHARE = 276.0, 0.42  # window coordinates at scale 1, and at most this share of the window
_LEAST = 110.0  # window coordinates at scale 1: names are above widgets that would be narrower
_GAP = 8.0  # window coordinates between the list of buffers and its name
_PANELS = (("All settings…", "settings"), ("Lights…", "lights"), ("Times and numbers…", "hud"))


class ControlsPanel:
    """Draws the panel along the left edge, which imgui keeps clear as it does the menu bar."""

    def __init__(self, actions: Actions, settings: SettingsPanel, layout: Layout) -> None:
        self.actions, self.settings, self.layout = actions, settings, layout

    def draw(self) -> None:
        """Draw it where it is open."""
        actions, view, style = self.actions, imgui.get_main_viewport(), imgui.get_style()
        if not actions.panels.controls:
            return
        width = min(_WIDTH * self.layout.scale, _SHARE * view.size.x)
        flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_title_bar | imgui.WindowFlags_.no_docking
        imgui.internal.begin_viewport_side_bar("controls", view, imgui.Dir.left, width, flags)
        arrow = imgui.calc_text_size("←").x + 2.0 * style.frame_padding.x + style.item_spacing.x
        inner, available = style.item_inner_spacing.x, imgui.get_content_region_avail().x
        names = max(imgui.calc_text_size(name).x + imgui.calc_text_size(SETTINGS[name].unit).x for name in FIRST) + 2.0 * inner
        self.settings.stacked = available - names - arrow < _LEAST * self.layout.scale
        self.settings.room = available - arrow if self.settings.stacked else available - names - arrow
        if actions.session.options.split == "presets":
            self.settings.draw_sides()
        self._buffer()
        self.settings.draw_presets()
        for name in FIRST:
            self.settings.draw_setting(SETTINGS[name])
        self.settings.room, self.settings.stacked = 0.0, False
        imgui.separator()
        for title, panel in _PANELS:
            if imgui.selectable(title, actions.is_on(panel))[0]:
                actions.toggle(panel)
        imgui.separator()
        self._state()
        imgui.end()

    def _buffer(self) -> None:
        """Draw the list of buffers."""
        actions, options = self.actions, self.actions.session.options
        side = actions.side if options.split in ("buffers", "presets") else 0
        label = self.settings.label("buffer")
        name = 0.0 if self.settings.stacked else imgui.calc_text_size(label).x + _GAP
        imgui.set_next_item_width(imgui.get_content_region_avail().x - name)
        if imgui.begin_combo(label, BUFFERS[options.buffers[side]].title, imgui.ComboFlags_.height_largest):
            for one, buffer in BUFFERS.items():
                if imgui.selectable(buffer.title, one == options.buffers[side])[0]:
                    actions.show(one)
                imgui.set_item_tooltip(buffer.help)
            imgui.end_combo()

    def _state(self) -> None:
        """Write how far the picture is, and offer more once it is done."""
        actions, session = self.actions, self.actions.session
        for progress in session.progress:
            imgui.text_wrapped(f"{progress.records} records")
            if progress.error is not None:
                imgui.text_wrapped(f"estimated error {100.0 * progress.error:.2g} %")
        if session.options.frozen:
            imgui.text_colored(accent(), "cache frozen")
        done = session.at_rest and session.progress
        imgui.text_wrapped("done" if done else "computing…")
        if done and imgui.button("Refine further"):
            actions.attempt(actions.refine_further)
