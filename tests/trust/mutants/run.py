"""Proves that the tests find faults: puts each fault of mutants.py into a copy of the source, and runs the tests that must fail.

    python tests/trust/mutants/run.py [NAME …] [--list] [--jobs N]

NAME: a mutant's name, or a part of it; default: all. The copy is laid out as the package is installed: app, shaders and scenes
inside irrsplat/. First the tests run without a fault, and must pass. Exit status: 0 if each mutant is found; 1 if one is not, or
its old text does not occur exactly once in its file, or there is no such test; 2 for a wrong command line.
"""

from __future__ import annotations

import argparse
import compileall
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import cache_from_source
from pathlib import Path
from queue import SimpleQueue

from mutants import MUTANTS, Mutant

REPOSITORY = Path(__file__).resolve().parents[3]
INSIDE = ("app", "shaders", "scenes")  # folders beside irrsplat/ that install inside it
BESIDE = ("tests", "docs", "README.md", "pyproject.toml")  # what the tests read from where they are
TIME_LIMIT = 300.0  # seconds for the tests of one mutant: a fault may make a loop endless
PASSED, FAILED = 0, 1  # pytest's exit statuses; every other one is an error of the run itself
FOREIGN = 99  # the checker's own: the source under test is not that of the copy

# A pytest plugin in the copy. An editable install of the repository must not stand in for the copy, so it looks where the modules
# and the bundled folders of the run come from, the mutated file's above all.
CHECKER = '''
import importlib.util
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


def foreign(mutated):
    """What of irrsplat this run takes from outside the copy."""
    from irrsplat.core import paths

    places = [Path(m.__file__) for name, m in sys.modules.items() if name.split(".")[0] == "irrsplat" and m.__file__]
    places += [paths.folder("shaders"), paths.folder("scenes")]
    if mutated.endswith(".py"):
        name = mutated.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        places.append(Path(importlib.util.find_spec(name).origin))
    return [str(place) for place in places if not place.resolve().is_relative_to(HERE / "irrsplat")]


def pytest_addoption(parser):
    parser.addoption("--mutated", default="")


def pytest_sessionstart(session):
    if found := foreign(session.config.getoption("--mutated")):
        pytest.exit(f"not from the copy: {found}", returncode=99)


def pytest_sessionfinish(session, exitstatus):
    if found := foreign(""):
        pytest.exit(f"not from the copy: {found}", returncode=99)
'''


@dataclass(frozen=True)
class Outcome:
    """What came of one pytest run: its exit status (None: it ran past the time limit), its seconds, and its output."""

    status: int | None
    seconds: float
    output: str

    @property
    def failed_test(self) -> str:
        """The first test that failed, as pytest's summary names it; else its last line."""
        lines = [line for line in self.output.splitlines() if line.strip()] or [""]
        marked = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
        return (marked or lines[-1:])[0].partition(" - ")[0].removeprefix("FAILED ")


def installed(file: str) -> str:
    """Where a file of the repository lies in the copy."""
    return f"irrsplat/{file}" if file.split("/")[0] in INSIDE else file


def copy_source(folder: Path) -> None:
    """Lay the source out in `folder` as it is installed, with the tests beside it, and compile it."""
    leave_out = shutil.ignore_patterns("__pycache__", "*.pyc", ".*")
    shutil.copytree(REPOSITORY / "irrsplat", folder / "irrsplat", ignore=leave_out)
    for name in INSIDE:
        shutil.copytree(REPOSITORY / name, folder / "irrsplat" / name, ignore=leave_out)
    for name in BESIDE:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=leave_out)
        elif source.exists():
            shutil.copy2(source, folder / name)
    (folder / "mutant_checker.py").write_text(CHECKER, encoding="utf-8")
    compileall.compile_dir(folder, quiet=2)


