"""The table of all actions of the viewer. Menus, keys, the command palette, F1 and docs/reference.md are made from it."""

from __future__ import annotations

from dataclasses import dataclass

from irrsplat.app.film import video
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.reference import worker
from irrsplat.settings import PRESETS


@dataclass(frozen=True)
class Command:
    """One action of the user.

    menu: the path of its menu, such as ``View/Buffer``. action: a method of Actions or of a part of it, such as ``film.release``.
    argument: the method's argument, None for none.
    key: moderngl-window's name of a key, "" for none. ctrl, shift: True if the key is pressed with Ctrl or Shift.
    enabled: a value of Actions or of a part of it, true while the action can run; "" for always. help: further words.
    extra: the extra of the package that the action needs, a key of EXTRAS. section: True if a line separates it from the entry
    above.
    """

    menu: str
    title: str
    action: str
    key: str = ""
    argument: str | bool | None = None
    ctrl: bool = False
    shift: bool = False
    help: str = ""
    enabled: str = ""
    extra: str = ""
    section: bool = False

    @property
    def shown(self) -> str:
        """The text of the key for the user, such as ``Ctrl+F12``; "" for an action without a key."""
        name = self.key.removeprefix("NUMBER_")
        word = _WORDS.get(self.key, name.title() if len(name) > 3 else name)
        return "Ctrl+" * self.ctrl + "Shift+" * self.shift + word


EXTRAS = {"reference": ("mitsuba", worker.INSTALL), "video": ("av", video.INSTALL)}  # by extra: module, install command
MENUS = ("File", "Edit", "View", "Render", "Compare", "Window", "Help")
_WORDS = {"MINUS": "-", "EQUAL": "=", "ESCAPE": "Esc", "TAB": "Tab"}
_NUMBERS = (*(f"NUMBER_{digit}" for digit in "1234567890"), "MINUS", "EQUAL")  # the keys of the first buffers
_BUFFER_KEYS = dict(zip(BUFFERS, _NUMBERS, strict=False))
_FILE = (
    Command("File", "Open…", "open_file", "O", ctrl=True, help="a scene"),
    Command("File", "Reload", "reload", "F5", help="the scene's file, for example after another program has changed it"),
    Command("File", "Save", "save_again", "S", ctrl=True, section=True),
    Command("File", "Save as…", "save_as", "S", ctrl=True, shift=True),
    Command("File", "Save picture", "screenshot", "F12", help="write a PNG to the pictures folder", section=True),
    Command("File", "Save film", "save_film", help="of the flight, in the videos folder", enabled="film_possible", extra="video"),
    Command("File", "Cancel film", "cancel_film", enabled="film.busy"),
    Command("File", "Quit", "quit", "Q", ctrl=True, section=True),
)
_EDIT = (
    Command("Edit", "Undo", "editor.undo", "Z", ctrl=True, enabled="editor.past"),
    Command("Edit", "Redo", "editor.redo", "Y", ctrl=True, enabled="editor.future"),
    Command("Edit", "Redo", "editor.redo", "Z", ctrl=True, shift=True, enabled="editor.future"),
    Command("Edit", "Add light", "add_light", "INSERT", help="a copy of the selected light, or a point light", section=True),
    Command("Edit", "Delete", "delete", "DELETE", help="the selected light; hide an object", enabled="selected"),
    Command("Edit", "Deselect", "escape", "ESCAPE", help="close menus and messages; first, a field or a dialog", section=True),
)
_VIEW = (
    *(Command("View/Buffer", b.title, "show", _BUFFER_KEYS.get(name, ""), name, help=b.help) for name, b in BUFFERS.items()),
    Command("View/Camera", "First camera", "session.free_camera.home", "HOME"),
    Command("View/Camera", "Keep this view", "editor.keep_view", help="in this menu, and in the saved scene"),
    Command("View/Camera", "Record flight", "record", "R", help="to a path file; press again to end", section=True),
    Command("View", "Record discs", "toggle", "X", "discs", help="with the radius of each record", section=True),
    Command("View", "Inspect records", "toggle", "I", "inspect", help="under the cursor", section=True),
    Command("View", "Measure along a line", "toggle", "L", "profile", ctrl=True, help="drag a line over surfaces"),
    Command("View", "Why is it dark here?", "toggle", "D", "why", ctrl=True, help="lights, blockers and sky at a clicked point"),
    Command("View", "Measuring plane", "toggle", "M", "plane", ctrl=True, help="horizontal, in lux with isolines"),
)
_RENDER = (
    *(Command("Render", f"Preset {name}", "session.use_preset", argument=name) for name in PRESETS),
    Command("Render", "Refine further", "refine_further", help="halve the target error", section=True),
    Command("Render", "Freeze cache", "toggle", "F", "frozen", shift=True, help="to look at its records from another place"),
    Command("Render", "Clear cache", "clear"),
)
_COMPARE = (
    Command("Compare", "Two presets", "compare", "TAB", help="side by side; press again for one picture"),
    Command("Compare", "Other side", "compare", "SPACE", True, help="show one side alone, then the other"),
    Command("Compare", "Path-trace the reference", "trace", "Y", help="press again to stop", extra="reference", section=True),
)
_WINDOW = (
    Command("Window", "Controls", "toggle", argument="controls", help="the panel at the side of the picture"),
    Command("Window", "All settings", "toggle", "F3", "settings"),
    Command("Window", "Lights", "toggle", "F4", "lights"),
    Command("Window", "Hide the interface", "toggle", "F2", "hidden", help="press again to show it"),
    Command("Window", "Objects", "toggle", argument="outliner", help="list the objects; click to select one"),
)
_HELP = (
    Command("Help", "Find a command…", "find_command", "P", ctrl=True, help="any action or setting, by name"),
    Command("Help", "Keys", "find_command", "F1", True, help="list all keys of mouse and keyboard"),
)
COMMANDS: tuple[Command, ...] = (*_FILE, *_EDIT, *_VIEW, *_RENDER, *_COMPARE, *_WINDOW, *_HELP)
KEYS: tuple[Command, ...] = tuple(one for one in COMMANDS if one.key)
GROUPS: dict[str, tuple[Command, ...]] = {
    menu: tuple(one for one in KEYS if one.menu == menu) for menu in dict.fromkeys(one.menu for one in KEYS)
}

FLYING = (  # mouse buttons and keys that the user holds or drags, and their effects
    ("right mouse", "hold and move to look around"),
    ("W A S D, E Q", "fly; move up and down"),
    ("Shift, Alt", "fly fast, slowly; shortcuts are off in flight"),
    ("wheel", "move toward the cursor"),
    ("left mouse", "drag to orbit about a point, or to move the divider"),
    ("left click", "select an object, or a light while F4 is open"),
    ("F11", "full screen"),
)


def of_key(keys: object, key: object, ctrl: bool, shift: bool = False) -> Command | None:
    """Return the action of the window's key number `key`, with or without Ctrl and Shift; None for a key without an action.

    keys: moderngl-window's names of the keys.
    """
    found = [one for one in KEYS if one.ctrl == ctrl and getattr(keys, one.key, None) == key and (shift or not one.shift)]
    return max(found, key=lambda one: one.shift, default=None)
