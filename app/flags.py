"""The command line's grammar: every flag with its range and default, the settings' from irrsplat.settings."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from irrsplat.app.bake import arguments as baking
from irrsplat.app.common.parser import Mistakes, Parser
from irrsplat.app.common.version import version
from irrsplat.app.film.words import CACHE_MODES, QUALITIES
from irrsplat.core.load_options import CREASE_ANGLE, UP_AXES, LoadOptions
from irrsplat.settings import PRESETS, SETTINGS, Declaration

DEFAULT_SCENE = "cornell"
FALSE_COLOURED = ("light", "irradiance", "image", "direct", "indirect", "emission")
MOST_DECADES = 9
SHELLS = ("bash", "zsh", "fish")
_BYTES = {"": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9}
_OF_CAMERAS = {"camera", "eye", "target", "up", "fov", "path", "turntable", "frames"}
_STAGES = ("shadow", "gbuffer", "gather", "splat", "examine", "composite", "view")  # the order of the frame


def number(text: str) -> float:
    """A finite number, for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, not '{text}'")
    return value


def pixels(text: str) -> int:
    """A side of an image, for argparse."""
    return _whole(text, 1, 999_999_999, "a whole number of pixels, at least 1")


def samples(text: str) -> int:
    """A number of samples, for argparse."""
    return _whole(text, 2, 999_999_999, "a whole number of samples, at least 2")


def count(text: str) -> int:
    """A number of things, for argparse."""
    return _whole(text, 1, 999_999_999, "a whole number, at least 1")


def decades(text: str) -> int:
    """A number of powers of ten, for argparse."""
    return _whole(text, 1, MOST_DECADES, f"a whole number from 1 to {MOST_DECADES}")


def _whole(text: str, low: int, high: int, expected: str) -> int:
    if not re.fullmatch(r"\d{1,9}", text, re.ASCII) or not low <= int(text) <= high:
        raise argparse.ArgumentTypeError(f"expected {expected}, not '{text}'")
    return int(text)


def rate(text: str) -> float:
    """Frames per second, for argparse."""
    value = number(text)
    if not 0.1 <= value <= 240.0:
        raise argparse.ArgumentTypeError(f"expected frames per second, 0.1 to 240, not '{text}'")
    return value


def turns(text: str) -> int:
    """A number of frames of a full circle, for argparse."""
    return _whole(text, 2, 999_999, "a whole number of frames, 2 to 999999")


def frames(text: str) -> tuple[int, int | None]:
    """Frames A:B of a path as (A, B), for argparse; half open as a Python slice, A: 0 and B: None where left out."""
    match = re.fullmatch(r"(\d{0,9}):(\d{0,9})", text, re.ASCII)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected A:B, the frames from A to before B, either may be left out, not '{text}'")
    start, stop = int(match[1] or 0), int(match[2]) if match[2] else None
    if stop is not None and start >= stop:
        raise argparse.ArgumentTypeError(f"'{text}' holds no frame: B is not among them; give a B greater than A")
    return start, stop


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """The checked command line: `command`, its arguments, `loading` where there is a scene, and for render, view and verify
    `values`, the settings given by flag.

    Raises InputError, one line, for all that is wrong with it; SystemExit(0) after --help and --version.
    """
    args, mistakes = read(argv)
    mistakes.tell()
    return args


