"""`irrsplat cache`: describe, merge and prune files of records."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from irrsplat.app.commands.shared import values
from irrsplat.app.commands.shared.command import Command
from irrsplat.app.common.parser import Parser

if TYPE_CHECKING:
    from irrsplat.app.common.parser import Mistakes


def add(commands: Any) -> None:
    """Add the flags of `irrsplat cache`."""
    words = "what is in files of records, several of them as one, and one with fewer records"
    parser = commands.add_parser("cache", help=words, description=f"{words[0].upper()}{words[1:]}.")
    tools = parser.add_subparsers(dest="tool", metavar="TOOL", required=True, parser_class=Parser)
    info = tools.add_parser(
        "info", help="what is in them", description="Say what record caches were made for, and what they hold."
    )
    info.add_argument("files", nargs="+", metavar="FILE", help="record caches")
    info.add_argument("--json", dest="as_json", action="store_true", help="as JSON, with all settings")
    merge = tools.add_parser(
        "merge",
        help="several as one",
        description="Write one cache with the records of several that were made apart, for one scene with one set of settings.",
        epilog="All records of the first stay; of each further one those whose places no others serve. Limits of radii,\n"
        "where records disagree, are found by whoever draws with the cache first.",
    )
    merge.add_argument("files", nargs="+", metavar="FILE", help="record caches")
    prune = tools.add_parser(
        "prune",
        help="one with fewer records",
        description="Write a cache without records whose places others serve.",
        epilog="With --most those go first that the others serve best, as many as must, and no more.",
    )
    prune.add_argument("file", metavar="FILE", help="a record cache")
    words = "so many records at most, or so large a file, such as 20MB (default: only what others serve goes)"
    prune.add_argument("--most", type=values.most, metavar="N", help=words)
    for tool in (merge, prune):
        tool.add_argument("-o", "--output", required=True, metavar="OUT", help="the cache to write; may be one of those read")


def check_files(args: argparse.Namespace, mistakes: Mistakes) -> None:
    """Add an error to `mistakes` if the cache cannot be written."""
    if args.tool != "info" and "output" not in mistakes.arguments:
        from irrsplat.core import files

        with mistakes.gathered():
            files.check_file(args.output)


def run(args: argparse.Namespace) -> int:
    """Run `irrsplat cache`."""
    from irrsplat.app.commands.work import cache as work

    return work.run(args)


COMMAND = Command(add, run, check_files=check_files)
