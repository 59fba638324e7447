"""The window: moderngl-window's glfw window, or a window in memory with equal behaviour. The memory of the program."""

from __future__ import annotations

import ctypes
import os
import signal
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import glfw
import moderngl_window
from moderngl_window.context.base import BaseWindow
from moderngl_window.context.glfw.keys import Keys

from irrsplat.app.viewer.preferences import LARGEST
from irrsplat.core.errors import GLError, InputError
from irrsplat.gpu import context

TITLE = "irrsplat"
_EVENTS = (  # glfw's names of events that may change the picture; `drop` and `window_size` are set separately
    *("key", "char", "cursor_pos", "mouse_button", "scroll", "cursor_enter", "window_focus"),
    *("window_iconify", "window_content_scale", "window_refresh", "window_close", "framebuffer_size"),
)
_FLOWING = ("cursor_pos", "scroll", "window_refresh")  # the events that come many times a second
_REPEAT = 2  # glfw's number of the repeat action of a pressed key
_MMAP_THRESHOLD, _LARGE = -3, 4 << 20  # glibc's number of the option; bytes of a large array, about one array of a small picture
_NOT_GLIBC = (AttributeError, OSError, TypeError)  # the errors of another C library, and of Windows
_NO_DISPLAY = (
    "no display to open a window on; irrsplat render draws without one, "
    "and xvfb-run -a irrsplat view opens it in memory (sudo apt-get install -y xvfb xauth)"
)


def open_window(size: tuple[int, int], headless: bool = False) -> BaseWindow:
    """Open a window with a current OpenGL 3.3 context. headless: True for a window without a display, for tests.

    Calls make the events of a headless window. Raises InputError for a size beyond LARGEST, and GLError with one line if there is
    no display or no OpenGL 3.3.
    """
    if max(size) > LARGEST:
        raise InputError(f"a window of {size[0]}x{size[1]} pixels cannot be; each side takes at most {LARGEST}")
    context.prepare()
    window = moderngl_window.get_local_window_cls("headless" if headless else "glfw")
    options: dict[str, Any] = {"backend": "egl"} if headless else {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # glfw repeats each error as a warning
            wnd = window(title=TITLE, size=size, gl_version=(3, 3), aspect_ratio=None, vsync=True, cursor=True, **options)
    except ValueError as error:  # moderngl-window raises it for errors of glfw
        raise GLError(_NO_DISPLAY if "initialize" in str(error) else f"{error}; details: irrsplat doctor") from None
    except Exception as error:  # moderngl raises bare Exceptions
        raise GLError(context.advice(" ".join(str(error).split()))) from None
    wnd.exit_key = None  # Esc never quits
    if headless:
        wnd.keys = Keys  # the headless window has no names of keys
    moderngl_window.activate_context(window=wnd)
    return wnd


class Desktop:
    """Functions that moderngl-window lacks: dropped files, focus, the monitor's scale and waiting for events.

    A headless window receives no events.
    """

    def __init__(self, wnd: BaseWindow) -> None:
        # the waiting events, oldest first: True if the event comes many times a second, and a call of its handler
        self._events: deque[tuple[bool, Callable[[], None]]] = deque()
        self._wnd, self._window = wnd, None if wnd.headless else wnd._window  # type: ignore[attr-defined]

    def listen(self, dropped: Callable[[list[str]], None], focused: Callable[[bool], None]) -> None:
        """Set the calls for dropped files and the keyboard focus, and keep every event until `take`.

        An event during a frame therefore does not change the inputs of this frame. Each callback that glfw returns is wrapped.
        glfw's own callback for dropped files raises an exception for a name that is not UTF-8, so that C's is set.
        """
        if self._window is None:
            return
        drop, library = self._keeping("drop", dropped), vars(glfw)  # its stubs lack the two names
        self._drop = library["_GLFWdropfun"](lambda _, count, names: drop([os.fsdecode(names[i]) for i in range(count)]))
        library["_glfw"].glfwSetDropCallback(self._window, self._drop)
        resized = self._wnd.glfw_window_resize_callback  # type: ignore[attr-defined]

        def resize(window: Any, *_: int) -> None:
            size: tuple[int, int] | None = None
            while size != (size := glfw.get_window_size(window)):  # `resized` reads the pixels: both sizes are of one time
                resized(window, *size)

        glfw.set_window_size_callback(self._window, self._keeping("window_size", resize))
        glfw.set_window_focus_callback(self._window, lambda _, has: focused(bool(has)))
        for kind in _EVENTS:
            set_callback = getattr(glfw, f"set_{kind}_callback")
            plain = set_callback(self._window, None)
            set_callback(self._window, self._keeping(kind, plain or (lambda *_: None)))

    @property
    def scale(self) -> float:
        """The monitor's scale of text and widgets, in window coordinates."""
        if self._window is None:
            return 1.0
        width, pixels = self._wnd.width, self._wnd.buffer_width  # glfw's own functions wait for the X server
        return max(1.0, float(glfw.get_window_content_scale(self._window)[0])) * max(width, 1) / max(pixels, 1)

    def wait(self, seconds: float) -> None:
        """Wait until the window gets an event, for at most `seconds`."""
        if self._window is not None and not self._events:
            glfw.wait_events_timeout(seconds)

    def _keeping(self, kind: str, call: Callable[..., None]) -> Callable[..., None]:
        """Return a callback that keeps its event. `take` then calls `call` with the event's values."""

        def keep(*values: Any) -> None:
            flows = kind in _FLOWING or (kind == "key" and values[3] == _REPEAT)
            self._events.append((flows, lambda: call(*values)))

        return keep

    def waits(self, flowing: bool) -> bool:
        """Return True if an event waits. flowing: True if flowing events count, such as the motions of a mouse."""
        if self._window is not None:
            glfw.poll_events()
        return any(flowing or not flows for flows, _ in self._events)

    def take(self) -> list[bool]:
        """Handle the first waiting event, and all directly following flowing events if it flows.

        Return a list with True for each handled event that flows. The interface needs a pass between events: only then does it
        decide if it takes the next click or key.
        """
        taken = list[bool]()
        while self._events and (not taken or (taken[-1] and self._events[0][0])):
            flows, handle = self._events.popleft()
            taken.append(flows)
            handle()
        return taken


@contextmanager
def signals(called: Callable[[], None]) -> Iterator[list[int]]:
    """Call `called` in this context for each signal to end: Ctrl-C (SIGINT), SIGTERM, or SIGHUP when the terminal closes.

    Yields the list of the received signals' numbers. Systems without SIGHUP skip it. Python may raise KeyboardInterrupt in a
    library's callback, which discards the exception; a call is not lost. A second Ctrl-C still raises KeyboardInterrupt. Signals
    that the program ignores from its start, for example under nohup, stay ignored.
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


def return_large_arrays() -> None:
    """Allocate each large array in pages of its own, which return to the system when the array is freed.

    Without this call, glibc raises the least size of an array with own pages at each free, up to 32 MB. Smaller arrays share a
    heap, which returns no memory below its last array.
    """
    with suppress(*_NOT_GLIBC):
        ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _LARGE)


def trim() -> None:
    """Return the free memory of the heap to the system, for example after a scene was closed."""
    with suppress(*_NOT_GLIBC):
        ctypes.CDLL(None).malloc_trim(0)
