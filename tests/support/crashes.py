"""A test process that ends without a word: its test is run again, once, and where it ended is told. Hooks of pytest and xdist.

Of some twenty whole runs on Mesa's llvmpipe three lost a process, each in another test, once by an abort within Mesa's draw. None
of these tests ever failed alone; valgrind found nothing in the last one, nor did malloc's checks in a whole run. A test that ends
its process twice fails.
"""

from __future__ import annotations

import faulthandler
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

_FOLDER = "IRRSPLAT_TEST_STACKS"  # environment variable: where test processes write where they ended
_ended: dict[str, str] = {}  # test -> what is known of where its process ended
_held: list[Any] = []  # the folder, and in test processes the file, as long as the process lives


@pytest.hookimpl(trylast=True)  # after pytest's own, which writes to the terminal alone
def pytest_configure(config: pytest.Config) -> None:
    """Have test processes write where they end to a file of their own."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is None:
        _held.append(folder := TemporaryDirectory())
        os.environ[_FOLDER] = folder.name
    elif _FOLDER in os.environ:
        _held.append(file := (Path(os.environ[_FOLDER]) / worker).open("w"))
        faulthandler.enable(file)


def pytest_handlecrashitem(crashitem: str, report: Any, sched: Any) -> None:
    """Run the test again where its process ended for the first time."""
    file = Path(os.environ[_FOLDER]) / report.node.gateway.id
    lines = file.read_text().splitlines() if file.is_file() else []
    where = "\n".join(line for line in lines if line.strip() and "site-packages" not in line) or "nothing is known of where"
    if crashitem in _ended:
        report.longrepr = f"{report.longrepr}, for the second time\n{where}"
        return
    _ended[crashitem] = where
    report.outcome = "rerun"
    sched.mark_test_pending(crashitem)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Tell which processes ended."""
    for test, where in _ended.items():
        terminalreporter.section("a test process ended, and its test was run again")
        terminalreporter.line(f"{test}\n{where}")
