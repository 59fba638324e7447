"""The menu bar."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.editor import KINDS
from irrsplat.app.viewer.input.keys import GROUPS, KEYS
from irrsplat.app.viewer.show.comparison import flip_is_there
from irrsplat.app.viewer.ui.layout import Layout
from irrsplat.app.viewer.ui.windows.about import PAGES
from irrsplat.app.viewer.ui.windows.scene_pictures import ScenePictures
from irrsplat.app.viewer.view_options import COMPARES, SCALES, SPLITS
from irrsplat.reference.worker import INSTALL
from irrsplat.scene import bundled
from irrsplat.settings import PRESETS

_MORE = "More"
_CAMERA = ("home", "frame_all", "frame_selected", "headlamp", "bookmark", "copy_line", "copy_flags", "record", "play")
_TIGHT = 3.0  # window coordinates at least on both sides of a title in the bar
_NAME_WIDTH = 8.0  # of a bookmark's name, in heights of the font: so that the menu has room beside the other


class Menus:
    """Draws the menu bar of the actions."""

    def __init__(self, actions: Actions, layout: Layout, pictures: ScenePictures) -> None:
        self.actions, self.layout, self.pictures = actions, layout, pictures
        self._unfolded = ""  # the title in _MORE that is
        self._scale = 0.0  # of the interface, while its slider is dragged

    def draw(self) -> None:
        """Draw the bar along the top, and the menu that is open."""
        if not imgui.begin_main_menu_bar():
            return
        menus = (
            ("Scene", self._scenes),
            ("Edit", self._edit),
            ("Camera", self._cameras),
            ("Show", self._show),
            ("Over it", self._overlays),
            ("Cache", self._cache),
            ("Preset", self._presets),
            ("Compare", self._compare),
            ("Window", self._window),
            ("Help", self._help),
        )
        style = imgui.get_style()
        spacing, room = style.item_spacing, imgui.get_main_viewport().size.x - style.window_padding.x
        widths = [imgui.calc_text_size(title).x for title, _ in menus]
        fit = len(menus)
        if sum(widths) + 2.0 * len(menus) * _TIGHT > room:  # the last ones go into one menu
            room -= imgui.calc_text_size(_MORE).x + 2.0 * _TIGHT
            while fit > 0 and sum(widths[:fit]) + 2.0 * fit * _TIGHT > room:
                fit -= 1
        between = max((room - sum(widths[:fit])) / (2.0 * max(fit, 1)) - 2.0, 1.0)  # imgui leaves it on both sides
        narrow = between < spacing.x
        shown = menus[:fit] if fit == len(menus) else (*menus[:fit], (_MORE, lambda: self._more(menus[fit:])))
        for title, draw in shown:
            if narrow:
                imgui.push_style_var(imgui.StyleVar_.item_spacing, (between, spacing.y))
            opened = imgui.begin_menu(title)
            if narrow:
                imgui.pop_style_var()
            if opened:
                if self.actions.close_menus:
                    imgui.close_current_popup()
                draw()
                imgui.end_menu()
            elif title == _MORE:
                self._unfolded = ""
        self.actions.close_menus = False
        imgui.text_disabled(f"  {self.actions.session.scene.name}")
        imgui.end_main_menu_bar()

    def _more(self, menus: Sequence[tuple[str, Callable[[], None]]]) -> None:
        """Draw the menus that the bar has no room for, to be unfolded: beside this one there would be no room either."""
        imgui.dummy((imgui.get_main_viewport().size.x - 2.0 * imgui.get_frame_height(), 0.0))  # wide enough for any of them
        for title, draw in menus:
            imgui.set_next_item_open(title == self._unfolded)
            opened = imgui.collapsing_header(title)
            if opened != (title == self._unfolded):
                self._unfolded = title if opened else ""
            if opened:
                draw()

    def _key(self, action: str, argument: str | None = None) -> None:
        """Draw a menu's line for what a key does, with the key beside it."""
        key = next(k for k in KEYS if (k.action, k.argument) == (action, argument))
        on = argument is not None and self.actions.is_on(argument)
        if imgui.menu_item(key.help.split(";")[0], key.shown, on)[0]:
            self.actions.press(key)

    def _scenes(self) -> None:
        actions = self.actions
        for name in bundled():
            if imgui.menu_item(name, "", actions.source == name)[0]:
                actions.attempt(lambda name=name: actions.open(name))  # type: ignore[misc]
            self.pictures.tooltip(name, self.layout.scale)
        recent = [source for source in actions.preferences.recent if source not in bundled()]
        if recent:
            imgui.separator_text("recent")
            for source in recent:
                if imgui.menu_item(source, "", actions.source == source)[0]:
                    actions.attempt(lambda source=source: actions.open(source))  # type: ignore[misc]
                self.pictures.tooltip(source, self.layout.scale)
        imgui.separator()
        self._key("open_dialog")
        self._key("save_dialog")

    def _edit(self) -> None:
        actions, editor = self.actions, self.actions.editor
        for title, what, shown, act in (
            ("undo", editor.undoes, "Ctrl+Z", actions.undo),
            ("redo", editor.redoes, "Ctrl+Y", actions.redo),
        ):
            if imgui.menu_item(f"{title}: {what}" if what else title, shown, False, bool(what))[0]:
                actions.attempt(act)
        imgui.separator_text("objects")
        self._key("turn_handles")
        self._key("hide_object")
        for number in editor.hidden:
            if imgui.menu_item(f"show {editor.name(number)}##{number}", "", False)[0]:
                actions.show_hidden(number)
        imgui.separator_text("lights")
        for kind in KINDS:
            if imgui.menu_item(f"add a {kind} light", "", False)[0]:
                actions.add_light(kind)

    def _cameras(self) -> None:
        actions = self.actions
        for i, camera in enumerate(actions.session.scene.placed(actions.session.origin).cameras):
            if imgui.menu_item(f"{camera.name or ('first' if i == 0 else f'camera {i + 1}')}##{i}", "", False)[0]:
                actions.go(camera)
        if actions.bookmarks:
            imgui.separator_text("bookmarks")
        for bookmark in list(actions.bookmarks):
            if imgui.begin_menu(bookmark.name):
                if imgui.menu_item("go there", "", False)[0]:
                    actions.go(bookmark)
                imgui.set_next_item_width(_NAME_WIDTH * imgui.get_font_size())
                named, name = imgui.input_text("##name", bookmark.name, imgui.InputTextFlags_.enter_returns_true)
                imgui.set_item_tooltip("another name; Enter takes it")
                if named and actions.attempt(lambda one=bookmark, name=name: actions.rename(one, name)):  # type: ignore[misc]
                    imgui.close_current_popup()
                if imgui.menu_item("forget it", "", False)[0]:
                    actions.forget(bookmark)
                imgui.end_menu()
        imgui.separator()
        for action in _CAMERA:
            self._key(action)

    def _show(self) -> None:
        options = self.actions.session.options
        for side in (0, 1) if options.split != "off" else (0,):
            if options.split != "off":
                imgui.separator_text(("left", "right")[side])
            for name, buffer in BUFFERS.items():
                shown = next((k.shown for k in GROUPS["buffers"] if k.argument == name), "")
                if imgui.menu_item(f"{buffer.title}##{side}", shown, options.buffers[side] == name)[0]:
                    options.buffers[side] = name
                imgui.set_item_tooltip(buffer.help)
        self._key("trace")
        imgui.separator_text("exposure")
        for action in ("darker", "brighter", "auto_exposure"):
            self._key(action)

    def _compare(self) -> None:
        actions, session = self.actions, self.actions.session
        options = session.options
        for way, title in SPLITS.items():
            there = way != "snapshot" or bool(session.snapshots)
            if imgui.menu_item(title, "", options.split == way, there)[0]:
                actions.attempt(lambda way=way: session.split(way))  # type: ignore[misc]
        self._key("split")
        imgui.separator_text("both sides")
        for compare, title in COMPARES.items():
            there = options.split != "off" and (compare != "FLIP" or flip_is_there())
            if imgui.menu_item(title, "", options.compare == compare, there)[0]:
                actions.compare_by(compare)
            if compare == "FLIP" and not flip_is_there():
                imgui.set_item_tooltip(f"this needs: {INSTALL}")
        self._key("compare")
        self._key("flip")
        imgui.separator_text("snapshots")
        for snapshot in list(session.snapshots):
            if imgui.begin_menu(snapshot.name):
                if imgui.menu_item("show it on the right", "", session.pinned is snapshot)[0]:
                    session.pin(snapshot)
                if imgui.menu_item("forget it", "", False)[0]:
                    session.forget_snapshot(snapshot)
                imgui.end_menu()
        self._key("snapshot")

    def _overlays(self) -> None:
        for overlay in ("points", "discs", "normals", "by_age"):
            self._key("toggle", overlay)
        imgui.separator()
        for overlay in ("sites", "wire", "inspect", "profile"):
            self._key("toggle", overlay)

    def _cache(self) -> None:
        self._key("toggle", "frozen")
        self._key("step")
        self._key("clear")

    def _presets(self) -> None:
        actions = self.actions
        current = actions.session.settings(actions.side)[0]
        for name in PRESETS:
            if imgui.menu_item(name, "", name == current)[0]:
                actions.attempt(lambda name=name: actions.session.use_preset(actions.side, name))  # type: ignore[misc]
        imgui.separator()
        self._key("swap_preset")

    def _window(self) -> None:
        actions = self.actions
        for panel in ("settings", "lights", "hud", "hidden"):
            self._key("toggle", panel)
        _, actions.panels.log = imgui.menu_item("messages", "", actions.panels.log)
        if imgui.menu_item("standard places of panels", "", False)[0]:
            self.layout.restore()
        imgui.set_item_tooltip("a panel docks where its title is dragged to: at an edge, or as a tab of another")
        imgui.separator()
        appearance = actions.appearance
        _, appearance.light = imgui.menu_item("light colours", "", appearance.light)
        imgui.set_next_item_width(_NAME_WIDTH * imgui.get_font_size())
        _, self._scale = imgui.slider_float("size of the interface", self._scale or appearance.scale, *SCALES, "%.2f")
        if not imgui.is_item_active():  # while it is dragged, it would move away from under the mouse
            actions.enlarge(self._scale)
            self._scale = 0.0
        imgui.separator()
        for action in ("fullscreen", "screenshot", "screenshot_bare", "reload", "quit"):
            self._key(action)

    def _help(self) -> None:
        actions = self.actions
        self._key("toggle", "help")
        imgui.separator_text("pages of docs/")
        for page, about in PAGES.items():
            if imgui.menu_item(page, about, False)[0]:
                actions.copy(f"docs/{page}")
            imgui.set_item_tooltip("its name goes to the clipboard")
        imgui.separator()
        if imgui.menu_item("about irrsplat", "", False)[0]:
            actions.about()
