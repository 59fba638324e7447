"""Opens the window: moderngl-window's glfw one, or one in memory that behaves the same."""

from __future__ import annotations

import signal
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import glfw
import moderngl_window
from moderngl_window.context.base import BaseWindow
from moderngl_window.context.glfw.keys import Keys

from irrsplat.core.errors import GLError, InputError
from irrsplat.gpu import context

TITLE = "irrsplat"
LARGEST = 16384  # pixels: a window's side; X takes 32767, and OpenGL's textures are seldom larger than this
_EVENTS = (  # glfw's names of events that may change the picture; `drop` has a callback of its own
    *("key", "char", "cursor_pos", "mouse_button", "scroll", "cursor_enter", "window_size", "window_focus"),
    *("window_iconify", "window_content_scale", "window_refresh", "window_close", "framebuffer_size"),
)
_FLOWING = ("cursor_pos", "scroll", "window_refresh")  # those that come many times a second
_REPEAT = 2  # glfw's number: a key that is held
_NO_DISPLAY = (
    "no display to open a window on; irrsplat render draws without one, "
    "and xvfb-run -a irrsplat view opens it in memory (sudo apt-get install -y xvfb xauth)"
)


def open_window(size: tuple[int, int], headless: bool = False) -> BaseWindow:
    """A window with an OpenGL 3.3 context, current. headless: without a display, for tests; events are then made by calls.

    Raises InputError for a size beyond LARGEST, GLError, one line, where there is no display or no OpenGL 3.3.
    """
    if max(size) > LARGEST:
        raise InputError(f"a window of {size[0]}x{size[1]} pixels cannot be; each side takes at most {LARGEST}")
    context.prepare()
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
        wnd.keys = Keys  # the headless window has none of its own
    moderngl_window.activate_context(window=wnd)
    return wnd


@dataclass(frozen=True)
class _Event:
    """An event that waits, of a kind of _EVENTS. flows: it comes many times a second. handle: does what the event is for."""

    kind: str
    flows: bool
    handle: Callable[[], None]


class Desktop:
    """Clipboard, dropped files, focus, the monitor's scale and waiting for events, which moderngl-window lacks.

    On a headless window no events come, and the clipboard is `text`.
    """

    def __init__(self, wnd: BaseWindow) -> None:
        self.text = ""
        self._events: deque[_Event] = deque()  # those that wait
        self._window = None if wnd.headless else wnd._window  # type: ignore[attr-defined]

    def copy(self, text: str) -> None:
        self.text = text
        if self._window is not None:
            glfw.set_clipboard_string(self._window, text)

    def listen(self, dropped: Callable[[list[str]], None], focused: Callable[[bool], None]) -> None:
        """Set the calls for dropped files and the keyboard focus, and keep every event until `take`.

        An event that comes while a frame is drawn changes nothing that the frame is drawn from. A callback is wrapped as glfw
        returns it. For dropped files glfw returns an adapter with another signature (C's).
        """
        if self._window is None:
            return
        drop = self._keeping("drop", lambda _, paths: dropped(list(paths)))
        glfw.set_drop_callback(self._window, drop)  # its stubs have C's signature
        glfw.set_window_focus_callback(self._window, lambda _, has: focused(bool(has)))
        for kind in _EVENTS:
            set_callback = getattr(glfw, f"set_{kind}_callback")
            plain = set_callback(self._window, None)
            set_callback(self._window, self._keeping(kind, plain or (lambda *_: None)))

    @property
    def scale(self) -> float:
        """The scale of text and widgets by the monitor, in window coordinates."""
        if self._window is None:
            return 1.0
        width, pixels = glfw.get_window_size(self._window)[0], glfw.get_framebuffer_size(self._window)[0]
        return max(1.0, float(glfw.get_window_content_scale(self._window)[0])) * max(width, 1) / max(pixels, 1)

    def wait(self, seconds: float) -> None:
        """Sleep until the window gets an event, at most so many seconds."""
        if self._window is not None and not self._events:
            glfw.wait_events_timeout(seconds)

    def _keeping(self, kind: str, call: Callable[..., None]) -> Callable[..., None]:
        """Return a callback that keeps its event, for `call` to be called by `take`."""

        def keep(*values: Any) -> None:
            flows = kind in _FLOWING or (kind == "key" and values[3] == _REPEAT)
            self._events.append(_Event(kind, flows, lambda: call(*values)))

        return keep

    def waits(self, flowing: bool) -> bool:
        """Return True if an event waits. flowing: events count that come many times a second, as those of a moving mouse."""
        if self._window is not None:
            glfw.poll_events()
        return any(flowing or not event.flows for event in self._events)

    def take(self) -> list[bool]:
        """Handle the first event that waits, and those after it as long as all of them flow. Return for each whether it flows.

        Whether a click or a key is for the interface depends on a pass of the interface after the events before.
        """
        taken = list[_Event]()
        while self._events and (not taken or (taken[-1].flows and self._events[0].flows)):
            taken.append(self._events.popleft())
            taken[-1].handle()
        return [event.flows for event in taken]


@contextmanager
def signals(called: Callable[[], None]) -> Iterator[list[int]]:
    """While this lasts, `called` is called where somebody asks the program to end: by Ctrl-C (SIGINT) or SIGTERM, or since its
    terminal is gone (SIGHUP, where there is that). Yields the numbers of the signals that came.

    Python raises KeyboardInterrupt anywhere, also in a library's callback, where it is lost; a call at least is heard. A second
    Ctrl-C raises it all the same. What the program was started to ignore, as by nohup, it ignores.
    """
    came: list[int] = []

    def take(number: int, _: object) -> None:
        if number == signal.SIGINT and number in came:
            raise KeyboardInterrupt
        came.append(number)
        called()

    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    heeded = [number for number in numbers if signal.getsignal(number) not in (None, signal.SIG_IGN)]
    before = {number: signal.signal(number, take) for number in heeded}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
