"""`irrsplat info` and `irrsplat doctor`: contents of a scene, and state of this machine."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.commands.shared import flags


def add(commands: Any) -> None:
    """Add the flags of `irrsplat info`."""
    parser = commands.add_parser("info", help="print the content of a scene", description="Print the content of a scene.")
    parser.add_argument(
        "scene", nargs="?", metavar="SCENE", help="a path or the name of a bundled scene (default: list the bundled scenes)"
    )
    flags.add_loading(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the contents of a scene, or the table of bundled scenes."""
    from irrsplat.app.commands.work import info as report

    report.scene(args.scene, args.loading) if args.scene is not None else report.bundled()
    return 0


def add_doctor(commands: Any) -> None:
    """Add `irrsplat doctor`, which has no flags."""
    words = "check OpenGL on this machine"
    description = "Print the OpenGL version of this machine, the result of the self-test, and remedies."
    commands.add_parser("doctor", help=words, description=description).set_defaults(run=run_doctor)


def run_doctor(args: argparse.Namespace) -> int:
    """Print the available OpenGL; return 1 if it does not suffice."""
    from irrsplat.app.commands.work import info as report

    return report.doctor()
