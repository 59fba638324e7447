"""`irrsplat info` and `irrsplat doctor`: what is in a scene, and on this machine."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.commands.shared import flags
from irrsplat.app.commands.shared.command import Command


def add(commands: Any) -> None:
    """The flags of `irrsplat info`."""
    parser = commands.add_parser("info", help="what is in a scene", description="Say what is in a scene.")
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="a path, or the name of a bundled scene (default: list those)")
    flags.add_loading(parser)


def run(args: argparse.Namespace) -> int:
    """`irrsplat info`: what is in a scene, or the table of bundled ones."""
    from irrsplat.app.commands.work import info as report

    report.scene(args.scene, args.loading) if args.scene is not None else report.bundled()
    return 0


def add_doctor(commands: Any) -> None:
    """`irrsplat doctor`, which has no flags."""
    words = "what OpenGL there is here, and what mends it"
    commands.add_parser("doctor", help=words, description="Say what OpenGL there is here, and what mends it.")


def run_doctor(args: argparse.Namespace) -> int:
    """`irrsplat doctor`: what OpenGL there is; 1 where it is not enough."""
    from irrsplat.app.commands.work import info as report

    return report.doctor()


COMMAND = Command(add, run)
DOCTOR = Command(add_doctor, run_doctor)
