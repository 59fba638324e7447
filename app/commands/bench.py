"""`irrsplat bench`: benchmarks."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from irrsplat.app.commands.shared import flags
from irrsplat.app.commands.shared.command import Command
from irrsplat.app.common.terminal import wrote
from irrsplat.core.errors import InputError


def add(commands: Any) -> None:
    """Add the flags of `irrsplat bench`."""
    parser = commands.add_parser(
        "bench",
        help="time it against the algorithm as published, and against others",
        description="Time scenes: from an empty cache, from a kept one, turned, relit, and in flight; and print the errors.",
        epilog="References for the errors are gathered once and kept in the user's cache folder, or in the one that\n"
        "IRRSPLAT_CACHE names. --peers needs the extra: pip install 'irrsplat[peers]'.",
    )
    add = parser.add_argument
    add("scenes", nargs="*", metavar="SCENE", help="paths, or names of bundled scenes (default: cornell-paper; --peers: cornell)")
    words = "image size in pixels, may be repeated (default: 800 800; --peers and --profile: 400 400)"
    flags.add_size(parser, None, words, action="append")
    words = "may be repeated (default: default; for cornell-paper, paper as well)"
    flags.add_preset(parser, None, words, action="append")
    flags.add_loading(parser)
    add("--bounces", metavar="N|all", default="1", help="indirect bounces (default: 1, as the paper has it)")
    add("--flight", choices=("on", "off"), default="on", help="fly through the viewer's window as well (default: on)")
    add("--flicker", action="store_true", help="how far light changes from frame to frame in flight instead, all bounces")
    add("--json", metavar="FILE", help="write the results to this file as well")
    add("--compare", metavar="FILE", help="ratios of time against an earlier run's --json")
    add("--peers", action="store_true", help=f"time against error instead, beside {_peers()}")
    add("--profile", action="store_true", help="processor time by stage instead, beside that of its rays alone")
    add("--growth", action="store_true", help="time and memory against triangles and pixels instead, some minutes long")
    add("--moving", action="store_true", help="errors while meshes and lights are carried through cornell and atrium instead")
    add(
        "--counted",
        action="store_true",
        help="with --moving: ticks of so many rays, not of so many seconds, on any machine",
    )
    add("--quick", action="store_true", help="with --growth: a short series of small ones")
    add("-o", "--output", metavar="FILE.png", help="with --peers or --growth: the plot")


def _peers() -> str:
    try:
        from irrsplat.app.bench.peers.table import others
    except ModuleNotFoundError:  # other commands work without the benchmark
        return "other renderers"
    return others()


def run(args: argparse.Namespace) -> int:
    """Run `irrsplat bench`."""
    if args.json is not None:
        from irrsplat.core.files import check_file

        check_file(args.json)
    if args.quick and not args.growth:
        raise InputError("--quick is for --growth; give that as well")
    if args.counted and not args.moving:
        raise InputError("--counted is for --moving; give that as well")
    status = _bench_of(args)(args)
    for path in (args.json, args.output):
        if path is not None:
            wrote(path)
    return status


def _bench_of(args: argparse.Namespace) -> Callable[[argparse.Namespace], int]:
    if args.moving:
        from irrsplat.app.bench import moving

        return moving.run
    if args.growth:
        from irrsplat.app.bench import scaling

        return scaling.run
    from irrsplat.app.bench import bench as benchmark

    return benchmark.run


COMMAND = Command(add, run)
