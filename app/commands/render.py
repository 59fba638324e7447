"""`irrsplat render`: a scene, or a flight through it, to files."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from irrsplat.app.commands.shared import flags, rendering, values
from irrsplat.app.commands.shared.command import Command
from irrsplat.app.common.outputs import Outputs
from irrsplat.app.common.terminal import INTERRUPTED, fail, say
from irrsplat.core.errors import InputError
from irrsplat.settings import LEAST_TILE, MOST_TILE

if TYPE_CHECKING:
    from irrsplat.image.statistics import Statistics

FALSE_COLOURED = ("light", "irradiance", "image", "direct", "indirect", "emission")
SAMPLES = 16  # samples per pixel of a picture without --samples; arrays have one, at the pixel's centre


def add(commands: Any) -> None:
    """Add the flags of `irrsplat render`."""
    parser = commands.add_parser(
        "render",
        help="render a scene to files",
        description="Render a scene to files until no pixel requests more records.",
        epilog="A flag overrides the preset. Exit status: 0 success; 2 error in the command line or a file; 1 any other error;\n"
        "130 interrupted (the last completed round, or the completed frames of a path, are written).",
    )
    add = parser.add_argument
    flags.add_scene(parser)
    add(
        "-o", "--output", metavar="OUT", action="append", required=True,
        help="output, may be repeated: .png (the picture, 16 samples per pixel by default), .exr (a float32 layer per buffer), "
        ".npz (all buffers, records and stats), or a folder (a PNG per buffer, and the figures of the paper). For a flight: "
        "{frame} or {frame:04d} is the frame number; an .mp4 is a film (extra: pip install 'irrsplat[video]')",
    )  # fmt: skip
    flags.add_size(parser, 800)
    add(
        "--tile-size", type=values.tile, metavar="N",
        help=f"render in tiles of NxN pixels ({LEAST_TILE}..{MOST_TILE}), with less memory and more time; 0: never "
        "(default: tiles of 1024 if memory or OpenGL's largest texture is too small)",
    )  # fmt: skip
    flags.add_preset(parser, "default")
    add("--buffers", metavar="NAME,…", help="buffers in .exr, .npz and folders (default: all)")
    flags.add_cache(parser)
    add(
        "--cache-mode", choices=("keep", "frozen", "update"), default="keep", metavar="WORD",
        help="keep: add records to those of --cache; frozen: change no records and no file, so that a frame does not depend on "
        "other frames; update: as keep, but accept a file of another state of the scene, and gather affected records again "
        "(default: keep)",
    )  # fmt: skip
    add("--stats", metavar="FILE.json", help="write records, rounds, times and settings to this file")
    flags.add_camera(parser)
    _add_false_colours(parser)
    group = flags.add_flight(parser, "a flight instead of one picture; frames share records and the first exposure")
    group.add_argument("--fps", type=values.rate, metavar="N", help="frames per second of a film (default: 30)")
    flags.add_settings(parser)


def _add_false_colours(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "false colours", "in a .png, with isolines and a legend; the other flags require --falsecolor"
    )
    words = f"{', '.join(FALSE_COLOURED)} (default: light, the irradiance of all light on surfaces)"
    group.add_argument("--falsecolor", nargs="?", const="light", choices=FALSE_COLOURED, metavar="BUFFER", help=words)
    words = "upper end of the scale (default: a round number above nearly all visible values)"
    group.add_argument("--scale", type=values.number, metavar="X", help=words)
    words = "logarithmic scale over this number of decades (default: linear)"
    group.add_argument("--log", type=values.decades, metavar="DECADES", help=words)
    words = "lux (radiance: cd/m²), or W/m² (radiance: W/(m² sr)) weighted by luminance (default: lux)"
    group.add_argument("--unit", choices=("lux", "W/m2"), help=words)
    group.add_argument("--lines", choices=("on", "off"), help="isolines between the ten steps of the scale (default: on)")


# ---- before the work ---------------------------------------------------------------------------------------------------


def check_files(args: argparse.Namespace) -> None:
    """Raise InputError for unknown buffers, and for files of outputs, --stats and --cache that cannot be written."""
    from irrsplat.app.film import flight, video
    from irrsplat.image.frame import check_writable

    names = [flight.first_name(args, pattern) if flight.flies(args) else pattern for pattern in args.output]
    for name in names:
        if video.is_film(name):
            video.check(name, flight.flies(args))
        else:
            check_writable(name, _buffers(args), video.ENDINGS)
    rendering.check_kept_files(args, names)


def _buffers(args: argparse.Namespace) -> list[str] | None:
    """Return the names in --buffers; None for all."""
    return None if args.buffers is None else [name.strip() for name in args.buffers.split(",")]


def _check_frozen(args: argparse.Namespace) -> None:
    """Raise InputError for a command line with a frozen cache that also requests new records."""
    if args.cache is None:
        raise InputError(
            "--cache-mode frozen takes all records from a file; give --cache FILE as well, as irrsplat fill makes it"
        )
    if args.values.get("quality"):
        raise InputError("--quality gathers records, and --cache-mode frozen lets none be gathered; leave one of them out")


def _has_folder(args: argparse.Namespace) -> bool:
    """True if one of the outputs is a folder, which has the paper's figures."""
    from irrsplat.app.film import flight, video
    from irrsplat.image.frame import check_writable

    names = [flight.first_name(args, pattern) for pattern in args.output] if flight.flies(args) else args.output
    return "" in [check_writable(name) for name in names if not video.is_film(name)]


