"""Grammar of the command line: commands, and parsing of their flags."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from irrsplat import __version__
from irrsplat.app.commands import bake, bench, cache, fill, info, measure, render, verify, view
from irrsplat.app.commands.shared import flags
from irrsplat.app.common.parser import Parser
from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.settings import SETTINGS

COMMANDS: dict[str, Callable[[Any], None]] = {  # functions that add a command and its `run`, in the order of --help
    "view": view.add,
    "render": render.add,
    "fill": fill.add,
    "cache": cache.add,
    "measure": measure.add,
    "bake": bake.add,
    "bench": bench.add,
    "info": info.add,
    "doctor": info.add_doctor,
    "verify": verify.add,
}


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the checked command line.

    It has `command`, its function `run`, its arguments, `loading` for a scene, and `values`, the settings given by flag.
    Raises InputError, one line, for the first error; SystemExit(0) after --help and --version.
    """
    top = build()
    args: argparse.Namespace
    args, rest = top.parse_known_args(list(_spelled_out(argv)))
    if rest:
        raise InputError(f"unexpected '{rest[0]}'; see {top.prog} {args.command} --help")
    if hasattr(args, "up_axis"):
        args.loading = LoadOptions(args.up_axis, args.crease_angle, args.sky, tuple(args.allow), args.photometric)
    if any(name.startswith("set_") for name in vars(args)):
        args.values = {
            name: declaration.parse(text)
            for name, declaration in SETTINGS.items()
            if (text := getattr(args, "set_" + name, None)) is not None
        }
    if hasattr(args, "camera"):
        flags.check_camera(args)
    return args


def build() -> Parser:
    top = Parser(prog="irrsplat", description="Indirect light for diffuse scenes by irradiance cache splatting.")
    top.add_argument("--version", action="version", version=f"irrsplat {__version__}", help="print the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)
    for add in COMMANDS.values():
        add(commands)
    return top


def _spelled_out(argv: Sequence[str]) -> Iterator[str]:
    """Yield `argv` with "on" after every bare on|off flag, so that argparse never takes the SCENE after it for its value."""
    switches = {d.flag for d in SETTINGS.values() if d.kind == "bool"}
    for i, word in enumerate(argv):
        if word == "--":
            yield from argv[i:]
            return
        yield word
        following = argv[i + 1].lower() if i + 1 < len(argv) else ""
        if word in switches and following not in ("on", "off"):
            yield "on"
