"""`irrsplat verify`: errors against a path tracer."""

from __future__ import annotations

import argparse
from typing import Any

from irrsplat.app.commands.shared import flags, rendering
from irrsplat.app.common.terminal import wrote


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "verify",
        help="measure errors against a path tracer",
        description="Render a scene and print the error of its indirect light against a path tracer.",
        epilog="Requires the extra: pip install 'irrsplat[reference]'. The reference of a view is traced once and kept in the\n"
        "cache folder of the user, or in the folder of IRRSPLAT_CACHE.",
    )
    flags.add_scene(parser)
    add = parser.add_argument
    flags.add_size(parser, 200)
    add(
        "--samples",
        type=flags.samples,
        default=2048,
        metavar="N",
        help="least rays of each kind per pixel (default: 2048)",
    )
    flags.add_preset(parser, "default")
    add("-o", "--output", metavar="FILE.png", help="write reference, picture and error side by side")
    flags.add_camera(parser)
    flags.add_settings(parser, besides=("samples",))  # errors refer to pixel centres, and --samples has another meaning here
    parser.set_defaults(run=run, path=None, frames=None)


def run(args: argparse.Namespace) -> int:
    from irrsplat.app.work import verify as verification

    verification.check(args)

    import irrsplat

    scene = irrsplat.load(args.scene, **vars(args.loading))
    status = verification.run(scene, rendering.camera(args, scene), args)
    if args.output is not None:
        wrote(args.output)
    return status