# ---- the work ----------------------------------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> int:
    """Render a scene, or a flight, to files.

    All checks precede the work; a failed output does not affect the others.
    """
    from irrsplat import settings
    from irrsplat.app.common import false_colours
    from irrsplat.app.film import films, frames
    from irrsplat.app.film import flight as flights
    from irrsplat.image.frame import needed
    from irrsplat.lighting.gl_limits import LARGE

    settings.preset(args.preset, **args.values)
    buffers, keeps = _buffers(args), args.cache_mode == "frozen"
    with_figures = _has_folder(args) and not keeps
    coloured = false_colours.checked(args)
    films.check(args)
    if keeps:
        _check_frozen(args)
    if args.tile_size and args.falsecolor == "light":
        raise InputError("--tile-size and --falsecolor light do not go together; leave one of them out")

    import irrsplat

    scene = irrsplat.load(args.scene, **vars(args.loading))
    camera, flight, made = rendering.camera(args, scene), None, None
    if flights.flies(args):
        flight, made = films.plan(args, flights.with_outputs(flights.plan(args, scene), args.output))
    # direct light alone requires whole views
    tile_size = 0 if args.falsecolor == "light" else args.tile_size
    tiles = {} if tile_size is None else {"tile_size": tile_size}
    small = args.size[0] * args.size[1] < LARGE  # a larger picture would take twice the memory
    pictures_sampled = flight is None and small and "samples" not in args.values and coloured is None
    arrays = any(output.lower().endswith((".exr", ".npz")) for output in args.output)
    sampled = {"samples": SAMPLES} if pictures_sampled and not arrays else {}
    made_with = {"preset": args.preset, **tiles, **args.values, **sampled}
    with irrsplat.Renderer(scene, size=tuple(args.size), **made_with) as renderer:
        cache = rendering.load_cache(renderer, args) if args.cache is not None else None
        for notice in (*scene.notices, *renderer.notices):
            say(f"notice: {notice}")
        outputs, how = Outputs(), dict[str, Any]()
        with rendering.round_progress(args) as on_round:
            if flight is not None:
                how = {"frozen": keeps, "kept": "" if made is None else made.temporary}
                done, complete = frames.render(renderer, flight, buffers, with_figures, on_round, outputs, coloured, **how)
            else:
                needed_buffers = None if with_figures or coloured is not None else needed(args.output, buffers)
                how = {"gather": False} if keeps else {"figures": with_figures}
                frame = renderer.render(camera, progress=on_round, buffers=needed_buffers, **how)
        if flight is None and frame.stats.get("interrupted") and not frame.stats.get("rounds") and not keeps:
            return fail("interrupted before the first round was complete; nothing was written", INTERRUPTED)
        pngs = [path for path in args.output if path.lower().endswith(".png")]
        if arrays and pngs and pictures_sampled and renderer.settings.quality:  # a further render ends the refinement
            picture = renderer.accumulate(renderer.frame(camera)[0], SAMPLES).read()
        elif arrays and pngs and pictures_sampled:
            renderer.change(renderer.settings.with_values({"samples": SAMPLES}))
            picture = renderer.render(camera, buffers=needed(pngs, buffers), gather=False)
        elif flight is None:
            picture = frame
        for path in args.output if flight is None else ():
            shown = picture if path in pngs else frame
            outputs.write(path, partial(false_colours.save, coloured, path, shown, buffers, renderer, camera))
        if cache is not None and renderer.cache.count and not keeps:
            outputs.write(args.cache, partial(cache.save, renderer.save_cache))
        if flight is not None and made is not None:
            if complete:
                made.write(flight, outputs)
            made.release()
    if keeps:
        _say_gaps([frame.stats] if flight is None else done)
    if flight is None:
        return _end_of_render(args, frame.stats, outputs)
    unfinished = None if complete else f"{len(done)} of {len(flight.numbers)} frames were written"
    if unfinished is not None and made is not None:
        unfinished += ", and no film"
    return _end_of_path(args, done, unfinished, outputs)