def read(argv: Sequence[str]) -> tuple[argparse.Namespace, Mistakes]:
    """The same, and what is wrong with it instead of an error; a flag with a wrong value has None. Raises InputError only where
    no command can be made out."""
    mistakes = Mistakes()
    top = build(mistakes)
    args, rest = top.parse_known_args(list(_spelled_out(argv)))
    page = f"{top.prog} {args.command} --help"
    for word in rest:
        mistakes.add(f"unexpected '{word}'", page)
    if hasattr(args, "up_axis") and not mistakes.arguments & {"up_axis", "crease_angle", "time"}:
        with mistakes.gathered():
            args.loading = LoadOptions(args.up_axis, args.crease_angle, args.time, args.sky, tuple(args.allow))
    if args.command in ("render", "fill", "view", "verify", "measure", "bake"):
        args.values = {}
        for name, declaration in SETTINGS.items():
            if (text := getattr(args, "set_" + name, None)) is not None:
                with mistakes.gathered():
                    args.values[name] = declaration.parse(text)
        if hasattr(args, "camera") and not mistakes.arguments & _OF_CAMERAS:
            for wrong in _wrong_with_the_camera(args):
                mistakes.add(wrong)
    if args.command == "verify" and args.curve and args.techniques:
        mistakes.add("--curve and --techniques are two different series; give one of them")
    return args, mistakes


