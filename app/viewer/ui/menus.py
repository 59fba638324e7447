"""The menu bar and the context menu, made from the table of actions."""

from __future__ import annotations

import os
from functools import partial

from imgui_bundle import imgui

from irrsplat.app.common.version import version
from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.commands import COMMANDS, MENUS, Command
from irrsplat.scene import bundled

_CONTEXT = ("delete", "undo")  # actions on the selected object or light
_TIGHT = 3.0  # window coordinates: the least space on both sides of a title in the bar


def draw_menus(actions: Actions) -> None:
    """Draw the menu bar along the top, and the open menu."""
    if not imgui.begin_main_menu_bar():
        return
    style = imgui.get_style()
    room = imgui.get_main_viewport().size.x - style.window_padding.x
    widths = sum(imgui.calc_text_size(title).x for title in MENUS)
    between = max((room - widths) / (2.0 * len(MENUS)) - 2.0, _TIGHT)  # imgui leaves this space on both sides of a title
    for title in MENUS:
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (min(between, style.item_spacing.x), style.item_spacing.y))
        opened = imgui.begin_menu(title)
        imgui.pop_style_var()
        if opened:
            for submenu in dict.fromkeys(one.menu for one in COMMANDS if one.menu.startswith(f"{title}/")):
                if imgui.begin_menu(submenu.split("/")[1]):
                    _entries(actions, submenu)
                    imgui.end_menu()
            _entries(actions, title)
            imgui.end_menu()
    imgui.end_main_menu_bar()


def draw_context_menu(actions: Actions) -> None:
    """Draw the menu that a right click on an object or a light opens."""
    if actions.panels.context_menu:
        imgui.open_popup("context")
        actions.panels.context_menu = False
    if imgui.begin_popup("context"):
        for command in COMMANDS:
            if command.action in _CONTEXT:
                _entry(actions, command)
        imgui.end_popup()


def _entries(actions: Actions, menu: str) -> None:
    """Draw the entries of a menu. Scenes, cameras and the version are added, since the table cannot list them."""
    if menu == "Help":
        about = actions.session.renderers[0].about
        imgui.text_disabled(f"irrsplat {version()}\nOpenGL {about['version']}\n{about['renderer']}")
    for command in COMMANDS:
        if command.menu == menu:
            if command.action == "save_again":
                _scenes(actions)
            if command.section:
                imgui.separator()
            _entry(actions, command)
    if menu == "View/Camera":
        _cameras(actions)


def _entry(actions: Actions, command: Command) -> None:
    possible = actions.can(command)
    if command.action == "redo" and command.shift:
        return  # the second key of the entry above
    if imgui.menu_item(f"{command.title}##{command.menu}", command.shown, actions.is_active(command), possible)[0]:
        actions.press(command)
    if said := actions.missing(command) or command.help:
        imgui.set_item_tooltip(said)


def _scenes(actions: Actions) -> None:
    """Draw the recent and the bundled scenes."""
    names = bundled()
    recent = [source for source in actions.preferences.recent if source not in names]
    if imgui.begin_menu("Open recent", bool(recent)):
        for source in recent:
            if imgui.menu_item(f"{os.path.basename(source)}##{source}", "", actions.source == source)[0]:
                actions.attempt(partial(actions.open, source))
            imgui.set_item_tooltip(source)
        imgui.end_menu()
    imgui.separator_text("Bundled scenes")
    for name in names:
        if imgui.menu_item(name, "", actions.source == name)[0]:
            actions.attempt(partial(actions.open, name))


def _cameras(actions: Actions) -> None:
    """Draw the cameras of the scene."""
    imgui.separator()
    for i, camera in enumerate(actions.session.scene.cameras):
        if imgui.menu_item(f"{camera.name or ('first' if i == 0 else f'camera {i + 1}')}##{i}", "", False)[0]:
            actions.session.free_camera.camera = camera
