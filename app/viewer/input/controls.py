"""Hands on the camera: what keys and mouse do while they are not the interface's."""

from __future__ import annotations

from typing import Any

import numpy as np
from moderngl_window.context.base import BaseWindow, KeyModifiers

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input import keys
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend

LEFT, RIGHT = 1, 2  # mouse buttons, as moderngl-window numbers them
_GRIP = 6.0  # window coordinates to both sides of the divider
_CLICK = 3.0  # window coordinates that a click may move
_PACE = 4.0  # Shift is so much faster, Ctrl so much slower
_FLYING = "WASDEQ"
_RIGHT_CTRL = 345  # glfw's number; moderngl-window has no name for it


class Controls:
    """The part of the viewer that takes a window's events, in moderngl-window's names and window coordinates."""

    wnd: BaseWindow
    actions: Actions
    backend: ImguiBackend

    def __init__(self) -> None:
        self.held: set[Any] = set()  # keys
        self.pace = 1.0
        self.mouse = (-1.0, -1.0)  # nowhere yet
        self.looking = self.dividing = False
        self.pivot: tuple[float, float, float] | None = None  # of an orbit under way
        self.travelled = 0.0  # since a button went down
        self._skip = False  # the next motion is none: the mouse was just captured

    @property
    def pointer(self) -> tuple[int, int] | None:
        """The pixel under the mouse, from the top left; None where the interface has it, or it is captured or outside."""
        if self.backend.wants_mouse or self.looking:
            return None
        x, y = (int(v * self.wnd.pixel_ratio) for v in self.mouse)
        width, height = self.wnd.buffer_size
        return (x, y) if 0 <= x < width and 0 <= y < height else None

    def _fly(self, dt: float) -> None:
        names = self.wnd.keys
        right, up, ahead = (
            float(names.__dict__[plus] in self.held) - float(names.__dict__[minus] in self.held)
            for plus, minus in (("D", "A"), ("E", "Q"), ("W", "S"))
        )
        if self.backend.wants_keyboard:
            self.held.clear()  # what is typed from now on is the interface's, until a key is pressed anew
        elif right or up or ahead:
            self.actions.stop()
            self.actions.session.free_camera.move(right, up, ahead, dt, self.pace)

    @property
    def _per_pixel(self) -> float:
        """Radians that the view turns for a motion of one window coordinate: what is grabbed stays under the mouse."""
        return float(np.radians(self.actions.session.camera.fov)) / max(self.wnd.height, 1)

    def _capture(self, on: bool) -> None:
        if self.looking != on:
            self.looking = self._skip = on
            self.wnd.mouse_exclusivity = on

    def _on_divider(self, x: float) -> bool:
        options = self.actions.session.options
        return options.split != "off" and abs(x - options.divider * self.wnd.width) <= _GRIP

    # ---- events ----------------------------------------------------------------------------------------------------

    def on_key_event(self, key: Any, action: Any, modifiers: KeyModifiers) -> None:
        """A key went down or up."""
        names, down = self.wnd.keys, action != self.wnd.keys.ACTION_RELEASE
        # the modifiers that come with such a key's own event may be those before it (X11), or after it
        shift = down if key in (names.LEFT_SHIFT, names.RIGHT_SHIFT) else modifiers.shift
        ctrl = down if key in (names.LEFT_CTRL, _RIGHT_CTRL) else modifiers.ctrl
        self.pace = _PACE if shift else 1.0 / _PACE if ctrl else 1.0
        if not down:
            self.held.discard(key)
        self.backend.key(key, down, names)
        if action != names.ACTION_PRESS:
            return
        if key == names.ESCAPE:
            self._capture(False)
        elif self.backend.wants_keyboard:
            return
        flying = self.looking or any(getattr(names, name) in self.held for name in _FLYING)
        self.held.add(key)
        found = keys.action(names, key, bool(ctrl))
        if found is not None and not (ctrl and flying and found.name in _FLYING):  # Ctrl+Q: slowly down, or quit
            self.actions.press(found)
            if found.action == "open_dialog":
                self.held.clear()

    def on_unicode_char_entered(self, char: str) -> None:
        """Text was typed."""
        self.backend.char(char)

    def on_mouse_position_event(self, x: int, y: int, dx: int, dy: int) -> None:
        """The mouse moved with no button down."""
        self._moved(x, y, dx, dy)

    def on_mouse_drag_event(self, x: int, y: int, dx: int, dy: int) -> None:
        """The mouse moved with a button down."""
        self._moved(x, y, dx, dy)

    def _moved(self, x: float, y: float, dx: float, dy: float) -> None:
        session = self.actions.session
        if self.looking:
            if not self._skip:  # the first motion of a captured mouse is a jump
                session.free_camera.look(dx, dy, self._per_pixel)
            self._skip = False
            return
        self.mouse = (x, y)
        self.backend.mouse_position(x, y)
        self.travelled += abs(dx) + abs(dy)
        if self.dividing:
            session.options.divider = float(np.clip(x / max(self.wnd.width, 1), 0.02, 0.98))
        elif self.pivot is not None and self.travelled > _CLICK:
            session.free_camera.orbit(self.pivot, dx, dy, 4.0 * self._per_pixel)

    def on_mouse_press_event(self, x: int, y: int, button: int) -> None:
        """A mouse button went down."""
        if self.looking:  # a captured mouse points at nothing
            return
        self.mouse = (x, y)
        self.backend.mouse_position(x, y)
        self.backend.mouse_button(button, True)
        self.travelled = 0.0
        if self.backend.wants_mouse:
            return
        session = self.actions.session
        if session.options.split != "off" and self.pointer is not None:
            self.actions.side = session.side_at(self.pointer[0])
        if button == RIGHT:
            self.actions.stop()
            self._capture(True)
        elif button == LEFT and self._on_divider(x):
            self.dividing = True
        elif button == LEFT:
            self.actions.stop()
            found = session.point_at(self.pointer) if self.pointer is not None else None
            self.pivot = found or session.free_camera.camera.target

    def on_mouse_release_event(self, x: int, y: int, button: int) -> None:
        """A mouse button went up."""
        self.backend.mouse_button(button, False)
        if button == RIGHT:
            self._capture(False)
        if button == LEFT:
            options = self.actions.session.options
            if self.pivot is not None and self.travelled <= _CLICK and options.inspect and self.pointer is not None:
                self.actions.session.hold(self.pointer)
            self.pivot, self.dividing = None, False

    def on_mouse_scroll_event(self, x_offset: float, y_offset: float) -> None:
        """The wheel turned."""
        session = self.actions.session
        if self.looking:
            session.free_camera.change_speed(y_offset)
            self.actions.say(f"speed {session.free_camera.speed:.3g} m/s", topic="speed")
        elif self.backend.wants_mouse:
            self.backend.scroll(x_offset, y_offset)
        else:
            self.actions.stop()
            session.free_camera.dolly(y_offset, session.point_at(self.pointer) if self.pointer is not None else None)

    def on_drop(self, paths: list[str]) -> None:
        """Files were dropped on the window: the first is opened."""
        if paths:
            self.actions.trying(lambda: self.actions.open(paths[0]))

    def on_focus(self, focused: bool) -> None:
        """The window gained or lost the keyboard: what is held then is let go of."""
        self.held.clear()
        self.pace, self.pivot, self.dividing = 1.0, None, False
        self.backend.focus(focused)
        if not focused:
            self._capture(False)

    def on_scale(self, scale: float) -> None:
        """The window is on a monitor of another scale."""
        self.backend.resize_scale(max(1.0, scale) / self.wnd.pixel_ratio)
