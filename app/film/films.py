"""Films among the outputs of a flight: their source pictures, and encoding after the last frame."""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path

from irrsplat.app.common.outputs import Outputs
from irrsplat.app.common.terminal import progress
from irrsplat.app.film import video
from irrsplat.app.film.flight import Flight
from irrsplat.core.errors import InputError
from irrsplat.image.frame import numbered


def folder_beside(film: str) -> tempfile.TemporaryDirectory[str]:
    """Return a new temporary folder in the film's folder: a file is renamed within a file system only."""
    return tempfile.TemporaryDirectory(prefix=".film-", dir=Path(os.path.abspath(film)).parent, ignore_cleanup_errors=True)


def pattern_in(folder: str) -> str:
    """Return the file name pattern of a film's frames in `folder`, with {frame}."""
    return folder.replace("{", "{{").replace("}", "}}") + "/{frame:06d}.png"


@dataclass(frozen=True)
class Films:
    """Films `names`, made from the PNG files of `pattern`. folder: of these files; None if they are outputs themselves."""

    names: tuple[str, ...]
    pattern: str = ""
    rate: Fraction = Fraction(video.RATE)
    folder: tempfile.TemporaryDirectory[str] | None = None

    def end(self, numbers: Sequence[int], outputs: Outputs) -> None:
        """Encode the frames `numbers`, unless there are none, and remove the temporary files."""
        pictures = [Path(numbered(self.pattern, number)) for number in numbers]
        for name in self.names if pictures else ():
            outputs.write(name, partial(self._encode, name, pictures))
        if self.folder is not None:
            self.folder.cleanup()

    def _encode(self, name: str, pictures: list[Path]) -> None:
        with progress(f"{name}: encoding") as line:

            def show(share: float) -> None:
                if line is not None:
                    line(share, f"{name}: encoding", name)

            video.write(name, pictures, self.rate, show)


def plan(args: argparse.Namespace, flight: Flight) -> tuple[Flight, Films]:
    """Return the flight with picture outputs only, and its films.

    The films are made from a .png output if one exists, else from pictures in a temporary folder next to the first film.
    """
    names = tuple(output for output in flight.outputs if video.is_film(output))
    if not names:
        return flight, Films(())
    stills = tuple(output for output in flight.outputs if not video.is_film(output))
    rate = Fraction(args.fps or video.RATE).limit_denominator(1001)
    of_png = next((output for output in stills if output.lower().endswith(".png")), None)
    if of_png is not None:
        return replace(flight, outputs=stills), Films(names, of_png, rate)
    folder = folder_beside(names[0])
    made = Films(names, pattern_in(folder.name), rate, folder)
    return replace(flight, outputs=(*stills, made.pattern)), made


def check(args: argparse.Namespace) -> None:
    """Raise InputError for incompatible flags of films and flights."""
    films = [output for output in args.output if video.is_film(output)]
    if not films and args.fps is not None:
        raise InputError("--fps is for a film, and no output is one; give -o NAME.mp4")
    if films and args.values.get("backdrop") == "clear":
        raise InputError("films have no alpha; take another --backdrop than clear, or .png", films[0])
