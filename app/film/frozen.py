"""`--cache-mode frozen`: pictures from unchanged records, and the notice on gaps."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from irrsplat.app.common.terminal import say
from irrsplat.core.errors import InputError

if TYPE_CHECKING:
    from irrsplat.image.statistics import Statistics


def check(args: argparse.Namespace) -> None:
    """Raise InputError for a command line that also requests new records."""
    if args.cache is None:
        raise InputError(
            "--cache-mode frozen takes all records from a file; give --cache FILE as well, as irrsplat fill makes it"
        )
    if args.values.get("quality"):
        raise InputError("--quality gathers records, and --cache-mode frozen lets none be gathered; leave one of them out")


def warn(done: Sequence[Statistics]) -> None:
    """Print the number of these pictures with uncovered pixels, if any."""
    bare = [uncovered for stats in done if (uncovered := stats.get("uncovered", 0))]
    if bare:
        where = f"{len(bare)} of {len(done)} frames" if len(done) > 1 else "the picture"
        some = f"some pixels (at most {max(bare)})"
        say(f"notice: in {where} no record reaches {some}, which take the light of those around; fill the cache for this view")
