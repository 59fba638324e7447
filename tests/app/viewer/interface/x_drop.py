"""A source of drag and drop on X11: it drops files on a window as a file manager does (XDND, version 5)."""

from __future__ import annotations

import select
from collections.abc import Sequence
from pathlib import Path

from Xlib import X
from Xlib.display import Display
from Xlib.protocol import event, request
from Xlib.xobject.drawable import Window

LIMIT = 180.0  # seconds for an answer; it decides no outcome
VERSION = 5


class DropSource:
    """Drops files on the window of the number `target` on the display in DISPLAY."""

    def __init__(self, target: int) -> None:
        self.display = Display()
        self.target = self.display.create_resource_object("window", target)
        root = self.display.screen().root
        self.window: Window = root.create_window(0, 0, 1, 1, 0, X.CopyFromParent)

    def atom(self, name: str) -> int:
        """Return the number of an atom."""
        return int(self.display.intern_atom(name))

    def drop(self, paths: Sequence[Path], at: tuple[int, int]) -> bool:
        """Drop `paths` at a point of the screen. Return True if the target reports success."""
        uris = "".join(f"{path.as_uri()}\r\n" for path in paths).encode()
        self.window.set_selection_owner(self.atom("XdndSelection"), X.CurrentTime)
        self._send("XdndEnter", VERSION << 24, self.atom("text/uri-list"), 0, 0)
        self._send("XdndPosition", 0, at[0] << 16 | at[1], X.CurrentTime, self.atom("XdndActionCopy"))
        self._wait("XdndStatus", b"")
        self._send("XdndDrop", 0, X.CurrentTime, 0, 0)
        return self._wait("XdndFinished", uris)[1] != 0

    def close(self) -> None:
        """Disconnect from the display."""
        self.display.close()

    def _send(self, kind: str, *values: int) -> None:
        data = (32, [self.window.id, *values])
        self.target.send_event(event.ClientMessage(window=self.target, client_type=self.atom(kind), data=data))
        self.display.flush()

    def _wait(self, kind: str, uris: bytes) -> list[int]:
        """Return the values of the target's message of this kind; until then, hand out the files where they are requested."""
        while True:
            while self.display.pending_events():
                got = self.display.next_event()
                if got.type == X.ClientMessage and got.client_type == self.atom(kind):
                    return list(got.data[1])
                if got.type == X.SelectionRequest:
                    self._hand_out(got, uris)
            ready, _, _ = select.select([self.display], [], [], LIMIT)
            assert ready, f"no {kind} within {LIMIT:g} s"

    def _hand_out(self, asked: request.Request, uris: bytes) -> None:
        asked.requestor.change_property(asked.property, asked.target, 8, uris)
        asked.requestor.send_event(
            event.SelectionNotify(
                time=asked.time,
                requestor=asked.requestor,
                selection=asked.selection,
                target=asked.target,
                property=asked.property,
            )
        )
        self.display.flush()
