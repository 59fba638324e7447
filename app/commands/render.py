"""`irrsplat render`: a scene, or a flight through it, to files."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from irrsplat.app.commands.shared import flags, rendering
from irrsplat.app.common.outputs import Outputs
from irrsplat.app.common.terminal import INTERRUPTED, fail, say
from irrsplat.core.errors import InputError
from irrsplat.settings import LEAST_TILE, MOST_TILE, preset

if TYPE_CHECKING:
    from irrsplat.app.common.false_colours import FalseColours
    from irrsplat.image.statistics import Statistics
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera

FALSE_COLOURED = ("light", "irradiance", "image", "direct", "indirect", "emission")
SAMPLES = 16  # samples per pixel of a picture without --samples; arrays have one, at the pixel's centre


def add(commands: Any) -> None:
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
        "--tile-size", type=flags.tile, metavar="N",
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
    group.add_argument("--fps", type=flags.rate, metavar="N", help="frames per second of a film (default: 30)")
    flags.add_settings(parser)
    parser.set_defaults(run=run)


def _add_false_colours(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "false colours", "in a .png, with isolines and a legend; the other flags require --falsecolor"
    )
    words = f"{', '.join(FALSE_COLOURED)} (default: light, the irradiance of all light on surfaces)"
    group.add_argument("--falsecolor", nargs="?", const="light", choices=FALSE_COLOURED, metavar="BUFFER", help=words)
    words = "upper end of the scale (default: a round number above nearly all visible values)"
    group.add_argument("--scale", type=flags.number, metavar="X", help=words)
    words = "logarithmic scale over this number of decades (default: linear)"
    group.add_argument("--log", type=flags.decades, metavar="DECADES", help=words)
    words = "lux (radiance: cd/m²), or W/m² (radiance: W/(m² sr)) weighted by luminance (default: lux)"
    group.add_argument("--unit", choices=("lux", "W/m2"), help=words)
    group.add_argument("--lines", choices=("on", "off"), help="isolines between the ten steps of the scale (default: on)")


# ---- before the work ---------------------------------------------------------------------------------------------------


def _check_files(args: argparse.Namespace) -> bool:
    """Return True if one of the outputs is a folder, which has the paper's figures.

    Raises InputError for unknown buffers, and for files of outputs, --stats and --cache that cannot be written.
    """
    from irrsplat.app.film import flight, video
    from irrsplat.image.frame import check_writable

    flies, folder = args.path is not None, False
    names = [flight.first_name(args, pattern) if flies else pattern for pattern in args.output]
    for name in names:
        if video.is_film(name):
            video.check(name, flies)
        else:
            folder |= not check_writable(name, _buffers(args), video.ENDINGS)
    rendering.check_kept_files(args, names)
    return folder


def _buffers(args: argparse.Namespace) -> list[str] | None:
    """Return the names in --buffers; None for all."""
    return None if args.buffers is None else [name.strip() for name in args.buffers.split(",")]


def _is_sampled(args: argparse.Namespace) -> bool:
    """True if a .png has SAMPLES samples per pixel: a single picture in plain colours, without --samples."""
    from irrsplat.renderer.memory import LARGE

    small = args.size[0] * args.size[1] < LARGE  # a larger picture would take twice the memory
    return args.path is None and small and "samples" not in args.values and args.falsecolor is None


def _has_arrays(args: argparse.Namespace) -> bool:
    """True if one of the outputs is an .exr or .npz."""
    return any(output.lower().endswith((".exr", ".npz")) for output in args.output)


def _check_frozen(args: argparse.Namespace) -> None:
    """Raise InputError for a command line with a frozen cache that also requests new records."""
    if args.cache is None:
        raise InputError(
            "--cache-mode frozen takes all records from a file; give --cache FILE as well, as irrsplat fill makes it"
        )
    if args.values.get("quality"):
        raise InputError("--quality gathers records, and --cache-mode frozen lets none be gathered; leave one of them out")


# ---- the work ----------------------------------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> int:
    """Render a scene, or a flight, to files.

    All checks precede the work; a failed output does not affect the others.
    """
    from irrsplat.app.common import false_colours
    from irrsplat.app.film import films
    from irrsplat.app.film import flight as flights

    has_folder, frozen = _check_files(args), args.cache_mode == "frozen"
    preset(args.preset, **args.values)
    figures = has_folder and not frozen
    coloured = false_colours.checked(args)
    films.check(args)
    if frozen:
        _check_frozen(args)
    if args.tile_size and args.falsecolor == "light":
        raise InputError("--tile-size and --falsecolor light do not go together; leave one of them out")

    import irrsplat
    from irrsplat.app.film import frames

    scene = rendering.load(args)
    camera = rendering.camera(args, scene)
    flight, made = (None, None) if args.path is None else films.plan(args, flights.plan(args, scene, args.output))
    # direct light alone requires whole views
    tile_size = 0 if args.falsecolor == "light" else args.tile_size
    made_with: dict[str, Any] = args.values | ({"samples": SAMPLES} if _is_sampled(args) and not _has_arrays(args) else {})
    outputs, unfinished = Outputs(), ""
    with irrsplat.Renderer(scene, tuple(args.size), args.preset, tile_size=tile_size, **made_with) as renderer:
        cache = rendering.load_cache(renderer, args) if args.cache is not None else None
        for notice in (*scene.notices, *renderer.notices):
            say(f"notice: {notice}")
        if flight is None or made is None:
            done = [_picture(args, renderer, camera, figures, coloured, outputs)]
            if done[0].get("interrupted"):
                unfinished = f"the files hold what {done[0].get('rounds', 0)} whole rounds gave"
        else:
            kept = "" if made.folder is None else made.pattern  # temporary files
            with rendering.round_progress(args) as on_frame:
                done, complete = frames.render(
                    renderer, flight, _buffers(args), figures, on_frame, outputs, coloured, frozen, kept
                )
            if not complete:
                unfinished = f"{len(done)} of {len(flight.numbers)} frames were written{', and no film' if made.names else ''}"
        if cache is not None and renderer.cache.count and not frozen:
            outputs.write(args.cache, partial(cache.save, renderer.save_cache))
        if flight is not None and made is not None:
            made.end(() if unfinished else flight.numbers, outputs)
    if frozen:
        _say_gaps(done)
    outputs.write_json(args.stats, done[0] if flight is None else {"frames": done})
    outputs.raise_failures()
    return fail(f"interrupted; {unfinished}", INTERRUPTED) if unfinished else _say_missing_light(done, flight is not None)


def _picture(
    args: argparse.Namespace,
    renderer: Renderer,
    camera: Camera,
    figures: bool,
    coloured: FalseColours | None,
    outputs: Outputs,
) -> Statistics:
    """Render a picture and write it to all outputs; return its statistics.

    Raises KeyboardInterrupt for Ctrl-C before the first round is complete.
    """
    from irrsplat.app.common import false_colours
    from irrsplat.image.frame import needed

    buffers, frozen = _buffers(args), args.cache_mode == "frozen"
    with rendering.round_progress(args) as on_frame:
        names = None if figures or coloured is not None else needed(args.output, buffers)
        frame = renderer.render(camera, progress=on_frame("", 0, 1), buffers=names, figures=figures, gather=not frozen)
    if frame.stats.get("interrupted") and not frame.stats.get("rounds") and not frozen:
        raise KeyboardInterrupt("interrupted before the first round was complete; nothing was written")
    picture, pngs = frame, [path for path in args.output if path.lower().endswith(".png")]
    if pngs and _has_arrays(args) and _is_sampled(args):
        if renderer.settings.quality:  # a further render ends the refinement
            picture = renderer.accumulate(renderer.frame(camera)[0], SAMPLES).read()
        else:
            renderer.change(renderer.settings.with_values({"samples": SAMPLES}))
            picture = renderer.render(camera, buffers=needed(pngs, buffers), gather=False)
    for path in args.output:
        shown = picture if path in pngs else frame
        outputs.write(path, partial(false_colours.save, coloured, path, shown, buffers, renderer, camera))
    return frame.stats


# ---- after the work ----------------------------------------------------------------------------------------------------


def _say_gaps(done: Sequence[Statistics]) -> None:
    """Print the number of these pictures with uncovered pixels, if any."""
    bare = [uncovered for stats in done if (uncovered := stats.get("uncovered", 0))]
    if bare:
        where = f"{len(bare)} of {len(done)} frames" if len(done) > 1 else "the picture"
        some = f"some pixels (at most {max(bare)})"
        say(f"notice: in {where} no record reaches {some}, which take the light of those around; fill the cache for this view")


def _say_missing_light(done: Sequence[Statistics], flies: bool) -> int:
    """Print notices on pictures with missing records or bounces; return the exit status. flies: True for frames of a flight."""
    from irrsplat.image.statistics import bounces_notice

    if short := sum(not stats.get("converged", True) and "uncovered" not in stats for stats in done):
        where = f"{short} of {len(done)} frames stopped" if flies else f"stopped after {done[0].get('rounds')} rounds"
        limit = "--max-records or --a" if any(stats.get("full") for stats in done) else "--a"
        say(f"notice: {where} before every pixel was covered; raise {limit}")
    if notice := next(filter(None, map(bounces_notice, done)), None):
        say(f"notice: {notice}")
    return 0
