"""Opens the window: moderngl-window's glfw one, or one in memory that behaves the same."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import moderngl_window
from moderngl_window.context.base import BaseWindow

from irrsplat.core.errors import GLError
from irrsplat.gpu import context

TITLE = "irrsplat"
_NO_DISPLAY = (
    "no display to open a window on; irrsplat render draws without one, "
    "and xvfb-run -a irrsplat view opens it in memory (sudo apt-get install -y xvfb xauth)"
)


def open_window(size: tuple[int, int], headless: bool = False) -> BaseWindow:
    """A window with an OpenGL 3.3 context, current. headless: without a display, for tests; events are then made by calls.

    Raises GLError, one line, where there is no display or no OpenGL 3.3.
    """
    window = moderngl_window.get_local_window_cls("headless" if headless else "glfw")
    options: dict[str, Any] = {"backend": "egl"} if headless else {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # glfw says the same by a warning
            wnd = window(title=TITLE, size=size, gl_version=(3, 3), aspect_ratio=None, vsync=True, cursor=True, **options)
    except ValueError as error:  # moderngl-window's, of glfw
        raise GLError(_NO_DISPLAY if "initialize" in str(error) else f"{error}; irrsplat doctor says more") from None
    except Exception as error:  # a bare Exception is all that moderngl raises
        raise GLError(context.advice(" ".join(str(error).split()))) from None
    wnd.exit_key = wnd.fullscreen_key = None  # Esc never quits, and fullscreen is the viewer's own key
    if headless:
        from moderngl_window.context.glfw.keys import Keys

        wnd.keys = Keys  # the headless window has none of its own
    moderngl_window.activate_context(window=wnd)
    return wnd


class Desktop:
    """What moderngl-window leaves out of glfw: clipboard, dropped files, focus, the monitor's scale, waiting for events.

    On a headless window no events come, and the clipboard is `text`.
    """

    def __init__(self, wnd: BaseWindow) -> None:
        self.text = ""
        self._window = None if wnd.headless else wnd._window  # type: ignore[attr-defined]

    def copy(self, text: str) -> None:
        """Put text into the clipboard."""
        self.text = text
        if self._window is not None:
            import glfw

            glfw.set_clipboard_string(self._window, text)

    def listen(
        self, dropped: Callable[[list[str]], None], focused: Callable[[bool], None], scaled: Callable[[float], None]
    ) -> None:
        """Set what is called when files are dropped, the keyboard focus changes, or the monitor's scale does."""
        if self._window is None:
            return
        import glfw

        def drop(window: object, paths: Sequence[str]) -> None:
            dropped(list(paths))

        glfw.set_drop_callback(self._window, drop)  # type: ignore[arg-type]  # its stubs have C's signature
        glfw.set_window_focus_callback(self._window, lambda _, has: focused(bool(has)))
        glfw.set_window_content_scale_callback(self._window, lambda _, x, y: scaled(float(x)))

    @property
    def scale(self) -> float:
        """How much larger than on a plain monitor text and widgets are drawn, 1 or more."""
        if self._window is None:
            return 1.0
        import glfw

        return max(1.0, float(glfw.get_window_content_scale(self._window)[0]))

    def wait(self, seconds: float) -> None:
        """Sleep until the window gets an event, at most so many seconds."""
        if self._window is not None:
            import glfw

            glfw.wait_events_timeout(seconds)
