"""`irrsplat bench --compare`: time ratios between the JSON of an earlier run and this run."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard

from irrsplat.app.bench.cases import Run
from irrsplat.app.common.terminal import columns
from irrsplat.core.errors import InputError

NOISE = 0.1  # ratios within this distance of 1 may be noise
ONCE = 0.25  # as NOISE, for cases timed once


def read(path: str) -> list[Run]:
    """Return the runs in a file from `--json`, as far as they are compared; raise InputError for any other file."""
    try:
        data = json.loads(Path(path).read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror or error}", path) from error
    except (ValueError, RecursionError) as error:
        raise InputError("not JSON; --compare takes a file that irrsplat bench --json wrote", path) from error
    runs = data.get("runs") if isinstance(data, dict) else None
    if not isinstance(runs, list) or not all(map(_is_run, runs)):
        raise InputError("not a file that irrsplat bench --json wrote: its runs are missing or damaged", path)
    return [_run(entry) for entry in runs]


def _run(entry: Mapping[str, Any]) -> Run:
    """Return a run of the benchmark's JSON; earlier versions wrote fewer values."""
    scene, preset, size, case, seconds = (entry[name] for name in ("scene", "preset", "size", "case", "seconds"))
    more = {"bounces": entry.get("bounces", 1), "seconds_all": entry.get("seconds_all", [])}
    return Run(scene, preset, size, case, seconds, records=0, rmse=entry.get("rmse"), stages_ms={}, clock="", **more)


def table(then: Sequence[Run], now: Sequence[Run]) -> Iterator[str]:
    """Yield a table of the common runs with then/now (above 1: faster now) and a verdict; list the other runs by name."""
    before, after = ({_key(run): run for run in runs} for runs in (then, now))
    made = [("scene", "preset", "size", "bounces", "case", "then s", "now s", "then/now", "rmse then", "now", "")]
    for key, run in after.items():
        if (old := before.get(key)) is not None:
            times = f"{old.seconds:.3f}", f"{run.seconds:.3f}", f"{old.seconds / run.seconds:.2f}"
            made.append((*key, *times, _percent(old), _percent(run), verdict(old, run)))
    if len(made) > 1:
        yield from columns(made, left=5)
    for words, keys in (("only then", before.keys() - after.keys()), ("only now", after.keys() - before.keys())):
        for key in sorted(keys):
            yield f"{words}: {' '.join(key)}"


def verdict(then: Run, now: Run) -> str:
    """Return "faster" or "slower" if the repetitions do not overlap by more than noise, else ""."""
    (low, high), (least, most) = (_span(run) for run in (then, now))
    return "faster" if most < low else "slower" if least > high else ""


def _span(run: Run) -> tuple[float, float]:
    """Return the range of a run's times in seconds, widened by half the noise at both ends."""
    times = run.seconds_all or [run.seconds]
    half = math.sqrt(1.0 + (NOISE if len(times) > 1 else ONCE))
    return min(times) / half, max(times) * half


def _key(run: Run) -> tuple[str, str, str, str, str]:
    """Return scene, preset, size, bounces and case."""
    return run.scene, run.preset, "x".join(map(str, run.size)), str(run.bounces), run.case


def _is_run(run: object) -> bool:
    if not isinstance(run, dict) or not all(isinstance(run.get(name), str) for name in ("scene", "preset", "case")):
        return False
    size, times = run.get("size"), run.get("seconds_all", [])
    whole = isinstance(size, list) and len(size) == 2 and all(type(n) is int for n in size) and isinstance(times, list)
    rmse = run.get("rmse")
    whole = whole and all(_is_number(time) and time > 0.0 for time in (run.get("seconds"), *times))
    return whole and (rmse is None or _is_number(rmse))


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _percent(run: Run) -> str:
    return "-" if run.rmse is None else f"{run.rmse:.1%}"
