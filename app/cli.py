# PYTHON_ARGCOMPLETE_OK
"""The command line: `irrsplat view`, `render` and so on, as COMMANDS has them, with one line for whatever goes wrong."""

from __future__ import annotations

import argparse
import io
import logging
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path as File
from typing import TYPE_CHECKING, Any

from irrsplat.app import flags
from irrsplat.app.common.outputs import Outputs, missing, twins
from irrsplat.app.common.terminal import progress, say, wrote
from irrsplat.core.errors import InputError, IrrsplatError

if TYPE_CHECKING:
    from irrsplat.app.common.parser import Mistakes
    from irrsplat.app.film.fill import Filled
    from irrsplat.app.film.films import Films
    from irrsplat.app.film.flight import Flight
    from irrsplat.app.film.frames import OnRound
    from irrsplat.app.pictures import Pictures
    from irrsplat.image.statistics import Statistics
    from irrsplat.image.view import Progress
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera, Scene
    from irrsplat.settings import SettingValues

INTERRUPTED = 130
_FROZEN_ALONE = (
    "--on renders the frames of a flight from a frozen cache, so that they are the same whoever renders them; "
    "give --path or --turntable, and --cache-mode frozen with a --cache that irrsplat fill has made"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (default: sys.argv) and return the exit status, as in docs/command-line.md."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without UTF-8 is no reason to fail
    debug = bool(os.environ.get("IRRSPLAT_DEBUG"))
    try:
        with _quiet_libraries(debug), _ended_as_by_ctrl_c():
            if "_ARGCOMPLETE" in os.environ:  # a shell asks what may come next
                from irrsplat.app import completion as tab

                tab.answer()
            args, mistakes = flags.read(sys.argv[1:] if argv is None else argv)
            _check_files(args, mistakes)
            mistakes.tell()
            status = COMMANDS[args.command](args)
            sys.stdout.flush()
            return status
    except SystemExit as done:  # --help, --version
        return done.code if isinstance(done.code, int) else 0
    except InputError as error:
        return _fail(str(error), 2)
    except IrrsplatError as error:
        return _fail(str(error), 1)
    except KeyboardInterrupt:
        return _fail("interrupted; nothing more was written", INTERRUPTED)
    except BrokenPipeError:  # `irrsplat info | head`: the reader has seen enough
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MemoryError:
        if debug:
            traceback.print_exc()
        return _fail("out of memory; take a smaller --size, fewer --buffers, or less --texture-memory", 1)
    except ModuleNotFoundError as error:
        if debug:
            traceback.print_exc()
        return _fail(missing(error), 1)
    except Exception as error:
        if debug:
            traceback.print_exc()
        return _fail(f"internal error: {type(error).__name__}: {error}; IRRSPLAT_DEBUG=1 shows where", 1)


# ---- the commands ------------------------------------------------------------------------------------------------------
# Each imports what it needs, so that --help and mistakes are told at once, and a missing library hinders its own command alone.


def view(args: argparse.Namespace) -> int:
    """`irrsplat view`: the window."""
    import irrsplat
    from irrsplat.app.viewer import preferences

    scene = irrsplat.load(args.scene, **vars(args.loading))
    camera = _camera(args, scene)
    remembered, notices = preferences.load()
    if args.preset is not None:
        remembered.preset, remembered.values = args.preset, {}
    remembered.values |= args.values
    if args.cache is not None:
        _check_cache(args.cache, scene, remembered.preset, remembered.values)
    from irrsplat.app.viewer import viewer

    size = tuple(args.size) if args.size else None
    said = viewer.run(scene, args.scene, size, remembered, camera, notices, args.cache, args.loading)
    if said is not None:
        say(f"notice: {said}")
    return 0


def render(args: argparse.Namespace) -> int:
    """`irrsplat render`: a scene, or a path through it, to files. All that can be checked is checked before the work; where one
    cannot be written in the end, the others are."""
    from irrsplat import settings
    from irrsplat.app import pictures
    from irrsplat.app.film import films, frames, frozen
    from irrsplat.app.film import flight as flights
    from irrsplat.image.frame import needed

    settings.preset(args.preset, **args.values)
    buffers, keeps = _buffers(args), args.cache_mode == "frozen"
    with_figures = _has_folder(args) and not keeps
    files = pictures.checked(args)
    films.check(args)
    if keeps:
        frozen.check(args)
    if args.on is not None and not (keeps and flights.flies(args)):
        raise InputError(_FROZEN_ALONE)

    import irrsplat

    scene = irrsplat.load(args.scene, **vars(args.loading))
    camera, flight, made = _camera(args, scene), None, None
    if flights.flies(args):
        flight, made = films.plan(args, flights.with_outputs(flights.plan(args, scene, camera), args.output))
        if keeps:
            flights.check_still(flight, "leave out --cache-mode frozen")
    if flight is not None and args.on is not None:
        return _render_on(args, scene, flight, made, buffers, files)
    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, **args.values) as renderer:
        if args.cache is not None and (keeps or os.path.exists(args.cache)):
            _load_cache(renderer, args)
        for notice in (*scene.notices, *renderer.notices):
            say(f"notice: {notice}")
        outputs, how = Outputs(), dict[str, Any]()
        if flight is not None and made is not None:
            made.begin(renderer, flight, files, args.cache if keeps else None, args.resume)
        kept = made.pattern if made is not None and made.kept is not None else ""
        with _round_progress(args) as on_round:
            if flight is not None:
                how = {"frozen": keeps, "resume": args.resume, "kept": kept}
                done, complete = frames.render(renderer, flight, buffers, with_figures, on_round, outputs, files, **how)
            else:
                wanted = None if with_figures or files.of_all_buffers else needed(args.output, buffers)
                how = {"gather": False} if keeps else {"figures": with_figures}
                frame = renderer.render(camera, progress=on_round, buffers=wanted, **how)
        if flight is None and frame.stats.get("interrupted") and not frame.stats.get("rounds") and not keeps:
            return _fail("interrupted before the first round was complete; nothing was written", INTERRUPTED)
        for path in args.output if flight is None else ():
            outputs.write(path, partial(files.save, path, frame, buffers, renderer, camera))
        if args.cache is not None and renderer.cache.count and not keeps:
            outputs.write(args.cache, partial(renderer.save_cache, args.cache))
        if flight is not None and made is not None and complete:
            made.write(flight, outputs)
    if keeps:
        frozen.tell([frame.stats] if flight is None else done)
    if flight is None:
        return _end_of_render(args, frame.stats, outputs)
    unfinished = None if complete else _so_far(flight, len(done), args.resume or bool(kept))
    return _end_of_path(args, done, unfinished, outputs)


