"""`irrsplat bench --compare`: time ratios between the JSON of an earlier run and this run."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NotRequired, TypedDict, TypeGuard

from irrsplat.app.common.terminal import columns
from irrsplat.core.errors import InputError

NOISE = 0.1  # ratios within this distance of 1 may be noise
ONCE = 0.25  # as NOISE, for cases timed once


class EarlierRun(TypedDict):
    """Compared entries of a run in the benchmark's JSON; earlier versions wrote fewer."""

    scene: str
    preset: str
    size: list[int]
    case: str
    seconds: float
    rmse: NotRequired[float | None]
    bounces: NotRequired[int | str]
    seconds_all: NotRequired[list[float]]


def read(path: str) -> list[EarlierRun]:
    """Return the runs in a file from `--json`; raise InputError for any other file."""
    try:
        data = json.loads(Path(path).read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror or error}", path) from error
    except (ValueError, RecursionError) as error:
        raise InputError("not JSON; --compare takes a file that irrsplat bench --json wrote", path) from error
    runs = data.get("runs") if isinstance(data, dict) else None
    if not isinstance(runs, list) or not all(map(_is_run, runs)):
        raise InputError("not a file that irrsplat bench --json wrote: its runs are missing or damaged", path)
    return runs


def table(then: Sequence[EarlierRun], now: Sequence[EarlierRun]) -> Iterator[str]:
    """Yield a table of the common runs with then/now (above 1: faster now) and a verdict; list the other runs by name."""
    before, after = ({_key(run): run for run in runs} for runs in (then, now))
    made = [("scene", "preset", "size", "bounces", "case", "then s", "now s", "then/now", "rmse then", "now", "")]
    for key, run in after.items():
        if (old := before.get(key)) is not None:
            times = f"{old['seconds']:.3f}", f"{run['seconds']:.3f}", f"{old['seconds'] / run['seconds']:.2f}"
            made.append((*key, *times, _percent(old), _percent(run), verdict(old, run)))
    if len(made) > 1:
        yield from columns(made, left=5)
    for words, keys in (("only then", before.keys() - after.keys()), ("only now", after.keys() - before.keys())):
        for key in sorted(keys):
            yield f"{words}: {' '.join(key)}"


def verdict(then: EarlierRun, now: EarlierRun) -> str:
    """Return "faster" or "slower" if the repetitions do not overlap by more than noise, else ""."""
    (low, high), (least, most) = (_span(run) for run in (then, now))
    return "faster" if most < low else "slower" if least > high else ""


def _span(run: EarlierRun) -> tuple[float, float]:
    """Return the range of a run's times in seconds, widened by half the noise at both ends."""
    times = run.get("seconds_all") or [run["seconds"]]
    half = math.sqrt(1.0 + (NOISE if len(times) > 1 else ONCE))
    return min(times) / half, max(times) * half


def _key(run: EarlierRun) -> tuple[str, str, str, str, str]:
    """Return scene, preset, size, bounces and case."""
    size = "x".join(str(n) for n in run["size"])
    return run["scene"], run["preset"], size, str(run.get("bounces", 1)), run["case"]


def _is_run(run: object) -> TypeGuard[EarlierRun]:
    if not isinstance(run, dict) or not all(isinstance(run.get(name), str) for name in ("scene", "preset", "case")):
        return False
    size, times = run.get("size"), run.get("seconds_all", [])
    whole = isinstance(size, list) and len(size) == 2 and all(type(n) is int for n in size) and isinstance(times, list)
    rmse = run.get("rmse")
    whole = whole and all(_is_number(time) and time > 0.0 for time in (run.get("seconds"), *times))
    return whole and (rmse is None or _is_number(rmse))


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _percent(run: EarlierRun) -> str:
    return "-" if run.get("rmse") is None else f"{run['rmse']:.1%}"
