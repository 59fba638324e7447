"""`irrsplat view`: the viewer's window."""

from __future__ import annotations

import argparse
import os
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from irrsplat.app.commands.shared import flags, rendering
from irrsplat.app.common.terminal import say
from irrsplat.core.errors import IrrsplatError
from irrsplat.settings import preset

if TYPE_CHECKING:
    from irrsplat.scene.model import Scene


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "view",
        help="fly through a scene in a window",
        description="Open a scene in a window and fly through it. F1 lists all keys.",
        epilog="The viewer restores the window size of its last run.",
    )
    flags.add_scene(parser)
    flags.add_size(parser, None, "window size (default: the last one, at first 1280 720)")
    flags.add_preset(parser, "default")
    flags.add_cache(parser, " when the window closes")
    flags.add_cache_mode(parser)
    flags.add_camera(parser)
    flags.add_settings(parser)
    parser.set_defaults(run=run, path=None, frames=None)


def run(args: argparse.Namespace) -> int:
    from irrsplat.app.viewer import preferences

    if find_spec("imgui_bundle") is None:
        raise IrrsplatError(
            "the viewer needs the package imgui-bundle, which has no wheel for Intel Macs; irrsplat render works without it"
        )
    preferences.check_path(args.scene)
    scene = rendering.load(args)
    camera = rendering.camera(args, scene)
    remembered, notices = preferences.load()
    update = args.cache_mode == "update"
    if args.cache is not None:
        _check_cache(args, scene)
    from irrsplat.app.viewer import viewer

    size = tuple(args.size) if args.size else None
    closing_notice = viewer.run(
        scene, args.scene, size, remembered, camera, args.preset, args.values, notices, args.cache, args.loading, update
    )
    if closing_notice is not None:
        say(f"notice: {closing_notice}")
    return 0


def _check_cache(args: argparse.Namespace, scene: Scene) -> None:
    """Raise InputError for a cache file that cannot be written or has other settings or, unless updated, another scene."""
    from irrsplat.core import files
    from irrsplat.records import cache_file

    files.check_file(args.cache)
    if os.path.exists(args.cache):
        key = cache_file.key(scene.recentred.local, preset(args.preset, **args.values))
        cache_file.read(args.cache, key, args.cache_mode == "update")