def _render_on(
    args: argparse.Namespace,
    scene: Scene,
    flight: Flight,
    made: Films | None,
    buffers: list[str] | None,
    files: Pictures,
) -> int:
    """The frames of a flight, rendered by the workers of --on, and the films `made` of them."""
    from irrsplat.app.farm import cluster
    from irrsplat.app.film import frozen
    from irrsplat.records import cache_file

    if made is not None and made.kept is not None:
        raise InputError("with --on a film is made of pictures that stay; give -o 'frame{frame:04d}.png' as well", made.names[0])
    job = cluster.job_of(args, scene, flight)
    cache_file.read(args.cache, job.key)
    for notice in scene.notices:
        say(f"notice: {notice}")
    outputs = Outputs()
    done, complete = cluster.render(args, job, flight, buffers, files, outputs)
    frozen.tell(done)
    if made is not None and complete:
        made.write(flight, outputs)
    return _end_of_path(args, done, None if complete else _so_far(flight, len(done), args.resume), outputs)


def _fill_on(args: argparse.Namespace, scene: Scene, flight: Flight) -> int:
    """The records of a flight, gathered by the workers of --on."""
    from irrsplat.app.farm import cluster
    from irrsplat.app.film import fill as filling
    from irrsplat.core import files
    from irrsplat.records import cache_file

    job, outputs = cluster.job_of(args, scene, flight), Outputs()
    if os.path.exists(args.cache):
        cache_file.read(args.cache, job.key)
    for notice in scene.notices:
        say(f"notice: {notice}")
    data, done = cluster.fill(args, job, flight)
    if data:
        outputs.write(args.cache, lambda: files.write_bytes(args.cache, data))
    if args.stats is not None:
        _write_stats(args, filling.statistics(done, cluster.count(data)), outputs)
    return _end_of_fill(done, flight, outputs)


