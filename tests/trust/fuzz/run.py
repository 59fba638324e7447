"""The long fuzzing of all readers.

    python -m tests.trust.fuzz.run [READER …] [--cases N] [--coverage] [--seed N] [--found FOLDER]

READER: names, default all. --cases: of each reader, default 100 000. --coverage: atheris instead of hypothesis (pip install
atheris): it changes bytes, and keeps what reaches new code. --found: a folder in which inputs are kept that broke a reader, one
for each place where it broke. Prints a line for each reader: cases, how many were read and refused, and faults. Exit status: 1
where there is a fault.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

SLOW = 5.0  # CPU seconds of one case: more is a fault


class Tally:
    """What came of the cases so far; what breaks a reader is kept, once for each place."""

    def __init__(self, name: str, found: Path | None) -> None:
        self.name, self.found = name, found
        self.counts: Counter[str] = Counter()
        self.places: dict[str, str] = {}

    def feed(self, data: bytes) -> None:
        """Feed the reader, and count."""
        from tests.trust.fuzz.readers import judge

        start = time.process_time()
        try:
            self.counts[judge(self.name, data)] += 1
        except (Exception, RecursionError) as error:
            frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "fuzz" not in frame.filename]
            last = frames[-1] if frames else traceback.extract_tb(error.__traceback__)[-1]
            ours = [frame for frame in frames if "irrsplat" in frame.filename or "/app/" in frame.filename] or [last]
            self._keep(f"{type(error).__name__} {ours[-1].filename}:{ours[-1].lineno}", str(error)[:120], data)
        if time.process_time() - start > SLOW:
            self._keep("slow", f"{time.process_time() - start:.1f} s", data)

    def _keep(self, place: str, what: str, data: bytes) -> None:
        self.counts["faults"] += 1
        if place not in self.places:
            self.places[place] = what
            print(f"{self.name}: {place}: {what}", flush=True)
            if self.found is not None:
                self.found.mkdir(parents=True, exist_ok=True)
                (self.found / f"{self.name}-{hashlib.sha1(data).hexdigest()[:10]}").write_bytes(data)

    def line(self, seconds: float) -> str:
        """The result."""
        cases = sum(self.counts.values())
        return f"{self.name}: {cases} cases, {dict(self.counts)}, {len(self.places)} places, {seconds:.0f} CPU s"


def structured(name: str, cases: int, seed: int, tally: Tally) -> None:
    """Feed a reader with hypothesis' inputs."""
    import hypothesis

    from tests.trust.fuzz.structures import inputs

    done = 0
    while done < cases:  # hypothesis keeps what it has tried: so many at a time
        count = min(2000, cases - done)

        @hypothesis.seed(seed + done)
        @hypothesis.settings(
            max_examples=count, database=None, deadline=None, phases=[hypothesis.Phase.generate],
            suppress_health_check=list(hypothesis.HealthCheck),
        )  # fmt: skip
        @hypothesis.given(inputs(name))
        def feed(data: bytes) -> None:
            tally.feed(data)

        before = sum(tally.counts.values())
        feed()
        done += max(sum(tally.counts.values()) - before, 1)


def covered(name: str, cases: int, seed: int, tally: Tally) -> None:
    """Feed a reader with atheris' inputs; ends the process."""
    import atheris

    with atheris.instrument_imports(include=["irrsplat"]):
        import tests.trust.fuzz.readers as readers
    corpus = tempfile.mkdtemp(prefix="irrsplat-corpus-")
    for i, data in enumerate(readers.seeds(name)):
        (Path(corpus) / str(i)).write_bytes(data)
    start = time.process_time()

    def feed(data: bytes) -> None:
        tally.feed(data)
        if sum(tally.counts.values()) >= cases:
            print(tally.line(time.process_time() - start), flush=True)
            sys.stdout.flush()
            os._exit(1 if tally.places else 0)

    atheris.Setup([name, corpus, f"-seed={seed + 1}", "-max_len=4096", "-verbosity=0", "-rss_limit_mb=6000"], feed)
    atheris.Fuzz()


def main() -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", metavar="READER")
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--coverage", action="store_true")
    parser.add_argument("--found", type=Path)
    args = parser.parse_args()
    if args.coverage and len(args.readers) == 1:
        covered(args.readers[0], args.cases, args.seed, Tally(args.readers[0], args.found))
    from tests.trust.fuzz.readers import READERS

    if unknown := set(args.readers) - set(READERS):
        parser.error(f"there is no reader {', '.join(unknown)}; there are {', '.join(READERS)}")
    status = 0
    for name in args.readers or READERS:
        if args.coverage:
            command = [sys.executable, "-m", "tests.trust.fuzz.run", name, "--coverage", "--cases", str(args.cases)]
            command += ["--seed", str(args.seed), *(["--found", str(args.found)] if args.found else [])]
            status |= bool(subprocess.run(command, check=False).returncode)
            continue
        tally, start = Tally(name, args.found), time.process_time()
        structured(name, args.cases, args.seed, tally)
        print(tally.line(time.process_time() - start), flush=True)
        status |= bool(tally.places)
    return status


if __name__ == "__main__":
    sys.exit(main())
