"""`irrsplat cache`: describe, merge and prune files of records."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from irrsplat.app.commands.shared import flags
from irrsplat.app.common.parser import Parser
from irrsplat.app.common.terminal import columns, out
from irrsplat.core.errors import InputError
from irrsplat.settings import SETTINGS

if TYPE_CHECKING:
    from irrsplat.records.cache_file import CacheState, Content

_COVERED = "others cover their places; a view may request a few records again"


def add(commands: Any) -> None:
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
    prune.add_argument("--most", type=flags.count, metavar="N", help=words)
    for tool in (merge, prune):
        tool.add_argument("-o", "--output", required=True, metavar="OUT", help="output cache; may be one of the inputs")
    info.set_defaults(run=_info)
    merge.set_defaults(run=_merge)
    prune.set_defaults(run=_prune)


def _info(args: argparse.Namespace) -> int:
    from irrsplat.records import cache_file

    contents = [cache_file.read_any(path) for path in args.files]
    for path, content in zip(args.files, contents, strict=True):
        out("\n".join(_lines(path, content)))
    return 0


def _lines(path: str, content: Content) -> list[str]:
    """Return the description of a cache file as lines of text."""
    from irrsplat.records import cache_file

    records, scene, found = content.state.records, content.key.scene, content.state.bounces
    ended, stale = found["bounces_converged"], int((records["epoch"] < records["clocks"][0]).sum())
    bounces = f"{found['bounces']}" + (
        "" if ended is None else ", more would add hardly anything" if ended else ", more would add light"
    )
    values = vars(content.settings())
    special = {d.flag: values[name] for name, d in SETTINGS.items() if values[name] != d.default}
    words = (f"{flag} {('off', 'on')[value] if isinstance(value, bool) else value}" for flag, value in special.items())
    rows = [
        ("scene", f"{scene.name}: {len(scene.meshes)} meshes, {sum(mesh.triangles for mesh in scene.meshes)} triangles"),
        ("records", f"{len(records['id'])}" + (f", {stale} of them to be gathered again" if stale else "")),
        ("size", f"{1e-6 * os.path.getsize(path):.1f} MB, format {cache_file.FORMAT}"),
        ("bounces", bounces),
        ("gathered by", str(found["gathered_by"])),
        ("settings", " ".join(words) or "as by default"),
        ("made for", f"geometry {scene.geometry[:12]}, lights {content.key.lights[:12]}"),
    ]
    return [path, *(f"  {line}" for line in columns(rows, left=2))]


def _merge(args: argparse.Namespace) -> int:
    from irrsplat.core import files
    from irrsplat.records import cache_file
    from irrsplat.records.merge import merge

    files.check_file(args.output)
    contents = [cache_file.read_any(path) for path in args.files]
    for path, content in zip(args.files, contents, strict=True):
        if reason := cache_file.difference(content.key, contents[0].key):
            raise InputError(
                f"this record cache was made {reason}, as '{args.files[0]}' was; only caches of one scene merge", path
            )
    states = [content.state for content in contents]
    return _write(args.output, contents[0], states, merge(states, contents[0].settings()), _COVERED)


def _prune(args: argparse.Namespace) -> int:
    from irrsplat.core import files
    from irrsplat.records import cache_file
    from irrsplat.records.merge import prune

    files.check_file(args.output)
    content = cache_file.read_any(args.file)
    words = _COVERED if args.most is None else "the best covered first"
    return _write(args.output, content, [content.state], prune(content.state, content.settings(), args.most), words)


def _write(path: str, content: Content, sources: Sequence[CacheState], state: CacheState, why: str) -> int:
    """Write the records of `state`, which remain of those of the `sources`, and print their number.

    why: reason for the removal of the others.
    """
    from irrsplat.records import cache_file

    cache_file.write(path, content.key, state)
    whole, count = sum(len(source.records["id"]) for source in sources), len(state.records["id"])
    others = f"{whole - count} were left out: {why}" if count < whole else "none was left out"
    out(f"{path}: {count} of {whole} records; {others}")
    return 0