def _load_cache(renderer: Renderer, args: argparse.Namespace) -> None:
    """Take the records of --cache, as --cache-mode says; what that renews is told."""
    if reason := renderer.load_cache(args.cache, update=args.cache_mode == "update"):
        say(f"notice: {args.cache} was made {reason}; what that concerns is gathered again")


def fill(args: argparse.Namespace) -> int:
    """`irrsplat fill`: the records of a flight, to a cache file."""
    from irrsplat import settings
    from irrsplat.app.film import fill as filling
    from irrsplat.app.film import flight as flights

    settings.preset(args.preset, **args.values)

    import irrsplat

    scene = irrsplat.load(args.scene, **vars(args.loading))
    flight = flights.plan(args, scene, _camera(args, scene))
    flights.check_still(flight, "render it without filling one")
    if args.on is not None:
        return _fill_on(args, scene, flight)
    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, **args.values) as renderer:
        if os.path.exists(args.cache):
            _load_cache(renderer, args)
        for notice in (*scene.notices, *renderer.notices):
            say(f"notice: {notice}")
        with _round_progress(args) as on_round:
            done = filling.fill(renderer, flight, on_round, filling.saved_at_times(renderer, args.cache))
        outputs = Outputs()
        if renderer.cache.count:
            outputs.write(args.cache, partial(renderer.save_cache, args.cache))
        if args.stats is not None:
            _write_stats(args, filling.statistics(done, renderer.cache.count), outputs)
    return _end_of_fill(done, flight, outputs)


def measure(args: argparse.Namespace) -> int:
    """`irrsplat measure`: light on a plane or at points."""
    from irrsplat.app import measure as measuring

    measuring.check(args)

    import irrsplat

    return measuring.run(irrsplat.load(args.scene, **vars(args.loading)), args)


def bake(args: argparse.Namespace) -> int:
    """`irrsplat bake`: light for other programs."""
    from irrsplat.app.bake import command

    command.check(args)

    import irrsplat

    return command.run(irrsplat.load(args.scene, **vars(args.loading)), args)


def info(args: argparse.Namespace) -> int:
    """`irrsplat info`: what is in a scene, or the table of bundled ones."""
    from irrsplat.app import info as report

    report.scene(args.scene, args.loading) if args.scene is not None else report.bundled()
    return 0


def doctor(args: argparse.Namespace) -> int:
    """`irrsplat doctor`: what OpenGL there is; 1 where it is not enough."""
    from irrsplat.app import info as report

    return report.doctor()


def completion(args: argparse.Namespace) -> int:
    """`irrsplat completion`: the script for a shell."""
    from irrsplat.app import completion as tab

    print(tab.script(args.shell))
    return 0


def desktop(args: argparse.Namespace) -> int:
    """`irrsplat desktop`: its entry in the desktop's menu."""
    from irrsplat.app.common import desktop_entry

    home = desktop_entry.data_home()
    done = desktop_entry.install(home) if args.what == "install" else desktop_entry.remove(home)
    for path in done:
        print(path)
    return 0


def bench(args: argparse.Namespace) -> int:
    """`irrsplat bench`: the times."""
    if args.json is not None:
        from irrsplat.core.files import check_file

        check_file(args.json)
    if args.quick and not args.growth:
        raise InputError("--quick is for --growth; give that as well")
    if args.counted and not args.moving:
        raise InputError("--counted is for --moving; give that as well")
    status = _bench_of(args)(args)
    for path in (args.json, args.output):
        if path is not None:
            wrote(path)
    return status


def _bench_of(args: argparse.Namespace) -> Callable[[argparse.Namespace], int]:
    if args.moving:
        from irrsplat.app.bench import moving

        return moving.run
    if args.growth:
        from irrsplat.app.bench import scaling

        return scaling.run
    from irrsplat.app.bench import bench as benchmark

    return benchmark.run


def verify(args: argparse.Namespace) -> int:
    """`irrsplat verify`: the errors against a path tracer."""
    from irrsplat import settings
    from irrsplat.app.verify import verify as verification

    settings.preset(args.preset, **args.values)
    verification.check(args)

    import irrsplat

    scene = irrsplat.load(args.scene, **vars(args.loading))
    status = verification.run(scene, _camera(args, scene), args)
    if args.output is not None:
        wrote(args.output)
    return status


