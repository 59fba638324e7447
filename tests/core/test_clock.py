"""The clocks: the wall clock, one that counts rays, and no test that reads another one."""

from __future__ import annotations

import re
from concurrent.futures import Future
from pathlib import Path

from irrsplat.core.timing import clock
from irrsplat.core.timing.clock import Clock, use_clock
from tests.support.counted_clock import RayClock

TESTS = Path(__file__).resolve().parents[1]
READS_TIME = re.compile(r"\btime\.(?:sleep|perf_counter|monotonic|process_time)\b|^\s*from time import", re.M)
ALLOWED = {
    "app/viewer/interface/test_window.py",  # a limit of safety for a real window
    "reference/make.py",  # a program that reports seconds
    "trust/harm.py",  # a signal at a random moment; every outcome is judged alike
}


def test_the_wall_clock_goes_on_and_waits_for_what_is_done() -> None:
    done, open_end = Future[int](), Future[int]()
    done.set_result(1)
    with use_clock(Clock()):
        first = clock.now()
        clock.traced(1e9)
        assert clock.wait_for([done], 0.0) and not clock.wait_for([done, open_end], -1.0)
        assert clock.now() >= first


def test_a_clock_of_rays_goes_on_by_rays_alone_and_ends_with_its_block() -> None:
    with use_clock(RayClock(100.0)):
        assert clock.now() == clock.now() == 0.0
        clock.traced(50.0)
        assert clock.now() == 0.5
        with use_clock(RayClock(1.0)):
            clock.traced(50.0)
            assert clock.now() == 50.0
        assert clock.now() == 0.5


def test_no_test_reads_the_machine_s_clock() -> None:
    files = {str(path.relative_to(TESTS)): path.read_text(encoding="utf-8") for path in TESTS.rglob("*.py")}
    found = {name for name, text in files.items() if READS_TIME.search(text)}
    assert not found - ALLOWED and len(files) > 100, "use the fixture `clock`, events and joins"
