"""Work of `irrsplat cache`: describe, merge and prune files of records."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable

import numpy as np

from irrsplat.app.common.terminal import columns, out
from irrsplat.core.errors import InputError
from irrsplat.records import cache_file
from irrsplat.records.cache_file import Content
from irrsplat.records.merge import Merged, merge, prune
from irrsplat.settings import SETTINGS


def run(args: argparse.Namespace) -> int:
    """Run one of the tools; return the exit status."""
    return _TOOLS[args.tool](args)


def _info(args: argparse.Namespace) -> int:
    contents = [cache_file.read_any(path) for path in args.files]
    for path, content in zip(args.files, contents, strict=True):
        out("\n".join(_lines(path, content)))
    return 0


def _lines(path: str, content: Content) -> list[str]:
    """Return the description of a cache file as lines of text."""
    records, scene, found = content.state.records, content.scene, content.state.bounces
    ended, stale = found["bounces_converged"], int(np.count_nonzero(records["epoch"] < records["clocks"][0]))
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
        ("made for", f"geometry {content.key.geometry[:12]}, lights {content.key.lights[:12]}"),
    ]
    return [path, *(f"  {line}" for line in columns(rows, left=2))]


def _merge(args: argparse.Namespace) -> int:
    contents = [cache_file.read_any(path) for path in args.files]
    for path, content in zip(args.files, contents, strict=True):
        if reason := cache_file.difference(content.key, contents[0].key):
            raise InputError(
                f"this record cache was made {reason}, as '{args.files[0]}' was; only caches of one scene merge", path
            )
    done = merge([content.state for content in contents], contents[0].settings())
    return _write(args.output, contents[0], done, "covered by others")


def _prune(args: argparse.Namespace) -> int:
    content = cache_file.read_any(args.file)
    words = "covered by others" if args.most is None else "least useful"
    return _write(args.output, content, prune(content.state, content.settings(), args.most), words)


def _write(path: str, content: Content, done: Merged, why: str) -> int:
    cache_file.write(path, content.key, done.state, content.scene)
    count = len(done.state.records["id"])
    out(f"{path}: {count} of {count + done.dropped} records; {done.dropped} were left out, {why}")
    return 0


_TOOLS: dict[str, Callable[[argparse.Namespace], int]] = {"info": _info, "merge": _merge, "prune": _prune}
