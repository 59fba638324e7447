"""Work of `irrsplat cache`: describe, merge and prune files of records."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from irrsplat.app.common.terminal import columns, out
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.records import cache_file
from irrsplat.records.cache_file import Content
from irrsplat.records.merge import Merged, merge, prune
from irrsplat.settings import SETTINGS


def run(args: argparse.Namespace) -> int:
    """Run one of the tools; return the exit status."""
    return _TOOLS[args.tool](args)


def _info(args: argparse.Namespace) -> int:
    found = [_described(path, cache_file.read_any(path)) for path in args.files]
    if args.as_json:
        out(files.json_text(found))
        return 0
    for one in found:
        out("\n".join(_lines(one)))
    return 0


def _described(path: str, content: Content) -> dict[str, Any]:
    """Return the description of a cache file, by name."""
    records, scene = content.state.records, content.scene
    settings = content.settings()
    return {
        "file": path,
        "format": cache_file.FORMAT,
        "bytes": os.path.getsize(path),
        "scene": scene.name,
        "meshes": len(scene.meshes),
        "triangles": sum(mesh.triangles for mesh in scene.meshes),
        "geometry": content.key.geometry,
        "lights": content.key.lights,
        "records": len(records["id"]),
        "stale": int(np.count_nonzero(records["epoch"] < records["clocks"][0])),
        **content.state.bounces,
        "settings": {name: getattr(settings, name) for name in SETTINGS},
    }


def _lines(one: dict[str, Any]) -> list[str]:
    """Return the description as lines of text."""
    count, ended = one["bounces"], one["bounces_converged"]
    bounces = f"{count}" + ("" if ended is None else ", more would add hardly anything" if ended else ", more would add light")
    special = {name: value for name, value in one["settings"].items() if value != SETTINGS[name].default}
    words = ((SETTINGS[name].flag, ("off", "on")[value] if isinstance(value, bool) else value) for name, value in special.items())
    stale = f", {one['stale']} of them to be gathered again" if one["stale"] else ""
    rows = [
        ("scene", f"{one['scene']}: {one['meshes']} meshes, {one['triangles']} triangles"),
        ("records", f"{one['records']}{stale}"),
        ("size", f"{1e-6 * one['bytes']:.1f} MB, format {one['format']}"),
        ("bounces", bounces),
        ("gathered by", one["gathered_by"]),
        ("settings", " ".join(f"{flag} {value}" for flag, value in words) or "as by default"),
        ("made for", f"geometry {one['geometry'][:12]}, lights {one['lights'][:12]}"),
    ]
    return [one["file"], *(f"  {line}" for line in columns(rows, left=2))]


def _merge(args: argparse.Namespace) -> int:
    contents = read_alike(args.files)
    return _write(
        args.output, contents[0], merge([content.state for content in contents], contents[0].settings()), "served by others"
    )


def read_alike(paths: Sequence[str]) -> list[Content]:
    """Return the contents of these files; raise InputError for unreadable files and for different scenes or settings."""
    contents = [cache_file.read_any(path) for path in paths]
    for path, content in zip(paths, contents, strict=True):
        if reason := cache_file.difference(content.key, contents[0].key):
            raise InputError(f"this record cache was made {reason}, as '{paths[0]}' was; only caches of one scene merge", path)
    return contents


def _prune(args: argparse.Namespace) -> int:
    content, bound = cache_file.read_any(args.file), None
    if args.most is not None:
        bound, of_file = args.most
        bound = _fitting(content, args.file, bound) if of_file else bound
    words = "served by others" if bound is None else "least useful"
    return _write(args.output, content, prune(content.state, content.settings(), bound), words)


def _fitting(content: Content, path: str, size: int) -> int:
    """Return the number of a file's records that fit into `size` bytes; raise InputError for none."""
    count = len(content.state.records["id"])
    each = sum(rows.nbytes for rows in content.state.records.values() if len(rows.shape) and len(rows) == count) // max(count, 1)
    rest = os.path.getsize(path) - count * each
    if size < rest + each:
        raise InputError(f"--most: the description of the scene alone takes {rest} bytes; allow more", path)
    return (size - rest) // max(each, 1)


def _write(path: str, content: Content, done: Merged, why: str) -> int:
    cache_file.write(path, content.key, done.state, content.scene)
    count = len(done.state.records["id"])
    out(f"{path}: {count} of {count + done.dropped} records; {done.dropped} were left out, {why}")
    return 0


_TOOLS: dict[str, Callable[[argparse.Namespace], int]] = {"info": _info, "merge": _merge, "prune": _prune}