def cache(args: argparse.Namespace) -> int:
    """`irrsplat cache`: what is in cache files, and what can be done with them."""
    from irrsplat.app import cache_tools

    return cache_tools.run(args)


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "view": view,
    "render": render,
    "fill": fill,
    "cache": cache,
    "measure": measure,
    "bake": bake,
    "info": info,
    "doctor": doctor,
    "bench": bench,
    "verify": verify,
    "completion": completion,
    "desktop": desktop,
}


# ---- before the work ---------------------------------------------------------------------------------------------------


def _camera(args: argparse.Namespace, scene: Scene) -> Camera:
    """The scene's camera that `args` names, with the values that flags give in place of its own."""
    camera = scene.camera(args.camera)
    given: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name in ("eye", "target", "up", "fov")
        if (value := getattr(args, name)) is not None
    }
    return replace(camera, **given) if given else camera


def _check_files(args: argparse.Namespace, mistakes: Mistakes) -> None:
    """Add to `mistakes` which scenes are not there, and for render which outputs cannot be written; those that are wrong
    already are left out."""
    scenes = args.scenes if hasattr(args, "scenes") else [getattr(args, "scene", None)]
    for scene in scenes:
        if scene is not None:
            from irrsplat.scene import located

            with mistakes.gathered():
                located(scene)
    if args.command == "render":
        _check_outputs(args, mistakes)
    if args.command == "fill":
        _check_kept_files(args, mistakes)
    if args.command == "cache" and args.tool != "info" and "output" not in mistakes.arguments:
        from irrsplat.core import files

        with mistakes.gathered():
            files.check_file(args.output)


def _check_outputs(args: argparse.Namespace, mistakes: Mistakes) -> None:
    """Add to `mistakes` which outputs, and files of --stats and --cache, cannot be written, and which buffers there are not."""
    from irrsplat.app.film import flight, video
    from irrsplat.image.frame import check_writable

    names = []
    for pattern in () if "output" in mistakes.arguments else args.output:
        with mistakes.gathered():
            names.append(flight.first_name(args, pattern) if flight.flies(args) else pattern)
    for name in names:
        for buffers in (None, _buffers(args)):
            with mistakes.gathered():
                video.check(name, flight.flies(args)) if video.is_film(name) else check_writable(name, buffers)
    _check_kept_files(args, mistakes, names)


def _check_kept_files(args: argparse.Namespace, mistakes: Mistakes, names: Sequence[str] = ()) -> None:
    """Add to `mistakes` which files of --stats and --cache cannot be written, or read where the cache is frozen, and which are
    one with each other or with one of the outputs `names`."""
    from irrsplat.core import files, paths

    frozen = args.command == "render" and args.cache_mode == "frozen"
    for path in (args.stats, args.cache):
        if path is not None and "cache" not in mistakes.arguments:
            with mistakes.gathered():
                if path is args.cache and frozen:
                    paths.check_readable(File(path), paths.MOST_GEOMETRY)
                else:
                    files.check_file(path)
    for twin in twins(names, (("--stats", args.stats), ("--cache", args.cache))):
        mistakes.add(twin)


def _buffers(args: argparse.Namespace) -> list[str] | None:
    """The names that --buffers has; None: all."""
    return None if args.buffers is None else [name.strip() for name in args.buffers.split(",")]


def _has_folder(args: argparse.Namespace) -> bool:
    """Whether one of the outputs is a folder, which has the paper's figures."""
    from irrsplat.app.film import flight, video
    from irrsplat.image.frame import check_writable

    names = [flight.first_name(args, pattern) for pattern in args.output] if flight.flies(args) else args.output
    return "" in [check_writable(name) for name in names if not video.is_film(name)]


def _check_cache(path: str, scene: Scene, preset: str, values: SettingValues) -> None:
    """Raises InputError where a cache file cannot be written, or where the one that is there belongs to another scene or to other
    settings."""
    from irrsplat import settings
    from irrsplat.core import files
    from irrsplat.records import cache_file

    files.check_file(path)
    if os.path.exists(path):
        cache_file.read(path, cache_file.key(scene.recentred.local, settings.preset(preset, **values)))


# ---- after the work ----------------------------------------------------------------------------------------------------


