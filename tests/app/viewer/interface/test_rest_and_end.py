"""A viewer at rest sleeps and wakes at once; and however it is ended, what it holds is kept."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from irrsplat.app.viewer.messages import Messages
from irrsplat.app.viewer.window import signals
from tests.app.viewer.interface.test_window import TOOLS, display, hand, pytestmark, until  # noqa: F401
from tests.app.viewer.test_viewer_files import rewrite
from tests.support.viewing import ROOM, Driver, Tracer, write_room

FAST = ["--gather-size", "8", "--bounces", "1", "--viewer-quality", "0", "--viewer-samples", "0", "--radius-min", "5"]


@pytest.fixture
def sleeper(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> Driver:
    """The viewer at rest, a long time after the last event."""
    driver.actions.messages.lines.clear()
    driver.viewer._awake_until = 0.0
    driver.viewer.may_sleep()
    assert driver.viewer.may_sleep() and driver.viewer.may_sleep()
    return driver


def rises(driver: Driver) -> bool:
    """Whether it is awake, and asleep again after a frame."""
    return not driver.viewer.may_sleep()


@pytest.mark.parametrize("act", [
    lambda driver: driver.viewer.wake(), lambda driver: driver.actions.say("news"), lambda driver: driver.session.clear(),
    lambda driver: driver.down("W"), lambda driver: driver.session.free_camera.look(9.0, 0.0, 0.01),
], ids=["event", "message", "cache", "key", "camera"])  # fmt: skip
def test_what_changes_wakes_it(sleeper: Driver, act: Callable[[Driver], Any]) -> None:
    act(sleeper)
    if sleeper.session.path_recorder.playing is None:
        sleeper.session.tick(0.05, 0.05)
    assert rises(sleeper)


def test_a_changed_file_wakes_it(sleeper: Driver) -> None:
    room = Path(sleeper.actions.source)
    rewrite(sleeper, room, ROOM.replace("0.7 0.1 0.1", "0.1 0.7 0.1"))
    assert rises(sleeper) and "read again" in sleeper.said
    write_room(room.parent)
    with sleeper.wnd.ctx:
        sleeper.actions.open(str(room))


def test_a_traced_truth_wakes_it(sleeper: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = Tracer(monkeypatch)
    sleeper.actions.trace()
    sleeper.actions.messages.lines.clear()
    assert rises(sleeper)
    until(sleeper.viewer.may_sleep, "rest while nothing is traced")
    tracer.go.set()
    until(lambda: sleeper.session.truths.traced is None or rises(sleeper), "the truth")
    until(lambda: "is traced" in sleeper.said or sleeper.viewer.may_sleep(), "what is said of it")
    assert "is traced" in sleeper.said


def test_a_message_rests_fades_and_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four seconds as it is, one in which it fades; an error stays. All stay in the log."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    messages = Messages()
    messages.say("kept")
    messages.say("wrong", error=True)
    assert messages.rests == pytest.approx(4.0)
    now[0] = 104.5
    (kept, wrong) = messages.lines
    assert messages.rests == 0.0 and kept.opacity(now[0]) == pytest.approx(0.5) and wrong.opacity(now[0]) == 1.0
    before = messages.version
    now[0] = 105.1
    messages.expire()
    assert messages.lines == [wrong] and messages.version != before and messages.rests == float("inf")
    assert [message.text for _, message in messages.log] == ["kept", "wrong"]


def test_steps_of_one_thing_are_one_line_of_the_log() -> None:
    messages = Messages()
    for stops in range(5):
        messages.say(f"exposure {stops}", topic="exposure")
    messages.say("other")
    for _ in range(300):
        messages.say("more")
    assert len(messages.log) == 200
    first = Messages()
    for stops in range(5):
        first.say(f"exposure {stops}", topic="exposure")
    assert [message.text for _, message in first.log] == ["exposure 4"]


def test_signals_are_taken_while_it_lasts_and_no_longer() -> None:
    called: list[int] = []
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whatever started the tests
    before = [signal.getsignal(number) for number in numbers]
    with signals(lambda: called.append(1)) as came:
        for number in numbers:
            os.kill(os.getpid(), number)
            time.sleep(0.01)
        with pytest.raises(KeyboardInterrupt):  # the second one ends whatever is under way
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
    assert called == [1, 1, 1] and came == list(numbers)
    assert [signal.getsignal(number) for number in numbers] == before


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup leaves it
    try:
        with signals(lambda: pytest.fail("called")) as came:
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(0.01)
        assert came == [] and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def seconds_of(process: int) -> float:
    """The processor time that a process has taken, all its threads together."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def calm(process: int) -> bool:
    before = seconds_of(process)
    time.sleep(1.0)
    return seconds_of(process) - before < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM])  # test_signals_are_taken_while_it_lasts has the other
def test_at_rest_it_sleeps_and_ended_from_outside_it_keeps_the_cache(display: str, tmp_path: Path, number: int) -> None:  # noqa: F811
    """Less than a fiftieth of a core over three seconds; a click opens a menu all the same; then all is saved."""
    environment = {**os.environ, "IRRSPLAT_CONFIG": str(tmp_path / "config")}
    command = [sys.executable, "-m", "irrsplat", "view", "cornell", "--size", "320", "240", "--cache", "kept.cache", *FAST]
    viewer = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        until(lambda: hand("search", "--onlyvisible", "--name", "cornell – irrsplat"), "the window")
        until(lambda: calm(viewer.pid), "rest")
        before = seconds_of(viewer.pid)
        time.sleep(3.0)
        assert seconds_of(viewer.pid) - before < 0.02 * 3.0
        awake = seconds_of(viewer.pid)
        hand("mousemove", 100, 100)
        hand("mousemove", 120, 120)
        time.sleep(0.5)
        assert seconds_of(viewer.pid) > awake + 0.02, "it draws again"
        viewer.send_signal(number)
        until(lambda: viewer.poll() is not None, "the end")
        assert viewer.returncode == 0 and viewer.stderr is not None and viewer.stderr.read() == ""
        assert (tmp_path / "kept.cache").stat().st_size > 1000 and (tmp_path / "config" / "viewer.json").is_file()
    finally:
        viewer.kill()
        viewer.wait()
