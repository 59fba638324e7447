"""Mutation test: put each fault of mutants.py into a copy of the shaders, and run the test that must fail.

    python tests/trust/mutants/run.py [NAME …] [--list]

NAME: a part of a mutant's name; default: all. The tests run once without a fault, and must pass. Exit status: 0 if a test
detects each fault, 1 for an undetected fault, 2 for a wrong command line.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(REPOSITORY))
from tests.trust.mutants.mutants import MUTANTS, Mutant  # noqa: E402

INSIDE = ("app", "shaders", "scenes")  # folders next to irrsplat/ that install inside it
LIMIT = 600.0  # seconds of one test: a fault may make a loop endless
PASSED, FAILED = 0, 1  # pytest's exit statuses


def copy_source(folder: Path) -> None:
    """Copy the source to `folder` in the installed layout, with the tests next to it."""
    skip = shutil.ignore_patterns("__pycache__", ".*")
    for name in ("irrsplat", "tests", "docs"):
        shutil.copytree(REPOSITORY / name, folder / name, ignore=skip)
    for name in INSIDE:
        shutil.copytree(REPOSITORY / name, folder / "irrsplat" / name, ignore=skip)
    shutil.copy2(REPOSITORY / "pyproject.toml", folder)


def run_tests(folder: Path, tests: Sequence[str], limit: float | None = None) -> tuple[int | None, str]:
    """Return pytest's exit status for `tests` in the copy, None past the limit, and its output."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "", "-p", "no:cacheprovider", "--tb=line", *tests]
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return None, f"not done in {limit:g} s"
    return done.returncode, done.stdout + done.stderr


def found(mutant: Mutant, folder: Path) -> bool:
    """True if the mutant's test fails, as its only effect, with its fault in the copy; prints the verdict."""
    ((file, text),) = mutant.made(folder / "irrsplat/shaders")
    whole = file.read_text(encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    try:
        status, output = run_tests(folder, [mutant.test], LIMIT)
    finally:
        file.write_text(whole, encoding="utf-8")
    verdict = {PASSED: "NOT FOUND", FAILED: "found"}.get(-1 if status is None else status, output)
    print(f"{verdict:9} {mutant.name}", flush=True)
    return status == FAILED


def missed(mutants: Sequence[Mutant]) -> list[str]:
    """Return the names of undetected faults; raise RuntimeError if a test fails without a fault."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as root:
        folder = Path(root).resolve()
        copy_source(folder)
        status, output = run_tests(folder, sorted({mutant.test for mutant in mutants}))
        if status != PASSED:
            raise RuntimeError(f"the tests fail without a fault:\n{output}")
        return [mutant.name for mutant in mutants if not found(mutant, folder)]


def main() -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="a part of a mutant's name (default: all)")
    parser.add_argument("--list", action="store_true", help="print the table; run nothing")
    args = parser.parse_args()
    chosen = [mutant for mutant in MUTANTS if not args.names or any(name in mutant.name for name in args.names)]
    if not chosen:
        parser.error("no mutant has such a name")
    if args.list:
        print(*(f"{mutant.name}\n    {mutant.test}" for mutant in chosen), f"{len(chosen)} mutants", sep="\n")
        return 0
    not_found = missed(chosen)
    print(f"{len(chosen) - len(not_found)} of {len(chosen)} mutants found")
    return int(bool(not_found))


if __name__ == "__main__":
    sys.exit(main())
