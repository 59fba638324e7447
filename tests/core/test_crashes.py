"""A test that ends its process is run again, once, and never counts as passed if it does so again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TESTS = """
import os
from pathlib import Path

BEFORE = Path(__file__).with_name("before")

def test_that_ends_its_process_once():
    if not BEFORE.exists():
        BEFORE.touch()
        os.abort()

def test_that_always_does():
    os.abort()

def test_beside_them():
    pass
"""


def test_a_test_that_ends_its_process_is_run_again_once(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(
        "from tests.support.crashes import pytest_configure, pytest_handlecrashitem, pytest_terminal_summary\n"
    )
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
    assert done.returncode == 1 and "1 failed, 2 passed, 2 rerun" in said, said + done.stderr
    assert "test_that_always_does" in said.split("FAILED ")[1] and "FAILED" not in said.split("FAILED ")[1]
    assert said.count("a test process ended, and its test was run again") == 2
    assert said.count("Fatal Python error: Aborted") >= 2 and "in test_that_ends_its_process_once" in said
