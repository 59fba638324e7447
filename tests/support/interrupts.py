"""Ctrl-C at a chosen line of irrsplat."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import irrsplat

CORE = str(Path(irrsplat.__file__).parent)


def run(act: Callable[[], object], interrupt_at: int | None = None) -> tuple[int, bool]:
    """Return the number of irrsplat's lines that `act` executes, and True if it raised KeyboardInterrupt.

    interrupt_at: the number of the line before which Ctrl-C occurs.
    """
    count, came_out = 0, False

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal count
        if not frame.f_code.co_filename.startswith(CORE):
            return None
        if event == "line":
            count += 1
            if count - 1 == interrupt_at:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        act()
    except KeyboardInterrupt:
        came_out = True
    finally:
        sys.settrace(before)
    return count, came_out