def _end_of_render(args: argparse.Namespace, stats: Statistics, outputs: Outputs) -> int:
    """Write the statistics of a picture where they are asked for, say what is missing in it; the exit status. Raises
    IrrsplatError where one of the `outputs` could not be written."""
    _write_stats(args, stats, outputs)
    outputs.tell()
    if stats.get("interrupted"):
        return _fail(f"interrupted; the files hold what {stats.get('rounds', 0)} whole rounds gave", INTERRUPTED)
    if not stats.get("converged", True) and "uncovered" not in stats:
        say(f"notice: stopped after {stats.get('rounds')} rounds {_unserved([stats])}")
    return 0


def _so_far(flight: Flight, written: int, resumes: bool) -> str:
    """How far a flight came that was interrupted. resumes: whether frames that were there before count as well."""
    from irrsplat.app.film.kept import unwritten

    if resumes:
        written = sum(not unwritten(flight.outputs, number) for number in flight.numbers)
    return f"{written} of {len(flight.numbers)} frames were written" + ("; --resume goes on from there" if resumes else "")


def _end_of_path(args: argparse.Namespace, done: list[Statistics], interrupted: str | None, outputs: Outputs) -> int:
    """The same for the frames of a path that are `done`. interrupted: how far it came; None: to its end."""
    _write_stats(args, {"frames": done}, outputs)
    outputs.tell()
    if interrupted is not None:
        return _fail(f"interrupted; {interrupted}", INTERRUPTED)
    if short := sum(not stats.get("converged", True) and "uncovered" not in stats for stats in done):
        say(f"notice: {short} of {len(done)} frames stopped {_unserved(done)}")
    return 0


def _end_of_fill(done: Filled, flight: Flight, outputs: Outputs) -> int:
    """The same for a flight that is filled."""
    from irrsplat.app.film import fill as filling

    outputs.tell()
    if done.interrupted:
        return _fail(f"interrupted; {len(done.frames)} of {len(flight.numbers)} frames have their records", INTERRUPTED)
    filling.tell(done)
    return 0


def _write_stats(args: argparse.Namespace, stats: Mapping[str, object], outputs: Outputs) -> None:
    if args.stats is not None:
        from irrsplat.core import files
        from irrsplat.image import statistics

        outputs.write(args.stats, lambda: files.write_text(args.stats, statistics.to_json(stats) + "\n"))


def _unserved(stats: Sequence[Statistics]) -> str:
    """The end of the notice on pictures that stopped early: which limit to raise."""
    full = any(one.get("full") for one in stats)
    return f"before every pixel was served; raise {'--max-records' if full else '--max-rounds'} or --a"


def _fail(message: str, status: int) -> int:
    with suppress(OSError):
        print("irrsplat:", " ".join(message.split()), file=sys.stderr, flush=True)
    return status


# ---- around the work ---------------------------------------------------------------------------------------------------


@contextmanager
def _round_progress(args: argparse.Namespace) -> Iterator[OnRound | None]:
    """A function to be called after each round, which shows it in a line; None where stderr is no terminal."""
    with progress("round 1: what is seen, and the light of further bounces") as line:

        def show(state: Progress, frame: str = "", before: float = 0.0, share: float = 1.0) -> None:
            if line is not None:
                stage, words, done = _stage(state, float(args.values.get("quality", 0.0)))
                line(before + share * done, f"{frame}, {words}" if frame else words, "path" if frame else stage)

        yield None if line is None else show


def _stage(state: Progress, quality: float) -> tuple[str, str, float]:
    """What a render does, in a word and in a line, and the share of it that is done, 0..1. quality: as the setting, %."""
    line = f"round {state.round}: {state.records} records" if state.round else f"{state.records} records"
    if state.sampled:
        return "samples", f"{line}, samples", state.sampled
    if state.error is not None and quality:
        percent = 100.0 * state.error  # which falls as the square root of the work
        return "quality", f"{line}, error {percent:.2g} % to {quality:g} %", min(1.0, (quality / max(percent, 1e-6)) ** 2)
    return "rounds", f"{line}, coverage", state.coverage


@contextmanager
def _quiet_libraries(debug: bool) -> Iterator[None]:
    """Keep the warnings of libraries off stderr, which has one line for an error and nothing else."""
    with warnings.catch_warnings():
        if not debug:
            warnings.simplefilter("ignore")
            logging.getLogger("trimesh").addHandler(logging.NullHandler())
        yield


@contextmanager
def _ended_as_by_ctrl_c() -> Iterator[None]:
    """While this lasts, a request to end (SIGTERM) does what Ctrl-C does, which writes the last whole round."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not in the main thread, which is the only one that may
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
