"""A virtual X11 display, and a source of drag and drop by Xlib: it drops files like a file manager (XDND, version 5)."""

from __future__ import annotations

import ctypes
import os
import select
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import c_char_p, c_int, c_long, c_uint, c_ulong, c_void_p
from pathlib import Path
from typing import Any

LIMIT = 180.0  # seconds for an answer; it decides no outcome
VERSION = 5
CLIENT_MESSAGE, SELECTION_REQUEST, SELECTION_NOTIFY = 33, 30, 31  # X.h
SIGNATURES: dict[str, tuple[object, list[object]]] = {  # of Xlib.h: result, arguments
    "XOpenDisplay": (c_void_p, [c_char_p]),
    "XDefaultRootWindow": (c_ulong, [c_void_p]),
    "XCreateSimpleWindow": (c_ulong, [c_void_p, c_ulong, c_int, c_int, c_uint, c_uint, c_uint, c_ulong, c_ulong]),
    "XInternAtom": (c_ulong, [c_void_p, c_char_p, c_int]),
    "XSetSelectionOwner": (c_int, [c_void_p, c_ulong, c_ulong, c_ulong]),
    "XSendEvent": (c_int, [c_void_p, c_ulong, c_int, c_long, c_void_p]),
    "XChangeProperty": (c_int, [c_void_p, c_ulong, c_ulong, c_ulong, c_int, c_int, c_char_p, c_int]),
    "XPending": (c_int, [c_void_p]),
    "XNextEvent": (c_int, [c_void_p, c_void_p]),
    "XFlush": (c_int, [c_void_p]),
    "XConnectionNumber": (c_int, [c_void_p]),
    "XCloseDisplay": (c_int, [c_void_p]),
}


def event_of(*fields: tuple[str, Any]) -> Any:
    """Return the structure of an event: the common first fields, then `fields`."""
    start = (("type", c_int), ("serial", c_ulong), ("send_event", c_int), ("display", c_void_p))
    return type("Event", (ctypes.Structure,), {"_fields_": (*start, *fields)})


SELECTION = tuple((name, c_ulong) for name in ("requestor", "selection", "target", "property", "time"))
Message = event_of(("window", c_ulong), ("kind", c_ulong), ("format", c_int), ("values", c_long * 5))  # XClientMessageEvent
Answer = event_of(*SELECTION)  # XSelectionEvent
Request = event_of(("owner", c_ulong), *SELECTION)  # XSelectionRequestEvent


class Event(ctypes.Union):
    """Union of X11 events."""

    _fields_ = (("type", c_int), ("message", Message), ("request", Request), ("answer", Answer), ("pad", c_long * 24))


@contextmanager
def display(size: tuple[int, int]) -> Iterator[None]:
    """Run a virtual screen of `size` (width, height) for new windows. A server that resets may refuse a client meanwhile."""
    reader, writer = os.pipe()
    words = ["Xvfb", "-noreset", "-displayfd", str(writer), "-screen", "0", f"{size[0]}x{size[1]}x24", "-nolisten", "tcp"]
    server = subprocess.Popen(words, pass_fds=[writer], stderr=subprocess.DEVNULL)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        number = pipe.readline().strip()
    assert number, "Xvfb did not start"
    os.environ["DISPLAY"] = f":{number}"
    os.environ.pop("WAYLAND_DISPLAY", None)
    try:
        yield
    finally:
        server.terminate()
        server.wait()


class DropSource:
    """Source of files for the window with the number `target` on the display in DISPLAY."""

    def __init__(self, target: int) -> None:
        self.x = ctypes.CDLL("libX11.so.6")
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(self.x, name)
            function.restype, function.argtypes = result, arguments
        self.target, self.display = target, self.x.XOpenDisplay(os.environ["DISPLAY"].encode())
        self.window = self.x.XCreateSimpleWindow(self.display, self.x.XDefaultRootWindow(self.display), 0, 0, 1, 1, 0, 0, 0)

    def atom(self, name: str) -> int:
        """Return the number of an atom."""
        return int(self.x.XInternAtom(self.display, name.encode(), 0))

    def drop(self, paths: Sequence[Path], at: tuple[int, int]) -> bool:
        """Drop `paths` at a point of the screen; return True if the target reports success."""
        uris = "".join(f"{path.as_uri()}\r\n" for path in paths).encode()
        self.x.XSetSelectionOwner(self.display, self.atom("XdndSelection"), self.window, 0)
        self._send("XdndEnter", VERSION << 24, self.atom("text/uri-list"), 0, 0)
        self._send("XdndPosition", 0, at[0] << 16 | at[1], 0, self.atom("XdndActionCopy"))
        self._wait("XdndStatus", b"")
        self._send("XdndDrop", 0, 0, 0, 0)
        return self._wait("XdndFinished", uris)[1] != 0

    def close(self) -> None:
        """Disconnect from the display."""
        self.x.XCloseDisplay(self.display)

    def _send(self, kind: str, *values: int) -> None:
        event, longs = Event(), (c_long * 5)(self.window, *values)
        event.message = Message(CLIENT_MESSAGE, 0, 1, self.display, self.target, self.atom(kind), 32, longs)
        self._out(self.target, event)

    def _out(self, window: int, event: Event) -> None:
        self.x.XSendEvent(self.display, window, 0, 0, ctypes.byref(event))
        self.x.XFlush(self.display)

    def _wait(self, kind: str, uris: bytes) -> list[int]:
        """Send the files on request until the target's message of this kind; return the message's values."""
        event, requested = Event(), self.atom(kind)
        while True:
            while self.x.XPending(self.display):
                self.x.XNextEvent(self.display, ctypes.byref(event))
                if event.type == CLIENT_MESSAGE and event.message.kind == requested:
                    return list(event.message.values)
                if event.type == SELECTION_REQUEST:
                    self._hand_out(event.request, uris)
            ready, _, _ = select.select([self.x.XConnectionNumber(self.display)], [], [], LIMIT)
            assert ready, f"no {kind} within {LIMIT:g} s"

    def _hand_out(self, asked: Any, uris: bytes) -> None:
        self.x.XChangeProperty(self.display, asked.requestor, asked.property, asked.target, 8, 0, uris, len(uris))
        answer = Event()
        fields = asked.requestor, asked.selection, asked.target, asked.property, asked.time
        answer.answer = Answer(SELECTION_NOTIFY, 0, 1, self.display, *fields)
        self._out(asked.requestor, answer)
