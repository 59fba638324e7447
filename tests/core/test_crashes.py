"""A test that ends its process fails, and it is told where that was."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TESTS = """
import os

def test_that_ends_its_process():
    os.abort()

def test_that_is_killed():
    os.kill(os.getpid(), 9)

def test_beside_them():
    pass
"""


def test_it_is_told_where_a_test_process_ended(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text("from tests.support.crashes import pytest_configure, pytest_handlecrashitem\n")
    (tmp_path / "test_some.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-n", "2", "--dist", "worksteal", "-p", "no:cacheprovider", str(tmp_path)]
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    done = subprocess.run(
        command,
        env={**env, "PYTHONPATH": str(Path(__file__).parents[2])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    said = done.stdout
    assert done.returncode == 1 and "2 failed, 1 passed" in said, said + done.stderr
    assert "Fatal Python error: Aborted" in said and "in test_that_ends_its_process" in said
    assert "nothing is known of where" in said, "of one that was killed"
