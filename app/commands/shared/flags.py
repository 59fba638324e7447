"""Common flags of commands, and parsers of values of flags; flags of settings derive from irrsplat.settings."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from typing import Any

from irrsplat.core.errors import InputError
from irrsplat.core.load_options import CREASE_ANGLE, UP_AXES
from irrsplat.settings import LEAST_TILE, MOST_TILE, PRESETS, SETTINGS

STAGES = tuple(dict.fromkeys(declaration.stage for declaration in SETTINGS.values()))  # in the order of the frame
MOST_DECADES = 9


# ---- values, as parsed by argparse: an error has the expected form -----------------------------------------------------


def number(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, not '{text}'")
    return value


def _whole(low: int, high: int, expected: str) -> Callable[[str], int]:
    """Return a parser of whole numbers from `low` to `high`; expected: these in words."""

    def parse(text: str) -> int:
        if not re.fullmatch(r"\d{1,9}", text, re.ASCII) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"expected {expected}, not '{text}'")
        return int(text)

    return parse


pixels = _whole(1, 999_999_999, "a whole number of pixels, at least 1")
samples = _whole(2, 999_999_999, "a whole number of samples, at least 2")
count = _whole(1, 999_999_999, "a whole number, at least 1")
decades = _whole(1, MOST_DECADES, f"a whole number from 1 to {MOST_DECADES}")
_tile = _whole(LEAST_TILE, MOST_TILE, f"0, or a whole number of pixels from {LEAST_TILE} to {MOST_TILE}")


def tile(text: str) -> int:
    """Parse a tile side in pixels; 0: no tiles."""
    return 0 if text == "0" else _tile(text)


def rate(text: str) -> float:
    """Parse frames per second."""
    value = number(text)
    if not 0.1 <= value <= 240.0:
        raise argparse.ArgumentTypeError(f"expected frames per second, 0.1 to 240, not '{text}'")
    return value


def frames(text: str) -> tuple[int, int | None]:
    """Parse frames A:B of a path as (A, B), half open as a Python slice; omitted: A = 0, B = None."""
    match = re.fullmatch(r"(\d{0,9}):(\d{0,9})", text, re.ASCII)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected A:B, the frames from A to before B, either may be left out, not '{text}'")
    start, stop = int(match[1] or 0), int(match[2]) if match[2] else None
    if stop is not None and start >= stop:
        raise argparse.ArgumentTypeError(f"'{text}' holds no frame: B is not among them; give a B greater than A")
    return start, stop


# ---- flags -------------------------------------------------------------------------------------------------------------


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add SCENE and the options of its loading."""
    words = "a path or the name of a bundled scene (default: cornell)"
    parser.add_argument("scene", nargs="?", metavar="SCENE", default="cornell", help=words)
    add_loading(parser)


