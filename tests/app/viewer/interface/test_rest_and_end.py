"""A viewer without work sleeps until an event; messages expire; signals end the viewer."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import irrsplat
from irrsplat.app.viewer import preferences, viewer
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.window import Desktop, open_window, signals
from tests.support.counted_clock import CountedClock
from tests.support.viewing import FAST, Driver, Tracer, write_room


def sleeps(driver: Driver, clock: CountedClock) -> bool:
    """True if the viewer renders no frame of the converged view after a minute without an event."""
    driver.settle()
    driver.actions.messages.lines.clear()
    clock.advance(60.0)
    driver.viewer.may_sleep()
    return driver.viewer.may_sleep() and driver.viewer.may_sleep()


def test_what_changes_wakes_it(driver: Driver, clock: CountedClock) -> None:
    """An event, a message, a key, a turn of the camera and a cleared cache wake the viewer."""
    driver.resize((96, 64))
    acts: dict[str, Callable[[], Any]] = {
        "event": driver.viewer.wake,
        "message": lambda: driver.actions.say("news"),
        "key": lambda: driver.down("W"),
        "camera": lambda: driver.session.free_camera.turn(0.09, 0.0),
        "cache": driver.actions.clear,
    }
    for name, act in acts.items():
        assert sleeps(driver, clock), name
        act()
        if name in ("camera", "cache"):
            driver.session.tick(0.05, 0.05)
        assert not driver.viewer.may_sleep(), name
        driver.up("W")


def test_at_rest_it_waits_for_events_and_sigterm_keeps_cache_and_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SIGTERM during the wait after a frame without work ends the viewer, with cache, flight and preferences saved."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    end = viewer.Viewer.end
    monkeypatch.setattr(viewer.Viewer, "end", lambda self: (self.actions.record(), end(self)))  # it begins the recording
    monkeypatch.setattr(viewer, "open_window", lambda size: open_window(size, headless=True))
    monkeypatch.setattr(Desktop, "wait", lambda desktop, seconds: signal.raise_signal(signal.SIGTERM))
    room, kept = write_room(tmp_path), tmp_path / "kept.cache"
    assert viewer.run(irrsplat.load(room), str(room), (64, 48), Preferences(), values=FAST, cache=str(kept)) is None
    assert kept.stat().st_size > 1000 and preferences.load()[0].size == (64, 48)
    assert len(list(tmp_path.glob("flight-room-*.path"))) == 1


def test_a_traced_truth_wakes_it(driver: Driver, clock: CountedClock, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = Tracer(monkeypatch)
    driver.actions.trace()
    tracer.begin(driver)
    assert sleeps(driver, clock), "while the tracer works"
    tracer.finish(driver)
    assert not driver.viewer.may_sleep() and "is traced" in driver.said


def test_a_notice_stays_until_the_first_picture_and_five_seconds_more(driver: Driver, clock: CountedClock) -> None:
    """An error stays. A message replaces the earlier one of its topic."""
    driver.actions.open(driver.actions.source)
    driver.actions.say("wrong", error=True)
    for stops in range(5):
        driver.actions.say(f"exposure {stops}", topic="exposure")
    for seconds, left in ((30.0, "wrong\nexposure 4"), (4.5, "wrong\nexposure 4"), (0.6, "wrong")):
        clock.advance(seconds)
        driver.frame()
        assert driver.said == left
    assert driver.actions.messages.rests == float("inf")


def test_signals_are_taken_while_it_lasts_and_no_longer() -> None:
    """The first signal requests the end; a second Ctrl-C raises KeyboardInterrupt. Earlier handlers are restored."""
    called: list[int] = []
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = [signal.getsignal(number) for number in numbers]
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        with signals(lambda: called.append(1)) as came:
            for number in numbers:
                signal.raise_signal(number)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert called == [1, 1, 1] and came == list(numbers)
        assert [signal.getsignal(number) for number in numbers] == [*before[:2], signal.SIG_DFL]
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup leaves it
        with signals(lambda: called.append(1)):
            signal.raise_signal(signal.SIGHUP)
        assert len(called) == 3 and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before[2])
