"""`irrsplat bench --growth`: time against a scene's triangles and a picture's pixels."""

from __future__ import annotations

import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from irrsplat.app.bench.cases import TURN, machine, turned
from irrsplat.app.common.terminal import columns, doing, out
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.core.timing import other_process

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

    seconds: wall times by case, see LEGEND. stages: milliseconds by stage from an empty cache; clock: their clock.
    """

    triangles: int
    size: tuple[int, int]
    seconds: dict[str, float]
    records: int
    stages: dict[str, float]
    clock: str
    machine: dict[str, object]

    @property
    def record(self) -> float:
        """Milliseconds of gather and reduction per record."""
        return (self.stages["gather"] + self.stages["reduce"]) / max(self.records, 1)


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
        failure = f"the row of {count} triangles at {side}x{side} failed: {{why}}"
        rows.append(cast(Row, other_process.call(other_process.code(measured), (count, side), failure=failure)))
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
        seconds = (f"{s:.3f}" for s in (*row.seconds.values(), row.record))
        lines.append((f"{row.triangles:,}", f"{row.size[0]}x{row.size[1]}", *seconds, str(row.records)))
    return lines


def _runs(row: Row) -> Iterator[dict[str, object]]:
    """Yield the entries of the benchmark's JSON, one per time."""
    for case, seconds in row.seconds.items():
        yield {
            "scene": f"curved, {row.triangles} triangles",
            "preset": "default",
            "size": list(row.size),
            "case": f"growth {case}",
            "seconds": seconds,
            "records": row.records,
            "rmse": None,
            "stages_ms": row.stages if case == "empty" else {},
            "clock": row.clock,
            "bounces": "all",
        }


# ---- a row's own process -----------------------------------------------------------------------------------------------


def measured(triangles: int, side: int, report: object = None) -> Row:
    """Return the row of `curved` with about `triangles` triangles and side² pixels; the process runs nothing else."""
    import irrsplat
    from irrsplat.scenes import generate

    with tempfile.TemporaryDirectory() as folder:
        generate.curved(Path(folder), triangles / OWN)
        start = time.perf_counter()
        scene = irrsplat.load(str(Path(folder) / "curved.scene"))
        seconds = {"load": time.perf_counter() - start}
    start = time.perf_counter()
    with irrsplat.Renderer(scene, size=(side, side)) as renderer:
        renderer.ctx.finish()
        seconds["build"] = time.perf_counter() - start
        camera = scene.camera()
        _, stats = renderer.converge(camera)
        seconds["surface"] = 1e-3 * renderer.timers.milliseconds().get("surface", 0.0)
        count = int(stats["records"])
        for case, view, records in (("empty", camera, 0), ("moved", turned(camera, TURN), count)):
            times: list[float] = []
            while len(times) < REPETITIONS and (not times or times[0] < SLOW):
                renderer.forget(records=records == 0, lights=records == 0)
                renderer.cache.truncate(records)
                times.append(renderer.converge(view)[1]["seconds"])
                if case == "empty":
                    stages = renderer.timers.milliseconds()
            seconds[case] = min(times)
        clock, about = renderer.timers.clock, machine(renderer.about)
        return Row(scene.triangles, (side, side), seconds, count, stages, clock, about)
