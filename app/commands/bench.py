"""`irrsplat bench`: benchmarks."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.commands.shared import flags
from irrsplat.app.common.terminal import wrote


def add(commands: Any) -> None:
    from irrsplat.app.bench.peers.table import others

    parser = commands.add_parser(
        "bench",
        help="measure times, also of the published method and of other renderers",
        description="Measure times and errors with an empty and a full cache, and after turns and changes of light.",
        epilog="References for the errors are gathered once and kept in the cache folder of the user, or in the folder of\n"
        "IRRSPLAT_CACHE. --peers requires the extra: pip install 'irrsplat[peers]'.",
    )
    add = parser.add_argument
    add("scenes", nargs="*", metavar="SCENE", help="paths, or names of bundled scenes (default: cornell-paper; --peers: cornell)")
    words = "image size in pixels, may be repeated (default: 800 800; --peers and --profile: 400 400)"
    flags.add_size(parser, None, words, action="append")
    words = "may be repeated (default: default; for cornell-paper also paper)"
    flags.add_preset(parser, None, words, action="append")
    flags.add_loading(parser)
    add("--bounces", metavar="N|all", default="1", help="indirect bounces (default: 1, as in the paper)")
    add("--json", metavar="FILE", help="also write the results to this file")
    add("--compare", metavar="FILE", help="print ratios of time to an earlier --json")
    add("--peers", action="store_true", help=f"only compare time against error with {others()}")
    add("--profile", action="store_true", help="only measure processor time by stage, and of the rays alone")
    add("--growth", action="store_true", help="only measure time against triangles and pixels; takes some minutes")
    add("-o", "--output", metavar="FILE.png", help="with --peers: write the plot")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    if args.json is not None:
        from irrsplat.core.files import check_file

        check_file(args.json)
    from irrsplat.app.bench import bench, scaling

    status = scaling.run(args) if args.growth else bench.run(args)
    for path in (args.json, args.output):
        if path is not None:
            wrote(path)
    return status