def build(mistakes: Mistakes | None = None) -> Parser:
    """The whole grammar; what is wrong with a command line goes to `mistakes`."""
    top = Parser(mistakes, prog="irrsplat", description="Indirect light for diffuse scenes by irradiance cache splatting.")
    top.add_argument("--version", action=_Version, help="print the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)
    _add_view(commands)
    _add_render(commands)
    _add_fill(commands)
    tools = _add_cache_tools(commands)
    _add_measure(commands)
    _add_bake(commands)
    _add_bench(commands)
    info = commands.add_parser("info", help="what is in a scene", description="Say what is in a scene.")
    info.add_argument("scene", nargs="?", metavar="SCENE", help="a path, or the name of a bundled scene (default: list those)")
    _add_loading(info)
    commands.add_parser(
        "doctor",
        help="what OpenGL there is here, and what mends it",
        description="Say what OpenGL there is here, and what mends it.",
    )
    _add_verify(commands)
    _add_completion(commands)
    _add_desktop(commands)
    for command in (*commands.choices.values(), *tools.choices.values()):
        command.mistakes = top.mistakes
    return top


def _add_render(commands: Any) -> None:
    parser = commands.add_parser(
        "render",
        help="render a scene to files",
        description="Render a scene, without a window, until no pixel asks for more records.",
        epilog="A flag wins over the preset. Exit status: 0 done; 2 the command line or a file is wrong; 1 anything else; "
        "130 interrupted\n(the last completed round is written; of a path, the frames that were done).",
    )
    add = parser.add_argument
    _add_scene(parser)
    add(
        "-o", "--output", metavar="OUT", action="append", required=True,
        help="may be repeated: .png (the picture), .exr (a float32 layer per buffer), .npz (all buffers, records and stats), "
        "or a folder (a PNG per buffer, and the paper's figures); of a flight, {frame} or {frame:04d} in it is the number, and "
        ".mp4, .webm and .gif are films (extra: pip install 'irrsplat[video]')",
    )  # fmt: skip
    _add_size(parser, 800)
    _add_preset(parser, "default")
    add("--buffers", metavar="NAME,…", help="only these buffers in .exr, .npz and folders (default: all)")
    _add_cache(parser)
    add(
        "--cache-mode", choices=CACHE_MODES, default="keep", metavar="WORD",
        help="keep: records are added to those of --cache; frozen: none is added or changed, nor the file, so that a frame "
        "is the same, whichever are rendered before it and by whom; update: as keep, and where the file is of another state "
        "of the scene, what that concerns is gathered again (default: keep)",
    )  # fmt: skip
    add("--stats", metavar="FILE.json", help="write records, rounds, times and settings to this file")
    _add_camera(parser)
    _add_files(parser)
    _add_false_colours(parser)
    group = _add_flight(parser, "a flight instead of one picture; records and the first frame's exposure are kept")
    words = "keep frames that are written already, and render the others; of a film, what was stopped"
    group.add_argument("--resume", action="store_true", help=words)
    group.add_argument("--fps", type=rate, metavar="N", help="frames per second of a film (default: 30)")
    words = f"{', '.join(QUALITIES)}: how much of the pictures a film keeps (default: good)"
    group.add_argument("--film-quality", choices=QUALITIES, metavar="WORD", help=words)
    _add_settings(parser)


def _add_flight(parser: argparse.ArgumentParser, words: str) -> Any:
    group = parser.add_argument_group("path", words)
    group.add_argument("--path", metavar="FILE", help="its cameras: a text file, looked for here, then in the scene's folder")
    words = "instead of a path: a full circle of N frames around what the camera looks at, which goes on without a seam"
    group.add_argument("--turntable", type=turns, metavar="N", help=words)
    group.add_argument("--frames", type=frames, metavar="A:B", help="frames A to B - 1; either may be left out (default: all)")
    words = "have it done by the workers of the Dask scheduler at this address; needs the extra: pip install 'irrsplat[cluster]'"
    group.add_argument("--on", type=address, metavar="tcp://HOST:PORT", help=words)
    return group


def _add_fill(commands: Any) -> None:
    parser = commands.add_parser(
        "fill",
        help="gather the records of a flight, for render --cache-mode frozen",
        description="Gather all records that the frames of a flight ask for into a cache file; no picture is written.",
        epilog="Give the size, preset and settings that the frames are to have. Exit status as for render; Ctrl-C keeps what is\n"
        "there, and the same command goes on from it.",
    )
    _add_scene(parser)
    words = "the file that the records are kept in; where it is there, they are added to its own"
    parser.add_argument("--cache", metavar="FILE", required=True, help=words)
    words = (
        "keep: the file must be of this scene; update: where it was made for another state of it, what that concerns is gathered"
    )
    parser.add_argument(
        "--cache-mode", choices=("keep", "update"), default="keep", metavar="WORD", help=f"{words} again (default: keep)"
    )
    _add_size(parser, 800)
    _add_preset(parser, "default")
    parser.add_argument("--stats", metavar="FILE.json", help="write records and the coverage of each frame to this file")
    _add_flight(parser, "the flight; one of --path and --turntable")
    _add_camera(parser)
    _add_settings(parser, stages=_STAGES[:-1])  # those of the picture too, so that a film's flags are right here


def _add_files(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("files", "what they hold").add_argument
    words = "a .png shows all buffers side by side, with names and scales"
    add("--contact-sheet", action="store_true", help=words)
    add("--png-bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="of a channel, in .png and folders (default: 8)")
    words = "of the layers in an .exr: irrsplat, the buffers' names; blender, as ViewLayer.Combined.R (default: irrsplat)"
    add("--exr-names", choices=("irrsplat", "blender"), default="irrsplat", metavar="WHOSE", help=words)


def _add_cache_tools(commands: Any) -> Any:
    words = "what is in files of records, several of them as one, and one with fewer records"
    parser = commands.add_parser("cache", help=words, description=f"{words[0].upper()}{words[1:]}.")
    tools = parser.add_subparsers(dest="tool", metavar="TOOL", required=True, parser_class=Parser)
    info = tools.add_parser(
        "info", help="what is in them", description="Say what record caches were made for, and what they hold."
    )
    info.add_argument("files", nargs="+", metavar="FILE", help="record caches")
    info.add_argument("--json", dest="as_json", action="store_true", help="as JSON, with all settings")
    merge = tools.add_parser(
        "merge",
        help="several as one",
        description="Write one cache with the records of several that were made apart, for one scene with one set of settings.",
        epilog="All records of the first stay; of each further one those whose places no others serve. Limits of radii,\n"
        "where records contradict each other, are found by whoever draws with the cache first.",
    )
    merge.add_argument("files", nargs="+", metavar="FILE", help="record caches")
    prune = tools.add_parser(
        "prune",
        help="one with fewer records",
        description="Write a cache without records whose places others serve.",
        epilog="With --most those go first that the others serve best, as many as must, and no more.",
    )
    prune.add_argument("file", metavar="FILE", help="a record cache")
    words = "so many records at most, or so large a file, such as 20MB (default: only what others serve goes)"
    prune.add_argument("--most", type=most, metavar="N", help=words)
    for tool in (merge, prune):
        tool.add_argument("-o", "--output", required=True, metavar="OUT", help="the cache to write; may be one of those read")
    return tools


def address(text: str) -> str:
    """The address of a scheduler, for argparse."""
    if not re.fullmatch(r"(tcp|tls|ws|wss|ucx|inproc)://\S+", text):
        raise argparse.ArgumentTypeError(f"expected a scheduler's address such as tcp://farm:8786, not '{text}'")
    return text


def most(text: str) -> tuple[int, bool]:
    """A bound of records, (N, False), or of a file's size in bytes, (N, True), for argparse."""
    match = re.fullmatch(r"(\d{1,9}|\d{1,6}\.\d{1,3}(?=[kMG]))(kB|MB|GB|)", text, re.ASCII)
    if match is None or float(match[1]) <= 0.0:
        raise argparse.ArgumentTypeError(f"expected a number of records, or a size such as 20MB, not '{text}'")
    return int(float(match[1]) * _BYTES[match[2]]), bool(match[2])


def _add_false_colours(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "false colours", "of a .png, with isolines and a legend; all but the first with --falsecolor"
    )
    words = f"{', '.join(FALSE_COLOURED)} (default: light, all that falls on surfaces)"
    group.add_argument("--falsecolor", nargs="?", const="light", choices=FALSE_COLOURED, metavar="BUFFER", help=words)
    words = "upper end of the scale (default: a round number above nearly all that is seen)"
    group.add_argument("--scale", type=number, metavar="X", help=words)
    group.add_argument("--log", type=decades, metavar="DECADES", help="logarithmic, over so many powers of ten (default: linear)")
    words = "lux (of radiance: cd/m²), or W/m² (W/(m² sr)) weighted as luminance is (default: lux)"
    group.add_argument("--unit", choices=("lux", "W/m2"), help=words)
    group.add_argument("--lines", choices=("on", "off"), help="isolines between the ten steps of the scale (default: on)")


def _add_view(commands: Any) -> None:
    parser = commands.add_parser(
        "view",
        help="fly through a scene in a window",
        description="Open a window on a scene and fly through it; F1 there shows all keys.",
        epilog="Window size, preset and settings are remembered from the last time; a flag wins, and --preset begins anew.",
    )
    _add_scene(parser)
    _add_size(parser, None, "window size (default: the last one, at first 1280 720)")
    _add_preset(parser, None)
    _add_cache(parser, " when the window closes")
    _add_camera(parser)
    _add_settings(parser)
    parser.set_defaults(path=None, turntable=None, frames=None)


def _add_measure(commands: Any) -> None:
    parser = commands.add_parser(
        "measure",
        help="irradiance or illuminance on a plane, without a camera",
        description="Measure the light that falls on a plane, or on single points: of lamps with their shadows, of emitters and\n"
        "sky, and by all bounces. Nothing is interpolated, and no camera is needed.",
        epilog="Points within solids, and points that a surface lies on, are said to be so and do not count in mean, minimum,\n"
        "maximum and uniformity.",
    )
    _add_scene(parser)
    add = parser.add_argument
    where = parser.add_argument_group("where", "one of --plane, --height, --line and --point")
    axes = ("X0", "Y0", "Z0", "UX", "UY", "UZ", "VX", "VY", "VZ")
    words = "a corner and two edges, metres; measured from the side to which u × v points"
    where.add_argument("--plane", nargs=9, type=number, metavar=axes, help=words)
    words = "level, so many metres above the lowest point of the scene, over all of it; measured from above"
    where.add_argument("--height", type=number, metavar="M", help=words)
    words = "points along a line between two places, both among them; metres"
    where.add_argument("--line", nargs=6, type=number, metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"), help=words)
    words = "the direction that the points of a line face (default: up)"
    where.add_argument("--facing", nargs=3, type=number, metavar=("NX", "NY", "NZ"), help=words)
    words = "a point and the direction that it faces; may be repeated"
    where.add_argument("--point", nargs=6, type=number, action="append", metavar=("X", "Y", "Z", "NX", "NY", "NZ"), help=words)
    words = (
        "side of the plane's cells, with a point in the middle of each, or step along the line; at most (default: EN 12464-1's)"
    )
    where.add_argument("--grid", type=number, metavar="M", help=words)
    where.add_argument("--margin", type=number, metavar="M", help="leave out that much along the plane's edges (default: 0)")
    add(
        "-o", "--output", metavar="OUT",
        help="a table in a .csv, or arrays in a .npz; - is CSV on stdout (default: a table to read on stdout)",
    )  # fmt: skip
    add(
        "--unit",
        choices=("W/m2", "lux"),
        default="W/m2",
        help="irradiance of red, green and blue, or illuminance (default: W/m2)",
    )
    add("--lux", dest="unit", action="store_const", const="lux", help="the same as --unit lux")
    add("--stats", metavar="FILE.json", help="write mean, minimum, maximum, uniformity and settings to this file")
    _add_preset(parser, "reference")
    _add_settings(parser, stages=("shadow", "gather"))


def _add_bake(commands: Any) -> None:
    words = "light into a lightmap, vertex colours or probes"
    parser = commands.add_parser("bake", help=words, description=baking.DESCRIPTION, epilog=baking.EPILOG)
    _add_scene(parser)
    baking.add(parser, number, count)
    _add_preset(parser, "default")
    _add_settings(parser, stages=("shadow", "gather", "splat", "examine"), besides=("placement", "warmup", "coarse"))
    _add_setting(parser.add_argument_group("settings of composite"), SETTINGS["pixel_light_samples"])


def _add_verify(commands: Any) -> None:
    parser = commands.add_parser(
        "verify",
        help="hold a rendering against a path tracer",
        description="Render a scene and tell how far its indirect light is from a path tracer's.",
        epilog="Needs the extra: pip install 'irrsplat[reference]'. The truth of a view is traced once and kept in the user's\n"
        "cache folder, or in the one that IRRSPLAT_CACHE names.",
    )
    _add_scene(parser)
    add = parser.add_argument
    _add_size(parser, 200)
    add("--samples", type=samples, default=2048, metavar="N", help="rays of each kind a pixel, at least (default: 2048)")
    add(
        "--truth", choices=("trace", "gather"), default="trace",
        help="trace: by Mitsuba; gather: the renderer's own fine gather at 1000 pixels, without the extra (default: trace)",
    )  # fmt: skip
    add("--curve", action="store_true", help="error against the number of records, for several a, beside paper's")
    add("--techniques", action="store_true", help="error with each technique switched off, and as published")
    _add_preset(parser, "default")
    add(
        "-o", "--output", metavar="OUT",
        help="truth, picture and error: side by side in a .png, or one file each in a folder (no ending); with --curve, its plot",
    )  # fmt: skip
    _add_camera(parser)
    _add_settings(parser, besides=("samples",))  # errors are those of pixels' centres, and the flag is another one here
    parser.set_defaults(path=None, turntable=None, frames=None)


def _add_bench(commands: Any) -> None:
    parser = commands.add_parser(
        "bench",
        help="time it against the algorithm as published, and against others",
        description="Time scenes: from an empty cache, from a kept one, turned, relit, and in flight; and tell the errors.",
        epilog="Truths that errors are told by are gathered once and kept in the user's cache folder, or in the one that\n"
        "IRRSPLAT_CACHE names. --peers needs the extra: pip install 'irrsplat[peers]'.",
    )
    add = parser.add_argument
    add("scenes", nargs="*", metavar="SCENE", help="paths, or names of bundled scenes (default: cornell-paper; --peers: cornell)")
    words = "image size in pixels, may be repeated (default: 800 800; --peers: 400 400)"
    _add_size(parser, None, words, action="append")
    words = "may be repeated (default: default; for cornell-paper, paper as well)"
    _add_preset(parser, None, words, action="append")
    _add_loading(parser)
    add("--bounces", metavar="N|all", default="1", help="indirect bounces (default: 1, as the paper has it)")
    add("--flight", choices=("on", "off"), default="on", help="fly through the viewer's window as well (default: on)")
    add("--flicker", action="store_true", help="how far light changes from frame to frame in flight instead, all bounces")
    add("--json", metavar="FILE", help="write the results to this file as well")
    add("--compare", metavar="FILE", help="ratios of time against an earlier run's --json")
    add("--peers", action="store_true", help=f"time against error instead, beside {_peers()}")
    add("--growth", action="store_true", help="time and memory against triangles and pixels instead, some minutes long")
    add("--moving", action="store_true", help="errors while meshes and lamps are carried through cornell and atrium instead")
    add(
        "--counted",
        action="store_true",
        help="with --moving: ticks of so many rays, not of so many seconds, on any machine",
    )
    add("--quick", action="store_true", help="with --growth: a short series of small ones")
    add("-o", "--output", metavar="FILE.png", help="with --peers or --growth: the plot")


def _add_completion(commands: Any) -> None:
    parser = commands.add_parser(
        "completion",
        help="the script that makes Tab complete these commands",
        description="Print the script that makes a shell complete commands, flags, scenes, presets and cameras at Tab.",
        epilog='bash and zsh: eval "$(irrsplat completion bash)" in ~/.bashrc, or zsh in ~/.zshrc, after compinit.\n'
        "fish: irrsplat completion fish > ~/.config/fish/completions/irrsplat.fish",
    )
    parser.add_argument("shell", choices=SHELLS, help="for which shell")


def _add_desktop(commands: Any) -> None:
    parser = commands.add_parser(
        "desktop",
        help="irrsplat in the desktop's menu, with its icon",
        description="Put irrsplat into the menu of this user's desktop, or take it out again.",
        epilog="For desktops that follow freedesktop.org; files go below $XDG_DATA_HOME, or ~/.local/share.",
    )
    parser.add_argument("what", choices=("install", "remove"), help="put it there, or take it away")


def _peers() -> str:
    try:
        from irrsplat.app.bench.peers.table import others
    except ModuleNotFoundError:  # the other commands work without the benchmark
        return "other renderers"
    return others()


def _add_scene(parser: argparse.ArgumentParser) -> None:
    words = "a path, or a bundled scene's name (default: cornell)"
    parser.add_argument("scene", nargs="?", metavar="SCENE", default=DEFAULT_SCENE, help=words)
    _add_loading(parser)


def _add_loading(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "reading the scene", "of files that say nothing about it; a .scene heeds --sky and --allow alone"
    )
    add = group.add_argument
    add("--up-axis", choices=UP_AXES, default="auto", help="which axis points up (default: auto, by format and exporter)")
    words = "edges between triangles that meet at less are smooth, where a file has no normals"
    add("--crease-angle", type=number, default=CREASE_ANGLE, metavar="DEG", help=f"{words} (0..180; default: {CREASE_ANGLE:g})")
    add("--time", type=number, metavar="S", help="pose the animation at so many seconds (default: the stored pose)")
    words = "a folder from which the scene may read files, beside its own and those in it; may be repeated"
    add("--allow", metavar="FOLDER", action="append", default=[], help=words)
    add(
        "--sky", metavar="TEXT",
        help="what lights it from all around, as in a .scene, in quotes: 'R G B', 'FILE.hdr rotate 90', 'cie clear sun 40 180'",
    )  # fmt: skip


def _add_camera(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("camera", "--eye and --target go together; --up and --fov come from the scene unless given")
    group.add_argument("--camera", metavar="NAME", help="a camera of the scene by its name (default: its first)")
    for flag, text in (("eye", "where it stands"), ("target", "the point that it looks at"), ("up", "what is up")):
        group.add_argument(f"--{flag}", nargs=3, type=number, metavar=("X", "Y", "Z"), help=f"{text}, world space")
    group.add_argument("--fov", type=number, metavar="DEG", help="vertical field of view, between 0 and 180 degrees")


def _add_settings(parser: argparse.ArgumentParser, besides: tuple[str, ...] = (), stages: tuple[str, ...] = _STAGES) -> None:
    for stage in stages:
        group = parser.add_argument_group(f"settings of {stage}")
        for declaration in SETTINGS.values():
            if declaration.stage == stage and declaration.name not in besides:
                _add_setting(group, declaration)


def _add_size(parser: argparse.ArgumentParser, side: int | None, words: str = "", action: str = "store") -> None:
    default = None if side is None else [side, side]
    words = words or f"image size in pixels (default: {side} {side})"
    parser.add_argument("--size", nargs=2, type=pixels, default=default, metavar=("W", "H"), help=words, action=action)


def _add_preset(parser: argparse.ArgumentParser, default: str | None, words: str = "", action: str = "store") -> None:
    words = words or f"{', '.join(PRESETS)} (default: {default or 'the last one'})"
    parser.add_argument("--preset", metavar="NAME", choices=tuple(PRESETS), default=default, help=words, action=action)


def _add_cache(parser: argparse.ArgumentParser, when: str = "") -> None:
    words = f"the records are kept in this file: taken from it where it is there, and written to it{when}"
    parser.add_argument("--cache", metavar="FILE", help=words)


def _add_setting(group: Any, declaration: Declaration) -> None:
    default = declaration.default
    word = default if not isinstance(default, bool) else "on" if default else "off"
    shown = f"{word:g}" if isinstance(word, float) else word
    text = f"{declaration.help} ({declaration.range}; default: {shown})"
    metavar = {"bool": "on|off", "choice": "WORD", "int": "N"}.get(declaration.kind, "X")
    dest = "set_" + declaration.name
    group.add_argument(declaration.flag, dest=dest, metavar=metavar, help=text.replace("%", "%%"))
    for former in declaration.flags[1:]:
        group.add_argument(former, dest=dest, metavar=metavar, help=argparse.SUPPRESS)


def _spelled_out(argv: Sequence[str]) -> Iterator[str]:
    """`argv` with "on" after every bare on|off flag, so that argparse never takes the SCENE behind one for its value."""
    switches = {flag for d in SETTINGS.values() if d.kind == "bool" for flag in d.flags}
    for i, word in enumerate(argv):
        if word == "--":
            yield from argv[i:]
            return
        yield word
        following = argv[i + 1].lower() if i + 1 < len(argv) else ""
        if word in switches and following not in ("on", "off"):
            yield "on"


def _wrong_with_the_camera(args: argparse.Namespace) -> Iterator[str]:
    """What a camera needs and has not, as far as that can be said before the scene is there."""
    if (args.eye is None) != (args.target is None):
        yield "--eye and --target go together; give both or neither"
    if args.up is not None and args.eye is None:
        yield "--up needs --eye and --target; give them as well"
    if args.eye is not None and args.camera is not None:
        yield "--camera and --eye are two different cameras; give one of them"
    if args.fov is not None and not 0.0 < args.fov < 180.0:
        yield f"--fov lies between 0 and 180 degrees, not {args.fov:g}"
    if args.path is not None and args.turntable is not None:
        yield "--path and --turntable are two different flights; give one of them"
    if args.path is None and args.turntable is None:
        if args.frames is not None:
            yield "--frames chooses among the frames of a path; give --path as well"
        if args.command == "fill":
            yield "fill needs a flight; give --path FILE or --turntable N"
    for flag in ("eye", "camera"):
        if args.path is not None and getattr(args, flag) is not None:
            yield f"--path brings its own cameras; leave --path or --{flag} out"


class _Version(argparse.Action):
    """Prints the version; it is looked up only when asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str, **options: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, **options)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        print(f"irrsplat {version()}")
        parser.exit()