# ---- after the work ----------------------------------------------------------------------------------------------------


def _end_of_render(args: argparse.Namespace, stats: Statistics, outputs: Outputs) -> int:
    """Write a picture's statistics on request, print its gaps, and return the exit status.

    Raises IrrsplatError if one of the `outputs` failed.
    """
    rendering.write_stats(args, stats, outputs)
    outputs.raise_failures()
    if stats.get("interrupted"):
        return fail(f"interrupted; the files hold what {stats.get('rounds', 0)} whole rounds gave", INTERRUPTED)
    if not stats.get("converged", True) and "uncovered" not in stats:
        say(f"notice: stopped after {stats.get('rounds')} rounds {_end_in_words([stats])}")
    if (notice := _bounces_notice([stats])) is not None:
        say(f"notice: {notice}")
    return 0


def _end_of_path(args: argparse.Namespace, done: list[Statistics], interrupted: str | None, outputs: Outputs) -> int:
    """Finish a path with the frames `done`, as _end_of_render. interrupted: progress in words; None for a complete path."""
    rendering.write_stats(args, {"frames": done}, outputs)
    outputs.raise_failures()
    if interrupted is not None:
        return fail(f"interrupted; {interrupted}", INTERRUPTED)
    if short := sum(not stats.get("converged", True) and "uncovered" not in stats for stats in done):
        say(f"notice: {short} of {len(done)} frames stopped {_end_in_words(done)}")
    if (notice := _bounces_notice(done)) is not None:
        say(f"notice: {notice}")
    return 0


def _say_gaps(done: Sequence[Statistics]) -> None:
    """Print the number of these pictures with uncovered pixels, if any."""
    bare = [uncovered for stats in done if (uncovered := stats.get("uncovered", 0))]
    if bare:
        where = f"{len(bare)} of {len(done)} frames" if len(done) > 1 else "the picture"
        some = f"some pixels (at most {max(bare)})"
        say(f"notice: in {where} no record reaches {some}, which take the light of those around; fill the cache for this view")


def _bounces_notice(stats: Sequence[Statistics]) -> str | None:
    """Return the first notice on missing bounces of pictures with `stats`, or None."""
    from irrsplat.image.statistics import bounces_notice

    return next(filter(None, map(bounces_notice, stats)), None)


def _end_in_words(stats: Sequence[Statistics]) -> str:
    """Return the end of the notice on incomplete pictures: the limit to raise."""
    full = any(one.get("full") for one in stats)
    return f"before every pixel was covered; raise {'--max-records or ' if full else ''}--a"


COMMAND = Command(add, run, check_files=check_files)
