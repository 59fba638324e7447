"""Where a test process ended that ended without a word: hooks of pytest and xdist, which itself tells no more than the test."""

from __future__ import annotations

import faulthandler
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

_FOLDER = "IRRSPLAT_TEST_STACKS"  # environment variable: where test processes write where they ended
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


def pytest_handlecrashitem(report: Any) -> None:
    """Say where the process of this test ended."""
    file = Path(os.environ[_FOLDER]) / report.node.gateway.id
    lines = file.read_text().splitlines() if file.is_file() else []
    where = "\n".join(line for line in lines if line.strip() and "site-packages" not in line)
    report.longrepr = f"{report.longrepr}\n{where or 'nothing is known of where'}"
