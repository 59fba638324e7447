"""Background work next to a generator: its result, its errors and its end."""

from __future__ import annotations

import os
from pathlib import Path
from threading import Event

import pytest

from irrsplat.core.timing import other_process
from irrsplat.core.timing.background import _AT_ONCE, in_background
from irrsplat.core.timing.clock import Clock, use_clock
from irrsplat.core.timing.other_process import Calling, call
from irrsplat.gpu.time_budget import Budget

last = Budget(None).advance  # returns the result of a generator


def test_the_result_and_the_error_of_work() -> None:
    assert last(in_background(lambda: 6 * 7)) == 42
    with pytest.raises(ZeroDivisionError):
        last(in_background(lambda: 1 // 0))


def test_dropped_work_that_has_not_begun_never_begins() -> None:
    """All threads that may work hold until an event is set; by the wall clock, a step ends without them."""
    go_on, begun, held = Event(), [], [Event() for _ in range(_AT_ONCE)]

    def hold(begins: Event) -> bool:
        begins.set()
        return go_on.wait(120)

    with use_clock(Clock()):
        first = [in_background(lambda begins=begins: hold(begins)) for begins in held]  # type: ignore[misc]
        for work, begins in zip(first, held, strict=True):
            next(work)
            assert begins.wait(120)
        second = in_background(lambda: begun.append(True))
        next(second)
        second.close()
        go_on.set()
        assert [last(work) for work in first] == [True, True] and last(in_background(lambda: 1)) == 1 and not begun


class _Changing:
    """An argument that another thread changes while it is pickled for the first time."""

    pickled = 0

    def __reduce__(self) -> tuple[type[int], tuple[int]]:
        _Changing.pickled += 1
        if _Changing.pickled == 1:
            raise RuntimeError("dictionary changed size during iteration")
        return int, (7,)


def test_arguments_that_change_meanwhile_are_pickled_again() -> None:
    code = "from irrsplat.core.timing.other_process import serve; serve(lambda value, report: value + 1)"
    assert call(code, (_Changing(),)) == 8 and _Changing.pickled == 2


def test_a_stopped_call_ends_its_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process writes its number, and would then wait for ever without a result."""
    monkeypatch.setattr(other_process, "_JOIN", None)  # without a limit: load may delay the end
    pipe = tmp_path / "pid"
    os.mkfifo(pipe)
    code = f"import os, threading; open({str(pipe)!r}, 'w').write(str(os.getpid())); threading.Event().wait()"
    calling = Calling(code, (), "failed ({why})")
    pid = int(pipe.read_text())
    os.kill(pid, 0)
    calling.release()
    assert not calling.is_alive() and calling.error is None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
