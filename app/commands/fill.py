"""`irrsplat fill`: the records of a flight, to a cache file."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

from irrsplat.app.commands.shared import flags, rendering
from irrsplat.app.common.outputs import Outputs
from irrsplat.app.common.terminal import INTERRUPTED, fail, say
from irrsplat.settings import preset


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "fill",
        help="gather the records of a flight, for render --cache-mode frozen",
        description="Gather all records that the frames of a flight request, and write them to a cache file. Write no picture.",
        epilog="Use the size, preset and settings of the frames. Exit status as for render. Ctrl-C keeps the records; run the\n"
        "same command again to continue.",
    )
    flags.add_scene(parser)
    words = "cache file; new records are added to those of an existing file"
    parser.add_argument("--cache", metavar="FILE", required=True, help=words)
    flags.add_cache_mode(parser)
    flags.add_size(parser, 800)
    flags.add_preset(parser, "default")
    parser.add_argument("--stats", metavar="FILE.json", help="write records and coverage per frame to this file")
    flags.add_flight(parser, "the flight")
    flags.add_camera(parser)
    flags.add_settings(parser, stages=flags.STAGES[:-1])  # picture settings too, so that a film's flags are valid here
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Gather the records of a flight into a cache file."""
    rendering.check_kept_files(args)
    preset(args.preset, **args.values)

    import irrsplat
    from irrsplat.app.film import fill as filling
    from irrsplat.app.film import flight as flights

    scene = rendering.load(args)
    flight = flights.plan(args, scene)
    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, tile_size=0, **args.values) as renderer:
        cache = rendering.load_cache(renderer, args)
        for notice in (*scene.notices, *renderer.notices):
            say(f"notice: {notice}")
        with rendering.round_progress(args) as on_frame:
            done = filling.fill(renderer, flight, on_frame, partial(cache.save, renderer.save_cache))
        outputs = Outputs()
        if renderer.cache.count:
            outputs.write(args.cache, partial(cache.save, renderer.save_cache))
        outputs.write_json(args.stats, filling.statistics(done, renderer.cache.count))
    outputs.raise_failures()
    if done.interrupted:
        return fail(f"interrupted; {len(done.frames)} of {len(flight.numbers)} frames have their records", INTERRUPTED)
    filling.warn(done)
    return 0
