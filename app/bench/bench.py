"""`irrsplat bench`: render times from an empty and from a kept cache, as tables of scenes, presets and sizes."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict

import irrsplat
from irrsplat.app.bench import compare
from irrsplat.app.bench.cases import LEGEND, TURN, Run, machine, measure
from irrsplat.app.common.terminal import columns, out, say
from irrsplat.core.errors import InputError
from irrsplat.core.files import json_text, write_text
from irrsplat.reference.truth import in_words
from irrsplat.scene.model import Scene
from irrsplat.settings import SETTINGS, All, Settings

DEFAULT_SCENES = ("cornell-paper",)
PAPER = "cornell-paper"  # scene that is also timed as published, unless presets are given
SIZE = [800, 800]


def run(args: Namespace) -> int:
    """Run the benchmark of the command line `args`, print tables and write JSON on request; return the exit status 0.

    Raises InputError and IrrsplatError for invalid input; KeyboardInterrupt if the user interrupts.
    """
    if args.profile and (args.peers or args.compare is not None):
        raise InputError("--profile has a table of its own; leave --peers and --compare out")
    bounces = _bounces(args.bounces)
    earlier = None if args.compare is None else compare.read(args.compare)
    if args.peers:
        from irrsplat.app.bench.peers import race

        race.check(args)
    elif args.output is not None:
        raise InputError("-o is for the plot of --peers; give that as well, or --json for the numbers")
    names = args.scenes or (DEFAULT_SCENES if not args.peers else race.DEFAULT_SCENES)
    loaded = [irrsplat.load(name, **vars(args.loading)).local for name in dict.fromkeys(names)]
    if args.peers:
        written: dict[str, object] = {"machine": {}, "runs": []} | race.run(loaded, args, bounces)
    elif args.profile:
        from irrsplat.app.bench import stage_profile

        written = {"profiles": stage_profile.run(loaded, args, bounces)}
    else:
        about, runs = _timed(loaded, args, bounces)
        written = {"machine": about, "runs": [asdict(run) for run in runs]}
        if earlier is not None:
            out(f"\nagainst {args.compare}")
            out("\n".join(compare.table(earlier, runs)))
    if args.json is not None:
        write_text(args.json, json_text(written) + "\n")
    return 0


def _bounces(text: str) -> int | All:
    """Return the value of --bounces; raise InputError for an invalid value and for 0."""
    bounces = Settings().with_values({"bounces": SETTINGS["bounces"].parse(text)}).bounces
    if bounces == 0:
        raise InputError("--bounces 0: there is no indirect light to time; leave it out, or take 1 or all")
    return bounces


def _timed(loaded: Sequence[Scene], args: Namespace, bounces: int | All) -> tuple[dict[str, object], list[Run]]:
    """Print the tables of every scene and size; return the machine and the runs for the JSON."""
    about: dict[str, object] = {}
    runs: list[Run] = []
    for scene in loaded:
        for notice in scene.notices:
            say(f"notice: {notice}")
        for width, height in dict.fromkeys((w, h) for w, h in args.size or [SIZE]):
            found: list[Run] = []
            for preset in dict.fromkeys(args.preset or (("paper", "default") if scene.name == PAPER else ("default",))):
                with irrsplat.Renderer(scene, (width, height), preset, bounces=bounces, tile_size=0) as renderer:
                    if not about:
                        about = machine(renderer.about)
                        out(f"{about['renderer']}, {about['cpus']} CPUs, {in_words(bounces)}")
                        out(LEGEND)
                    found += measure(renderer)
            out(f"\n{scene.name}, {width}x{height}, {in_words(bounces)}")
            out("\n".join(_cases(found)))
            runs += found
    return about, runs


def _cases(runs: Sequence[Run]) -> Iterator[str]:
    rows: list[tuple[str, ...]] = [("scene", "preset", "case", "seconds", "picture", "records", "rmse")]
    for r in runs:
        seconds = f"{r.seconds:.3f}", _number(r.picture_seconds, ".3f")
        rows.append((r.scene, r.preset, r.case, *seconds, str(r.records), _number(r.rmse, ".1%")))
    yield from columns(rows, left=3)
    seconds_of = {(r.preset, r.case): r.seconds for r in runs}
    presets = list(dict.fromkeys(r.preset for r in runs))
    if {"paper", "default"} <= set(presets):
        times = seconds_of["paper", "empty"] / seconds_of["default", "empty"]
        yield f"from empty, default is {times:.1f} times faster than paper"
    for case, words in (("moved", f"turned by {TURN:g}°"), ("warm", "the same view"), ("light", "a light moved")):
        if (presets[0], case) in seconds_of:
            found = (f"{seconds_of[p, 'empty'] / seconds_of[p, case]:.1f} times ({p})" for p in presets)
            yield f"{words}, faster than from empty: {', '.join(found)}"


def _number(value: float | None, how: str) -> str:
    return "-" if value is None else format(value, how)
