"""`irrsplat desktop`: desktop menu entry."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.commands.shared.command import Command
from irrsplat.app.common.terminal import out


def add(commands: Any) -> None:
    """Add the flags of `irrsplat desktop`."""
    parser = commands.add_parser(
        "desktop",
        help="add irrsplat to the desktop menu, or remove it",
        description="Add irrsplat and its icon to the desktop menu of this user, or remove it.",
        epilog="For desktops that follow freedesktop.org. The files are in $XDG_DATA_HOME or ~/.local/share.",
    )
    parser.add_argument("what", choices=("install", "remove"), help="add or remove the menu entry")


def run(args: argparse.Namespace) -> int:
    """Install or remove the desktop menu entry."""
    from irrsplat.app.common import desktop_entry

    home = desktop_entry.data_home()
    done = desktop_entry.install(home) if args.what == "install" else desktop_entry.remove(home)
    for path in done:
        out(str(path))
    return 0


COMMAND = Command(add, run)
