"""`irrsplat measure`: light on a plane, along a line or at points."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.commands.shared import flags


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "measure",
        help="measure irradiance or illuminance on a plane, along a line or at points",
        description="Measure the light that falls on a plane, along a line or at single points: from lights with shadows,\n"
        "emitters, sky and all bounces. Each point is gathered separately, without interpolation. No camera is needed.",
        epilog="Points within solids and points covered by a surface are marked. Mean, minimum, maximum and uniformity\n"
        "ignore them.",
    )
    flags.add_scene(parser)
    add = parser.add_argument
    where = parser.add_argument_group("where", "one of --plane, --height, --line and --point")
    axes = ("X0", "Y0", "Z0", "UX", "UY", "UZ", "VX", "VY", "VZ")
    words = "a corner and two edges u and v in metres; measured from the side of u × v"
    where.add_argument("--plane", nargs=9, type=flags.number, metavar=axes, help=words)
    words = "a horizontal plane, M metres above the lowest point, over the scene without a wide ground; measured from above"
    where.add_argument("--height", type=flags.number, metavar="M", help=words)
    words = "points along a line, including both ends; metres"
    where.add_argument("--line", nargs=6, type=flags.number, metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"), help=words)
    words = "direction of the meter along a line (default: up)"
    where.add_argument("--facing", nargs=3, type=flags.number, metavar=("NX", "NY", "NZ"), help=words)
    words = "a point and the direction of the meter; may be repeated"
    where.add_argument(
        "--point", nargs=6, type=flags.number, action="append", metavar=("X", "Y", "Z", "NX", "NY", "NZ"), help=words
    )
    words = "largest side of the cells of a plane, or largest step on a line (default: the spacing of EN 12464-1)"
    where.add_argument("--grid", type=flags.number, metavar="M", help=words)
    where.add_argument(
        "--margin", type=flags.number, metavar="M", help="leave out a margin along the edges of a plane (default: 0)"
    )
    add(
        "-o", "--output", metavar="OUT",
        help="a table in a .csv, or arrays in a .npz; -: CSV on stdout (default: a table on stdout)",
    )  # fmt: skip
    add(
        "--unit",
        choices=("W/m2", "lux"),
        default="W/m2",
        help="irradiance of red, green and blue, or illuminance (default: W/m2)",
    )
    add("--lux", dest="unit", action="store_const", const="lux", help="short for --unit lux")
    add("--stats", metavar="FILE.json", help="write mean, minimum, maximum, uniformity and settings to this file")
    flags.add_preset(parser, "reference")
    flags.add_settings(parser, stages=("shadow", "gather"))
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from irrsplat.app.commands.shared import rendering
    from irrsplat.app.work import measure as measuring

    measuring.check(args)
    return measuring.run(rendering.load_without_camera(args), args)
