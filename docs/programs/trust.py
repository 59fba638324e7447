"""Run the commands of docs/about/trust.md: `python docs/programs/trust.py [-k TEXT] [--limit SECONDS]`.

For each row it prints the status, the seconds and peak memory of the command, and the lines of its output with numbers. `not
tried` marks a row whose command skips all tests on this machine, or is done by hand. The exit status is that of the worst row.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "about" / "trust.md"
LATE = 124  # the exit status of a command that took too long, as `timeout` has it
MOST_LINES = 8  # of what a command printed


class Row(NamedTuple):
    """A row: case, number of tries, result, last run, and the words and environment of its command (none by hand)."""

    tried: str
    often: str
    result: str
    last: str
    words: list[str]
    environment: Mapping[str, str]


def rows(text: str) -> list[Row]:
    """Return the rows of a page whose last column is a command."""
    found = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) != 5 or cells[4] == "command" or set(cells[4]) == {"-"}:
            continue
        words = shlex.split(cells[4].strip("`")) if cells[4].startswith("`") else []
        first = next((i for i, word in enumerate(words) if "=" not in word), 0)
        found.append(Row(*cells[:4], words[first:], dict(word.split("=", 1) for word in words[:first])))
    return found


def run(row: Row, limit: float) -> tuple[int, int, str]:
    """Execute a row's command; returns its exit status, the most bytes of memory it had, and what it printed."""
    program, *more = row.words
    command = [sys.executable if program == "python" else str(Path(sys.executable).with_name(program)), *more]
    if "pytest" in command:
        command += ["-q", "-rs", "-p", "no:cacheprovider"]
    with tempfile.TemporaryDirectory() as folder, open(Path(folder) / "printed", "w+b") as printed:
        environment = {**os.environ, **row.environment}
        place = ROOT if program == "python" else folder
        child = subprocess.Popen(
            command, cwd=place, env=environment, stdout=printed, stderr=subprocess.STDOUT, start_new_session=True
        )
        signal.signal(signal.SIGALRM, lambda *_: os.killpg(child.pid, signal.SIGKILL))
        signal.setitimer(signal.ITIMER_REAL, limit)
        try:
            _, status, used = os.wait4(child.pid, 0)
        except KeyboardInterrupt:
            os.killpg(child.pid, signal.SIGKILL)
            raise
        late = signal.setitimer(signal.ITIMER_REAL, 0.0)[0] == 0.0
        child.returncode = LATE if late else os.waitstatus_to_exitcode(status)
        printed.seek(0)
        return child.returncode, 1024 * used.ru_maxrss, printed.read().decode(errors="replace")


def verdict(status: int, printed: str) -> str:
    """Return the word for the result of a command."""
    if status:
        return "out of time" if status == LATE else "fails"
    skipped = re.search(r"\d+ skipped", printed)
    if skipped and not re.search(r"\d+ passed", printed):
        return "not tried"
    return f"holds, {skipped[0]}" if skipped else "holds"


def main() -> int:
    """Try the chosen rows; returns the exit status."""
    parser = argparse.ArgumentParser(description="Run the commands of docs/about/trust.md.")
    parser.add_argument("-k", metavar="TEXT", default="", help="run only rows with this text in the case or command")
    parser.add_argument(
        "--limit", metavar="SECONDS", type=float, default=3600.0, help="limit the time of each row (default: 3600)"
    )
    args = parser.parse_args()
    worst = 0
    for row in rows(PAGE.read_text(encoding="utf-8")):
        if args.k.lower() not in f"{row.tried} {shlex.join(row.words)}".lower():
            continue
        print(f"{row.tried}\n  stated: {row.often}: {row.result}\n  {row.last}", flush=True)
        if not row.words:
            print("  not tried: done by hand")
            continue
        begun = time.monotonic()
        status, memory, printed = run(row, args.limit)
        print(f"  {verdict(status, printed)}, {time.monotonic() - begun:.1f} s, {memory / 1e9:.2f} GB", flush=True)
        numbers = [line for line in printed.splitlines() if re.search(r"\d", line) and "[100%]" not in line]
        print(*(f"    {line.strip()[:160]}" for line in numbers[-MOST_LINES:]), sep="\n", flush=True)
        worst = max(worst, abs(status))
    return worst


if __name__ == "__main__":
    sys.exit(main())
