"""Stack traces of crashed test processes: hooks of pytest and xdist, which reports only the test's name."""

from __future__ import annotations

import faulthandler
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

_FOLDER = "IRRSPLAT_TEST_STACKS"  # environment variable: folder of the traces of test processes
_held: list[Any] = []  # the folder and, in test processes, the file, kept open for the life of the process


@pytest.hookimpl(trylast=True)  # after pytest's own, which writes to the terminal alone
def pytest_configure(config: pytest.Config) -> None:
    """Let test processes write the trace of a crash to their own file."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is None:
        _held.append(folder := TemporaryDirectory())
        os.environ[_FOLDER] = folder.name
    elif _FOLDER in os.environ:
        _held.append(file := (Path(os.environ[_FOLDER]) / worker).open("w"))
        faulthandler.enable(file)


def pytest_handlecrashitem(report: Any) -> None:
    """Add the crash's trace to the test's report."""
    file = Path(os.environ[_FOLDER]) / report.node.gateway.id
    lines = file.read_text().splitlines() if file.is_file() else []
    where = "\n".join(line for line in lines if line.strip() and "site-packages" not in line)
    report.longrepr = f"{report.longrepr}\n{where or 'nothing is known of where'}"
