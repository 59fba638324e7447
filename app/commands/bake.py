"""`irrsplat bake`: baked light for other programs; its own flags are in app/bake/arguments.py."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.bake import arguments
from irrsplat.app.commands.shared import flags, values
from irrsplat.app.commands.shared.command import Command


def add(commands: Any) -> None:
    """Add the flags of `irrsplat bake`."""
    words = "bake light into a lightmap or vertex colours"
    parser = commands.add_parser("bake", help=words, description=arguments.DESCRIPTION, epilog=arguments.EPILOG)
    flags.add_scene(parser)
    arguments.add(parser, values.number, values.count)
    flags.add_preset(parser, "default")
    flags.add_settings(parser, stages=("shadow", "gather", "splat", "examine"), besides=("placement", "warmup"))


def run(args: argparse.Namespace) -> int:
    """Run `irrsplat bake`."""
    from irrsplat.app.bake import command

    command.check(args)

    import irrsplat

    return command.run(irrsplat.load(args.scene, **vars(args.loading)), args)


COMMAND = Command(add, run)
