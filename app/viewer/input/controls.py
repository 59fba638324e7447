"""The effects of the window's events: flight, camera turns, orbit and keys, unless the interface takes the event."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Literal

import numpy as np
from moderngl_window.context.base import BaseWindow, KeyModifiers

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input import commands
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.scene import FORMATS

Dragged = Literal["", "view", "divider", "line", "orbit"]
LEFT, RIGHT = 1, 2  # moderngl-window's numbers of mouse buttons
_GRIP = 6.0  # window coordinates on both sides of the divider: a press there grabs the divider
_CLICK = 3.0  # window coordinates: the greatest motion of the mouse in a click
_PACE = 4.0  # factor on the speed of flight: Shift multiplies by it, Alt divides by it
_FLYING = "WASDEQ"
_NOWHERE = (-1.0, -1.0)  # the position of the mouse before its first event
_RIGHT_CTRL = 345  # glfw's number; moderngl-window has no name for it
_ALT = (342, 346)  # glfw's numbers of the left and the right key; moderngl-window has no names for them


class Controls:
    """The handlers of the events of `wnd`, with moderngl-window's names and window coordinates.

    picture: a call that returns the part of the window with the picture: left, top, width, height in pixels.
    """

    def __init__(
        self,
        wnd: BaseWindow,
        actions: Actions,
        display: Display,
        backend: ImguiBackend,
        picture: Callable[[], tuple[int, int, int, int]],
    ) -> None:
        self.wnd, self.actions, self.display, self.backend, self.picture = wnd, actions, display, backend, picture
        self.pressed: set[int | str] = set()  # keys that are down, without keys that were pressed for the interface
        self.pace = 1.0  # a factor on the speed of flight
        self.mouse = _NOWHERE
        self.dragged: Dragged = ""  # the object that a pressed mouse button drags
        self.pivot = (0.0, 0.0, 0.0)  # the world point of an orbit
        self.travelled = 0.0  # window coordinates that the mouse has moved since a button went down
        self._skip = False  # True if the next motion event does not count, since the mouse was just captured
        wnd.key_event_func = self.key
        wnd.unicode_char_entered_func = backend.io.add_input_characters_utf8
        wnd.mouse_position_event_func = wnd.mouse_drag_event_func = self.mouse_moved
        wnd.mouse_press_event_func = self.mouse_pressed
        wnd.mouse_release_event_func = self.mouse_released
        wnd.mouse_scroll_event_func = self.wheel

    @property
    def looking(self) -> bool:
        """True while the right mouse button is down, when the mouse is captured and turns the camera."""
        return self.dragged == "view"

    @property
    def session(self) -> Session:
        return self.actions.session

    @property
    def pointer(self) -> tuple[int, int] | None:
        """The pixel under the mouse, from the top left; None if the mouse is over the interface, captured or outside."""
        if self.backend.io.want_capture_mouse or self.looking:
            return None
        left, top, width, height = self.picture()
        x, y = (int(v * self.wnd.pixel_ratio) for v in self.mouse)
        x, y = x - left, y - top
        return (x, y) if 0 <= x < width and 0 <= y < height else None

    @property
    def active(self) -> bool:
        """True if the camera may move in the next frame without a further event."""
        return bool(self.pressed) or self.looking

    @property
    def flies(self) -> bool:
        """True if a flying key is down."""
        return any(getattr(self.wnd.keys, name) in self.pressed for name in _FLYING)

    def fly(self, dt: float) -> None:
        """Move the camera for `dt` seconds by the keys that are down."""
        names = self.wnd.keys
        right, up, ahead = (
            float(getattr(names, plus) in self.pressed) - float(getattr(names, minus) in self.pressed)
            for plus, minus in (("D", "A"), ("E", "Q"), ("W", "S"))
        )
        if self.backend.io.want_capture_keyboard:
            self.pressed.clear()  # the interface takes all keys from now on; a key flies again when it is pressed again
        elif right or up or ahead:
            self.session.free_camera.move(right, up, ahead, dt, self.pace)

    @property
    def _per_pixel(self) -> float:
        """Radians by which a motion of one window coordinate turns the view. The grabbed point stays under the mouse."""
        return float(np.radians(self.session.camera.fov)) * self.wnd.pixel_ratio / max(self.session.size[1], 1)

    def _capture(self, on: bool) -> None:
        if self.looking != on:
            self.dragged, self._skip = "view" if on else "", on
            self.wnd.mouse_exclusivity = on

    def _on_divider(self, x: float) -> bool:
        options, (left, _, width, _) = self.session.options, self.picture()
        return options.split and abs(x - (left + options.divider * width) / self.wnd.pixel_ratio) <= _GRIP

    # ---- keys ------------------------------------------------------------------------------------------------------

    def key(self, key: int | str, action: object, modifiers: KeyModifiers) -> None:
        names, down = self.wnd.keys, action != self.wnd.keys.ACTION_RELEASE
        # in a modifier key's own event, `modifiers` is the state before it (X11) or after it
        shift = down if key in (names.LEFT_SHIFT, names.RIGHT_SHIFT) else modifiers.shift
        ctrl = down if key in (names.LEFT_CTRL, _RIGHT_CTRL) else modifiers.ctrl
        alt = down if key in _ALT else modifiers.alt
        self.pace = _PACE if shift else 1.0 / _PACE if alt else 1.0
        if not down:
            self.pressed.discard(key)
        self.backend.key(key, down, names, bool(ctrl), bool(shift), bool(alt))
        if action != names.ACTION_PRESS:
            return
        if key == names.ESCAPE:
            self._capture(False)
            if self.backend.io.want_text_input and self.actions.prompt is None:
                return  # it ends the input of a field alone
        elif self.backend.io.want_capture_keyboard or self.actions.prompt is not None:
            return
        flying = self.looking or self.flies
        found = commands.of_key(names, key, bool(ctrl), bool(shift))
        if flying and found is not None and found.action != "escape":
            found = None  # one hand is on the flying keys, and a slip must not quit or open a dialog
        if found is None or not ctrl:  # a letter pressed with Ctrl does not fly
            self.pressed.add(key)
        if found is not None:
            self.actions.press(found)
            if self.actions.prompt is not None:
                self.pressed.clear()

    # ---- mouse -----------------------------------------------------------------------------------------------------

    def mouse_moved(self, x: float, y: float, dx: float, dy: float) -> None:
        if self.looking:
            if not self._skip:  # the first motion of a captured mouse is a jump
                self.travelled += abs(dx) + abs(dy)
                self.session.free_camera.turn(dx * self._per_pixel, dy * self._per_pixel)
            self._skip = False
            return
        self.mouse = (x, y)
        self.backend.mouse_position(x, y)
        self.travelled += abs(dx) + abs(dy)
        if self.dragged == "divider":
            left, _, width, _ = self.picture()
            self.session.options.divider = float(np.clip((x * self.wnd.pixel_ratio - left) / width, 0.02, 0.98))
        elif self.dragged == "line" and self.travelled > _CLICK:
            self._draw_line()
        elif self.dragged == "orbit" and self.actions.editor.dragging:
            self.dragged = ""  # the handles take the drag
        elif self.dragged == "orbit" and self.travelled > _CLICK:
            self.session.free_camera.turn(4.0 * dx * self._per_pixel, 4.0 * dy * self._per_pixel, self.pivot)

    def mouse_pressed(self, x: float, y: float, button: int) -> None:
        """Begin a drag or a click at the position of the last motion event.

        glfw passes the x and y of the cursor at the time of the call. A slow frame delays the call, so that x and y may be later
        than the event. The motion events before this event carry the right position.
        """
        if self.looking:  # a captured mouse has no position in the window
            return
        if self.mouse == _NOWHERE:
            self.mouse = (x, y)
            self.backend.mouse_position(x, y)
        x = self.mouse[0]
        self.backend.io.add_mouse_button_event(button - 1, True)
        self.travelled = 0.0
        if self.backend.io.want_capture_mouse:
            return
        if self.session.options.split and self.pointer is not None:
            self.session.options.side = self.session.side_at(self.pointer[0])
        if button == RIGHT:
            self._capture(True)
        elif button == LEFT and self._on_divider(x):
            self.dragged = "divider"
        elif button == LEFT and self.session.options.profile and not self.actions.editor.handles_used:
            self.dragged = "line"
            self._draw_line(begin=True)
        elif button == LEFT and not self.actions.editor.handles_used:
            self.dragged = "orbit"
            self.pivot = self.display.point_at(self.pointer) or self.session.free_camera.camera.target

    def mouse_released(self, x: float, y: float, button: int) -> None:
        self.backend.io.add_mouse_button_event(button - 1, False)
        if button == RIGHT and self.looking:
            self._capture(False)
            if self.travelled <= _CLICK and self.pointer is not None and not self.session.options.inspect:
                self._pick(self.pointer)
                self.actions.session.options.context_menu = self.actions.selected
        if button == LEFT:
            if self.dragged == "orbit" and self.travelled <= _CLICK and self.pointer is not None:
                if self.session.options.why:
                    self.session.options.surface = self.display.surface_at(self.pointer)
                elif not self.session.options.inspect:
                    self._pick(self.pointer)
            self.dragged = "" if not self.looking else self.dragged

    def _pick(self, pixel: tuple[int, int]) -> None:
        self.actions.pick(pixel, self.display.mesh_at(pixel), self.wnd.pixel_ratio)

    def _draw_line(self, begin: bool = False) -> None:
        """Put the end of the measuring line at the mouse. begin: True if both ends are put there."""
        point = self.display.point_at(self.pointer)
        options = self.session.options
        if point is not None:
            options.line = (point if begin or options.line is None else options.line[0]), point
        elif begin:
            self.dragged = ""
            self.actions.say("no surface is there to measure on", topic="line")

    def wheel(self, x_offset: float, y_offset: float) -> None:
        camera = self.session.free_camera
        if self.backend.io.want_capture_mouse:
            self.backend.io.add_mouse_wheel_event(x_offset, y_offset)
        elif not self.looking:
            camera.dolly(y_offset, self.display.point_at(self.pointer))

    # ---- the window ------------------------------------------------------------------------------------------------

    def files_dropped(self, paths: list[str]) -> None:
        """Open the first scene among the files that were dropped on the window, such as a model with its textures."""
        first, *others = [path for path in paths if path.lower().endswith(FORMATS)] or paths[:1]
        self.actions.attempt(lambda: self.actions.open(first))
        if others:
            self.actions.say(f"not opened, since the window shows one scene: {', '.join(map(os.path.basename, others))}")

    def focus_changed(self, focused: bool) -> None:
        """Release all keys and buttons when the window gains or loses the keyboard: their release events go elsewhere."""
        self.pressed.clear()
        self._capture(False)
        self.pace, self.dragged = 1.0, ""
        self.backend.io.add_focus_event(focused)
