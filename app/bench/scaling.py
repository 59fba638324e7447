"""`irrsplat bench --growth`: time against a scene's triangles and a picture's pixels."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from irrsplat.app.bench import machine
from irrsplat.app.bench.cases import TURN, turned
from irrsplat.app.common.terminal import columns, doing, out
from irrsplat.core import files
from irrsplat.core.errors import InputError, IrrsplatError

TRIANGLES = (10**3, 10**4, 10**5, 10**6)
SIDES = (400, 800, 1600, 3200)  # pixels
OWN = 6360  # triangles of the bundled `curved`
REPETITIONS, SLOW = 3, 5.0  # repetitions; seconds above which a case runs once
LEGEND = """\
the scene `curved` with increasing tessellation; preset default, all bounces; one process per row
load: read the files; build: the tree for rays, textures and buffers; surface: the surface cache, once for all views
from empty: time to full coverage without records, best of up to 3; turned: the camera turned by 5°, with records
ms a record: gather and reduction\
"""


@dataclass(frozen=True)
class Row:
    """One scene and size.

    Times: wall time in seconds, named in LEGEND. stages: milliseconds by stage from an empty cache; clock: their clock.
    """

    triangles: int
    size: tuple[int, int]
    load: float
    build: float
    surface: float
    empty: float
    moved: float
    record: float  # ms
    records: int
    stages: dict[str, float] = field(default_factory=dict)
    clock: str = "wall"
    machine: dict[str, object] = field(default_factory=dict)


def run(args: Namespace) -> int:
    """Measure both series, print tables, and write JSON on request; return the exit status.

    Raises InputError for incompatible flags; IrrsplatError if a row fails.
    """
    if args.scenes or args.size or args.preset or args.peers or args.compare or args.output:
        raise InputError("--growth has scenes, sizes and a preset of its own; give it with --json alone")
    plan = [(count, SIDES[0]) for count in TRIANGLES] + [(OWN, side) for side in SIDES]
    rows: list[Row] = []
    for k, (count, side) in enumerate(plan):
        doing(f"{k + 1} of {len(plan)}: {count:,} triangles at {side}x{side}")
        rows.append(_apart(count, side))
    doing("")
    out(f"growth on {rows[0].machine['renderer']}\n{LEGEND}\n")
    by_triangles, by_pixels = rows[: len(TRIANGLES)], rows[len(TRIANGLES) :]
    for found in (by_triangles, by_pixels):
        out("\n".join([*columns(table(found), left=0), ""]))
    middle, last = min(by_triangles, key=lambda row: abs(row.triangles - 10**4)), by_triangles[-1]
    times = last.record / middle.record
    out(f"a record costs {times:.1f} times as much with {last.triangles:,} triangles as with {middle.triangles:,}")
    if args.json is not None:
        runs = [entry for row in rows for entry in _runs(row)]
        files.write_text(args.json, files.json_text({"machine": rows[0].machine, "runs": runs}) + "\n")
    return 0


def table(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """Return a line for each row, below the column names."""
    head = ("triangles", "size", "load s", "build s", "surface s", "from empty s", "turned s", "ms a record", "records")
    lines: list[tuple[str, ...]] = [head]
    for row in rows:
        seconds = (f"{s:.3f}" for s in (row.load, row.build, row.surface, row.empty, row.moved, row.record))
        lines.append((f"{row.triangles:,}", f"{row.size[0]}x{row.size[1]}", *seconds, str(row.records)))
    return lines


def _runs(row: Row) -> Iterator[dict[str, object]]:
    """Yield the entries of the benchmark's JSON, one per time."""
    for case in ("load", "build", "surface", "empty", "moved"):
        yield {
            "scene": f"curved, {row.triangles} triangles",
            "preset": "default",
            "size": list(row.size),
            "case": f"growth {case}",
            "seconds": getattr(row, case),
            "records": row.records,
            "rmse": None,
            "stages_ms": row.stages if case == "empty" else {},
            "clock": row.clock,
            "bounces": "all",
        }


# ---- a row's own process -----------------------------------------------------------------------------------------------


def _apart(triangles: int, side: int) -> Row:
    """Measure a row in a separate process; raise IrrsplatError with its last line of output if it fails."""
    command = [sys.executable, "-m", "irrsplat.app.bench.scaling", str(triangles), str(side)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        last_line = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        raise IrrsplatError(f"the row of {triangles} triangles at {side}x{side} failed: {last_line}")
    values = json.loads(done.stdout.splitlines()[-1])
    return Row(**values | {"size": tuple(values["size"])})


def measured(triangles: int, side: int) -> Row:
    """Return the row of `curved` with about `triangles` triangles and side² pixels; the process runs nothing else."""
    import irrsplat
    from irrsplat.scenes import generate

    with tempfile.TemporaryDirectory() as folder:
        generate.curved(Path(folder), triangles / OWN)
        start = time.perf_counter()
        scene = irrsplat.load(str(Path(folder) / "curved.scene"))
        load = time.perf_counter() - start
    start = time.perf_counter()
    with irrsplat.Renderer(scene, size=(side, side)) as renderer:
        renderer.ctx.finish()
        build = time.perf_counter() - start
        camera = scene.camera()
        _, stats = renderer.converge(camera)
        surface = 1e-3 * renderer.timers.milliseconds().get("surface", 0.0)
        count, best = int(stats["records"]), {}
        for case, view, records in (("empty", camera, 0), ("moved", turned(camera, TURN), count)):
            seconds: list[float] = []
            while len(seconds) < REPETITIONS and (not seconds or seconds[0] < SLOW):
                renderer.forget(records=records == 0, lights=records == 0)
                renderer.cache.truncate(records)
                seconds.append(renderer.converge(view)[1]["seconds"])
                if case == "empty":
                    stages = renderer.timers.milliseconds()
            best[case] = min(seconds)
        return Row(
            scene.triangles,
            (side, side),
            load,
            build,
            surface,
            best["empty"],
            best["moved"],
            (stages["gather"] + stages["reduce"]) / max(count, 1),
            count,
            stages,
            renderer.timers.clock,
            machine.about(renderer.about),
        )


if __name__ == "__main__":
    print(json.dumps(asdict(measured(int(sys.argv[1]), int(sys.argv[2])))))
