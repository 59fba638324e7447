"""Films among the outputs of a flight: their source pictures, and encoding after the last frame."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from irrsplat.app.common.terminal import progress
from irrsplat.app.film import video
from irrsplat.app.film.kept import KeptFrames, key_of
from irrsplat.core.errors import InputError
from irrsplat.image.frame import numbered

if TYPE_CHECKING:
    from irrsplat.app.common.outputs import Outputs
    from irrsplat.app.film.flight import Flight
    from irrsplat.renderer import Renderer


@dataclass(frozen=True)
class Films:
    """Films `names`, made from the PNG files of `pattern`.

    kept: temporary folder of these files; None if they are outputs themselves.
    """

    names: tuple[str, ...]
    pattern: str
    encoding: video.Encoding
    kept: KeptFrames | None = None

    def begin(self, renderer: Renderer, flight: Flight, files: object, cache: str | None, resume: bool) -> None:
        """Prepare the folder; arguments as in key_of and KeptFrames.begin."""
        if self.kept is not None:
            self.kept.begin(key_of(renderer, flight, files, cache), resume)

    def write(self, flight: Flight, outputs: Outputs) -> None:
        """Encode the films of a flight after all frames are written."""
        pictures = [Path(numbered(self.pattern, number)) for number in flight.numbers]
        done = [outputs.write(name, partial(self._encode, name, pictures)) for name in self.names]
        if all(done) and self.kept is not None:
            self.kept.remove()

    def _encode(self, name: str, pictures: list[Path]) -> None:
        with progress(f"{name}: encoding") as line:

            def show(share: float) -> None:
                if line is not None:
                    line(share, f"{name}: encoding", name)

            video.write(name, pictures, self.encoding, show)


def plan(args: argparse.Namespace, flight: Flight) -> tuple[Flight, Films | None]:
    """Return the flight with picture outputs only, and its films, or None.

    The films are made from a .png output if one exists, else from pictures in a temporary folder next to the first film.
    Raises InputError if another file is in the folder's place.
    """
    names = tuple(output for output in flight.outputs if video.is_film(output))
    if not names:
        return flight, None
    stills = tuple(output for output in flight.outputs if not video.is_film(output))
    encoding = video.Encoding(Fraction(args.fps).limit_denominator(1001), args.film_quality)
    of_png = next((output for output in stills if output.lower().endswith(".png")), None)
    if of_png is not None:
        return replace(flight, outputs=stills), Films(names, of_png, encoding)
    kept = KeptFrames.beside(names[0])
    kept.check()
    return replace(flight, outputs=(*stills, kept.pattern)), Films(names, kept.pattern, encoding, kept)


def check(args: argparse.Namespace) -> None:
    """Raise InputError for incompatible flags of films and flights."""
    films = [output for output in args.output if video.is_film(output)]
    if not films and (args.fps is not None or args.film_quality is not None):
        flag = "--fps" if args.fps is not None else "--film-quality"
        raise InputError(f"{flag} is for a film, and no output is one; give -o NAME.mp4, .webm or .gif")
    if args.resume and args.path is None and args.turntable is None:
        raise InputError("--resume goes on with the frames of a flight; give --path FILE or --turntable N")
    if films and args.values.get("backdrop") == "clear":
        raise InputError("films have no alpha; take another --backdrop than clear, or .png", films[0])
    args.fps, args.film_quality = args.fps or 30.0, args.film_quality or "good"
