"""Grammar of the command line: commands, and parsing of their flags."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from irrsplat.app.commands import bake, bench, cache, fill, info, measure, render, verify, view
from irrsplat.app.commands.shared import flags
from irrsplat.app.commands.shared.command import Command
from irrsplat.app.common.parser import Mistakes, Parser
from irrsplat.app.common.terminal import out
from irrsplat.app.common.version import version
from irrsplat.core.load_options import LoadOptions
from irrsplat.settings import SETTINGS

COMMANDS: dict[str, Command] = {  # in the order of --help
    "view": view.COMMAND,
    "render": render.COMMAND,
    "fill": fill.COMMAND,
    "cache": cache.COMMAND,
    "measure": measure.COMMAND,
    "bake": bake.COMMAND,
    "bench": bench.COMMAND,
    "info": info.COMMAND,
    "doctor": info.DOCTOR,
    "verify": verify.COMMAND,
}


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the checked command line.

    It has `command`, its arguments, `loading` for a scene, and `values`, the settings given by flag. Raises InputError, one
    line, for all errors; SystemExit(0) after --help and --version.
    """
    args, mistakes = read(argv)
    mistakes.raise_all()
    return args


def read(argv: Sequence[str]) -> tuple[argparse.Namespace, Mistakes]:
    """Return the command line and its mistakes; an invalid flag has the value None.

    Raises InputError only if no command is recognizable.
    """
    mistakes = Mistakes()
    top = build(mistakes)
    args, rest = top.parse_known_args(list(_spelled_out(argv)))
    page = f"{top.prog} {args.command} --help"
    for word in rest:
        mistakes.add(f"unexpected '{word}'", page)
    if hasattr(args, "up_axis") and not mistakes.arguments & {"up_axis", "crease_angle", "time"}:
        with mistakes.gathered():
            args.loading = LoadOptions(args.up_axis, args.crease_angle, args.time, args.sky, tuple(args.allow))
    if any(name.startswith("set_") for name in vars(args)):
        args.values = {}
        for name, declaration in SETTINGS.items():
            if (text := getattr(args, "set_" + name, None)) is not None:
                with mistakes.gathered():
                    args.values[name] = declaration.parse(text)
    if hasattr(args, "camera") and not mistakes.arguments & flags.OF_CAMERAS:
        for wrong in flags.wrong_with_the_camera(args):
            mistakes.add(wrong)
    COMMANDS[args.command].check(args, mistakes)
    return args, mistakes


def build(mistakes: Mistakes | None = None) -> Parser:
    """Return the complete grammar; it adds errors of a command line to `mistakes`."""
    top = Parser(mistakes, prog="irrsplat", description="Indirect light for diffuse scenes by irradiance cache splatting.")
    top.add_argument("--version", action=_Version, help="print the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)
    for command in COMMANDS.values():
        command.add(commands)
    _share(top.mistakes, top)
    return top


def _share(mistakes: Mistakes, parser: Parser) -> None:
    """Collect the errors of `parser` and its subparsers in `mistakes`."""
    parser.mistakes = mistakes
    for action in parser._actions:
        if isinstance(action.choices, dict):
            for inner in action.choices.values():
                _share(mistakes, inner)


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


class _Version(argparse.Action):
    """Action that prints the version; the version is looked up on demand."""

    def __init__(self, option_strings: Sequence[str], dest: str, **options: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, **options)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        out(f"irrsplat {version()}")
        parser.exit()
