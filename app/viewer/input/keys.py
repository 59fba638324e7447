"""Every key of the viewer, stated once: what is pressed, what it does, and how the help sheet and docs/reference.md say it."""

from __future__ import annotations

from dataclasses import dataclass

from irrsplat.app.viewer.buffers.table import BUFFERS


@dataclass(frozen=True)
class Key:
    """A key and what it does.

    name: as moderngl-window's keys have it; ctrl: pressed with Ctrl; shift: with Shift, where it means something else without.
    action: a method of Actions, called with `argument`, if any.
    """

    name: str
    action: str
    help: str
    argument: str | None = None
    ctrl: bool = False
    shift: bool = False

    @property
    def shown(self) -> str:
        """The key as a user reads it, such as ``Ctrl+F12``."""
        word = _WORDS.get(self.name, self.name.removeprefix("NUMBER_").title() if len(self.name) > 3 else self.name)
        return "Ctrl+" * self.ctrl + "Shift+" * self.shift + word


_WORDS = {
    "LEFT_BRACKET": "[",
    "RIGHT_BRACKET": "]",
    "BACKSLASH": "\\",
    "MINUS": "-",
    "EQUAL": "=",
    "ESCAPE": "Esc",
    "TAB": "Tab",
    "END": "End",
    "SPACE": "Space",
}
_NUMBERS = (
    "1",
    "2",
    "3",
    "4",
    "5",
    "6",
    "7",
    "8",
    "9",
    "0",
    "MINUS",
    "EQUAL",
)  # the first buffers'; the others are in the menu

BUFFER_KEYS = tuple(
    Key(f"NUMBER_{key}" if len(key) == 1 else key, "show", BUFFERS[name].title, name)
    for key, name in zip(_NUMBERS, BUFFERS, strict=False)
)
CAMERA = (
    Key("HOME", "home", "back to the first camera; of the scene, or what stands in for it"),
    Key("END", "frame_all", "see the whole scene, in the same direction"),
    Key("F", "frame_selected", "see the picked object, or the whole scene"),
    Key("H", "headlamp", "a lamp at the eye; direct light alone"),
    Key("C", "copy_line", "copy the camera as a line of a .scene"),
    Key("C", "copy_flags", "copy it as flags of irrsplat render", ctrl=True),
    Key("B", "bookmark", "keep the camera as a bookmark of this scene"),
    Key("R", "record", "record the flight to a path file; again: end it"),
    Key("P", "play", "play the last path; again: stop"),
)
OVERLAYS = (
    Key("Z", "toggle", "record points", "points"),
    Key("X", "toggle", "record discs: how far each reaches", "discs"),
    Key("V", "toggle", "record normals", "normals"),
    Key("G", "toggle", "colour records by age instead of by radius", "by_age"),
    Key("L", "toggle", "points of the surface cache", "sites"),
    Key("T", "toggle", "wireframe", "wire"),
    Key("I", "toggle", "the record under the cursor; a click holds it", "inspect"),
    Key("L", "toggle", "measure along a line; drag it, or click both ends", "profile", ctrl=True),
)
EDITING = (
    Key("O", "turn_handles", "handles move, or turn; or aim a spot"),
    Key("BACKSPACE", "hide_object", "hide the picked object"),
    Key("Z", "undo", "undo", ctrl=True),
    Key("Y", "redo", "redo", ctrl=True),
    Key("Z", "redo", "redo", ctrl=True, shift=True),
    Key("S", "save_dialog", "save under a new name", ctrl=True),
)
CACHE = (
    Key("F", "toggle", "freeze the cache, to see it from elsewhere", "frozen", shift=True),
    Key("N", "step", "freeze, and gather one round"),
    Key("DELETE", "clear", "clear the cache"),
)
PICTURE = (
    Key("LEFT_BRACKET", "darker", "half a stop darker"),
    Key("RIGHT_BRACKET", "brighter", "half a stop brighter"),
    Key("BACKSLASH", "auto_exposure", "exposure by itself again"),
    Key("TAB", "split", "split view: off, two buffers, two presets, a snapshot"),
    Key("J", "compare", "both sides: side by side, one after the other, difference, FLIP"),
    Key("K", "snapshot", "keep this picture as a snapshot, to compare with later"),
    Key("SPACE", "flip", "the other side in place of the one on show"),
    Key("M", "swap_preset", "from this preset to paper and back"),
    Key("Y", "trace", "path-trace the truth of what is on show, ever finer; again: stop"),
)
WINDOW = (
    Key("F1", "toggle", "all keys", "help"),
    Key("F2", "toggle", "hide the interface", "hidden"),
    Key("F3", "toggle", "settings", "settings"),
    Key("F4", "toggle", "lights", "lights"),
    Key("F5", "reload", "read shaders and scene again"),
    Key("F6", "toggle", "times and numbers", "hud"),
    Key("F11", "fullscreen", "fullscreen"),
    Key("F12", "screenshot", "screenshot, PNG and EXR"),
    Key("F12", "screenshot_bare", "screenshot without the interface", ctrl=True),
    Key("O", "open_dialog", "open a scene", ctrl=True),
    Key("Q", "quit", "quit", ctrl=True),
    Key("ESCAPE", "escape", "let go of the mouse, stop; never quits"),
)
GROUPS: dict[str, tuple[Key, ...]] = {
    "camera": CAMERA,
    "buffers": BUFFER_KEYS,
    "overlays": OVERLAYS,
    "lights and objects": EDITING,
    "cache": CACHE,
    "picture": PICTURE,
    "window": WINDOW,
}
KEYS: tuple[Key, ...] = tuple(key for group in GROUPS.values() for key in group)

MAGNIFIER = "U"
FLYING = (  # what is held, not pressed
    ("right mouse", "hold and move to look"),
    ("W A S D, E Q", "fly; up and down"),
    ("Shift, Alt", "fast, slow; no shortcut works in flight"),
    ("wheel", "nearer to the cursor; right mouse held: speed"),
    ("left mouse", "drag to orbit about a point; or the divider"),
    ("left click", "pick an object, or a light while F4 is open"),
    (MAGNIFIER, "hold: the pixels under the cursor, magnified"),
)


def action(keys: object, key: object, ctrl: bool, shift: bool = False) -> Key | None:
    """What the window's key number `key` does, with Ctrl and Shift or without; None for nothing. keys: moderngl-window's names of
    them."""
    found = [one for one in KEYS if one.ctrl == ctrl and getattr(keys, one.name, None) == key and (shift or not one.shift)]
    return max(found, key=lambda one: one.shift, default=None)