def run_tests(folder: Path, tests: Sequence[str], mutated: str = "", limit: float | None = TIME_LIMIT) -> Outcome:
    """The outcome of `tests` in the copy in `folder`; mutated: the file in it that has a fault."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "mutant_checker"]
    command += ["--import-mode=importlib", "--tb=line", f"--mutated={mutated}", *tests]
    # nothing is compiled into the copy: a file that is changed within a second would be taken for the one before
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    start = time.perf_counter()
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Outcome(None, time.perf_counter() - start, f"ran longer than {limit:g} s")
    return Outcome(done.returncode, time.perf_counter() - start, done.stdout)


@contextmanager
def mutation(folder: Path, mutant: Mutant) -> Iterator[str]:
    """Has the mutant's fault in the copy in `folder` meanwhile; gives the path of the file there."""
    place = installed(mutant.file)
    file = folder / place
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".py":
        Path(cache_from_source(str(file))).unlink(missing_ok=True)
    file.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
    try:
        yield place
    finally:
        file.write_text(text, encoding="utf-8")


def mistakes(mutants: Sequence[Mutant]) -> list[str]:
    """What is wrong with the table, a line each: an old text that is not there exactly once, two of one name, a missing test."""
    found = []
    names = [mutant.name for mutant in mutants]
    for mutant in mutants:
        file = REPOSITORY / mutant.file
        times = file.read_text(encoding="utf-8").count(mutant.old) if file.is_file() else 0
        if times != 1:
            found.append(f"{mutant.name}: its old text occurs {times} times in {mutant.file}, not once")
        if mutant.old == mutant.new:
            found.append(f"{mutant.name}: it changes nothing")
        if names.count(mutant.name) > 1:
            found.append(f"{mutant.name}: this name is given twice")
    command = [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider", *tests_of(mutants)]
    collected = subprocess.run(command, cwd=REPOSITORY, text=True, capture_output=True, check=False)
    return found + [line for line in collected.stderr.splitlines() if line.startswith("ERROR")]


def tests_of(mutants: Sequence[Mutant]) -> list[str]:
    """The tests that the mutants name, each once."""
    return list(dict.fromkeys(test for mutant in mutants for test in mutant.tests))


def judge(mutant: Mutant, copies: SimpleQueue[Path]) -> bool:
    """Whether the mutant's tests find it, in one of the free `copies`; prints the answer."""
    folder = copies.get()
    try:
        with mutation(folder, mutant) as place:
            outcome = run_tests(folder, mutant.tests, place)
    finally:
        copies.put(folder)
    found = outcome.status == FAILED
    verdict = "found" if found else "NOT FOUND" if outcome.status == PASSED else f"NOT JUDGED (pytest's status {outcome.status})"
    print(f"{verdict:9} {outcome.seconds:6.1f} s  {mutant.name}  [{outcome.failed_test}]", flush=True)
    return found


def prove(mutants: Sequence[Mutant], jobs: int) -> bool:
    """Whether the tests pass without a fault, and each mutant is found; prints one line for each."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as root:
        copies: SimpleQueue[Path] = SimpleQueue()
        folders = [Path(root).resolve() / str(i) for i in range(jobs)]
        for folder in folders:
            copy_source(folder)
            copies.put(folder)
        clean = run_tests(folders[0], tests_of(mutants), limit=None)
        print(f"{'passed' if clean.status == PASSED else 'FAILED':9} {clean.seconds:6.1f} s  without a fault", flush=True)
        if clean.status != PASSED:
            print(clean.output)
            return False
        start = time.perf_counter()
        with ThreadPoolExecutor(jobs) as pool:
            found = list(pool.map(lambda mutant: judge(mutant, copies), mutants))
    print(f"{sum(found)} of {len(found)} mutants found in {time.perf_counter() - start:.0f} s")
    return all(found)


def main() -> int:
    """Run the command line; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="a mutant's name, or a part of it (default: all)")
    parser.add_argument("--list", action="store_true", help="check the table and print it; run nothing")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="so many mutants at a time (default: 1)")
    args = parser.parse_args()
    chosen = [mutant for mutant in MUTANTS if not args.names or any(name in mutant.name for name in args.names)]
    if not chosen or args.jobs < 1:
        parser.error("no mutant has such a name" if not chosen else "--jobs takes 1 or more")
    wrong = mistakes(chosen)
    for line in wrong:
        print(line, file=sys.stderr)
    if wrong:
        return 1
    if args.list:
        for mutant in chosen:
            print(f"{mutant.name}\n    {mutant.file}\n    {' '.join(mutant.tests)}")
        print(f"{len(chosen)} mutants")
        return 0
    return 0 if prove(chosen, args.jobs) else 1


if __name__ == "__main__":
    sys.exit(main())