def add_loading(parser: argparse.ArgumentParser) -> None:
    """Add the options of loading, which `grammar.parse` collects in `args.loading`."""
    group = parser.add_argument_group(
        "reading the scene", "values that a file does not define; a .scene uses only --sky and --allow"
    )
    add = group.add_argument
    add("--up-axis", choices=UP_AXES, default="auto", help="up axis (default: auto, by format and exporter)")
    words = "greatest angle between triangles at smooth edges, for files without normals"
    add(
        "--crease-angle",
        type=number,
        default=CREASE_ANGLE,
        metavar="DEG",
        help=f"{words} (0..180; default: {CREASE_ANGLE:g})",
    )
    words = "light in glTF files is in candela, lux and cd/m² (default: in W/sr, W/m² and W/(m² sr))"
    add("--photometric", action="store_true", help=words)
    words = "let the scene read files from this folder, in addition to its own folder; may be repeated"
    add("--allow", metavar="FOLDER", action="append", default=[], help=words)
    add(
        "--sky", metavar="TEXT",
        help="sky, as in a .scene, in quotes: 'R G B', 'FILE.hdr rotate 90', 'cie clear sun 40 180'",
    )  # fmt: skip


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add the camera flags, for `rendering.camera`.

    The checks need path and frames too, from `add_flight` or as None.
    """
    group = parser.add_argument_group("camera", "--eye requires --target; --up and --fov default to those of the scene")
    group.add_argument("--camera", metavar="NAME", help="name of a camera of the scene (default: the first)")
    for flag, text in (("eye", "position"), ("target", "target point"), ("up", "up direction")):
        group.add_argument(f"--{flag}", nargs=3, type=number, metavar=("X", "Y", "Z"), help=f"{text} in world space")
    group.add_argument("--fov", type=number, metavar="DEG", help="vertical field of view, between 0 and 180 degrees")


def add_settings(parser: argparse.ArgumentParser, besides: tuple[str, ...] = (), stages: tuple[str, ...] = STAGES) -> None:
    """Add the settings of `stages` except `besides`; `grammar.parse` collects them in `args.values`."""
    for stage in stages:
        group = parser.add_argument_group(f"settings of {stage}")
        for declaration in SETTINGS.values():
            if declaration.stage == stage and declaration.name not in besides:
                default = declaration.default
                word = default if not isinstance(default, bool) else "on" if default else "off"
                shown = f"{word:g}" if isinstance(word, float) else word
                text = f"{declaration.help} ({declaration.range}; default: {shown})".replace("%", "%%")
                metavar = {"bool": "on|off", "choice": "WORD", "int": "N"}.get(declaration.kind, "X")
                group.add_argument(declaration.flag, dest="set_" + declaration.name, metavar=metavar, help=text)


def add_size(parser: argparse.ArgumentParser, side: int | None, words: str = "", action: str = "store") -> None:
    """Add --size, by default `side` by `side`; without `side`, args.size is None. words: special help."""
    default = None if side is None else [side, side]
    words = words or f"image size in pixels (default: {side} {side})"
    parser.add_argument("--size", nargs=2, type=pixels, default=default, metavar=("W", "H"), help=words, action=action)


def add_preset(parser: argparse.ArgumentParser, default: str | None, words: str = "", action: str = "store") -> None:
    """Add --preset. words: special help."""
    words = words or f"{', '.join(PRESETS)} (default: {default or 'the last one'})"
    parser.add_argument("--preset", metavar="NAME", choices=tuple(PRESETS), default=default, help=words, action=action)


def add_cache(parser: argparse.ArgumentParser, when: str = "") -> None:
    """Add --cache. when: time of the write, for the help."""
    words = f"load records from this file if it exists, and save them{when or ' at the end'}"
    parser.add_argument("--cache", metavar="FILE", help=words)


def add_cache_mode(parser: argparse.ArgumentParser) -> None:
    """Add --cache-mode, for commands that always extend the file of --cache."""
    words = (
        "keep: require a file of the same scene; update: accept a file of another state of the scene, and gather affected records"
    )
    parser.add_argument(
        "--cache-mode", choices=("keep", "update"), default="keep", metavar="WORD", help=f"{words} again (default: keep)"
    )


def add_flight(parser: argparse.ArgumentParser, words: str) -> Any:
    """Add the flags of a flight; return their group. words: the group's description."""
    group = parser.add_argument_group("path", words)
    group.add_argument("--path", metavar="FILE", help="path file, in the current folder or the folder of the scene")
    group.add_argument(
        "--frames", type=frames, metavar="A:B", help="render frames A to B - 1; A or B may be omitted (default: all)"
    )
    return group


def check_camera(args: argparse.Namespace) -> None:
    """Raise InputError for camera errors that show before the scene is loaded."""
    if (args.eye is None) != (args.target is None):
        raise InputError("--eye and --target go together; give both or neither")
    if args.up is not None and args.eye is None:
        raise InputError("--up needs --eye and --target; give them as well")
    if args.eye is not None and args.camera is not None:
        raise InputError("--camera and --eye are two different cameras; give one of them")
    if args.fov is not None and not 0.0 < args.fov < 180.0:
        raise InputError(f"--fov lies between 0 and 180 degrees, not {args.fov:g}")
    if args.path is None and args.frames is not None:
        raise InputError("--frames chooses among the frames of a path; give --path as well")
    for flag in ("eye", "camera"):
        if args.path is not None and getattr(args, flag) is not None:
            raise InputError(f"--path brings its own cameras; leave --path or --{flag} out")
    if args.path is None and args.command == "fill":
        raise InputError("fill needs a flight; give --path FILE")
