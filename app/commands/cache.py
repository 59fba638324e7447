"""`irrsplat cache`: describe, merge and prune files of records."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.commands.shared import values
from irrsplat.app.common.parser import Parser


def add(commands: Any) -> None:
    """Add the flags of `irrsplat cache`."""
    words = "inspect, merge and prune cache files"
    parser = commands.add_parser("cache", help=words, description=f"{words[0].upper()}{words[1:]}.")
    tools = parser.add_subparsers(dest="tool", metavar="TOOL", required=True, parser_class=Parser)
    info = tools.add_parser(
        "info", help="print the content of caches", description="Print the scene, the settings and the content of caches."
    )
    info.add_argument("files", nargs="+", metavar="FILE", help="cache files")
    merge = tools.add_parser(
        "merge",
        help="merge several caches",
        description="Merge caches of one scene and one set of settings.",
        epilog="All records of the first cache remain, and those records of the others whose place is not covered. The next\n"
        "renderer that loads the file limits the radii of records that disagree.",
    )
    merge.add_argument("files", nargs="+", metavar="FILE", help="cache files")
    prune = tools.add_parser(
        "prune",
        help="remove redundant records",
        description="Write a cache without records whose place other records cover.",
        epilog="--most removes the best covered records first, until the limit is met.",
    )
    prune.add_argument("file", metavar="FILE", help="a cache file")
    words = "limit of records (default: remove covered records only)"
    prune.add_argument("--most", type=values.count, metavar="N", help=words)
    for tool in (merge, prune):
        tool.add_argument("-o", "--output", required=True, metavar="OUT", help="output cache; may be one of the inputs")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `irrsplat cache`."""
    from irrsplat.app.commands.work import cache as work
    from irrsplat.core import files

    if args.tool != "info":
        files.check_file(args.output)
    return work.run(args)
