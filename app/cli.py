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
from typing import TYPE_CHECKING, Any

from irrsplat.app import flags
from irrsplat.app.common.outputs import Outputs, missing, twins
from irrsplat.app.common.terminal import progress, say, wrote
from irrsplat.core.errors import InputError, IrrsplatError

if TYPE_CHECKING:
    from irrsplat.app.common.parser import Mistakes
    from irrsplat.app.render_path import OnRound
    from irrsplat.image.statistics import Statistics
    from irrsplat.image.view import Progress
    from irrsplat.scene.model import Camera, Scene
    from irrsplat.settings import SettingValues

INTERRUPTED = 130


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
    from irrsplat.app import false_colours, render_path
    from irrsplat.image.frame import needed

    settings.preset(args.preset, **args.values)
    buffers, with_figures = _buffers(args), _has_folder(args)
    coloured = false_colours.checked(args)

    import irrsplat

    scene = irrsplat.load(args.scene, **vars(args.loading))
    flight = None if args.path is None else render_path.plan(args, scene)
    camera = _camera(args, scene)
    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, **args.values) as renderer:
        if args.cache is not None and os.path.exists(args.cache):
            renderer.load_cache(args.cache)
        for notice in (*scene.notices, *renderer.notices):
            say(f"notice: {notice}")
        outputs = Outputs()
        with _round_progress(args) as on_round:
            if flight is not None:
                done, complete = render_path.render(renderer, flight, buffers, with_figures, on_round, outputs, coloured)
            else:
                wanted = None if with_figures or coloured is not None else needed(args.output, buffers)
                frame = renderer.render(camera, progress=on_round, figures=with_figures, buffers=wanted)
        if flight is None and frame.stats.get("interrupted") and not frame.stats.get("rounds"):
            return _fail("interrupted before the first round was complete; nothing was written", INTERRUPTED)
        for path in args.output if flight is None else ():
            outputs.write(path, partial(render_path.save, path, frame, buffers, coloured, renderer, camera))
        if args.cache is not None and renderer.cache.count:
            outputs.write(args.cache, partial(renderer.save_cache, args.cache))
    if flight is None:
        return _end_of_render(args, frame.stats, outputs)
    unfinished = None if complete else f"{len(done)} of {len(flight.numbers)} frames were written"
    return _end_of_path(args, done, unfinished, outputs)


def measure(args: argparse.Namespace) -> int:
    """`irrsplat measure`: light on a plane or at points."""
    from irrsplat.app import measure as measuring

    measuring.check(args)

    import irrsplat

    return measuring.run(irrsplat.load(args.scene, **vars(args.loading)), args)


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


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "view": view,
    "render": render,
    "measure": measure,
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


def _check_outputs(args: argparse.Namespace, mistakes: Mistakes) -> None:
    """Add to `mistakes` which outputs, and files of --stats and --cache, cannot be written, and which buffers there are not."""
    from irrsplat.app import render_path
    from irrsplat.core import files
    from irrsplat.image.frame import check_writable

    names = []
    for pattern in () if "output" in mistakes.arguments else args.output:
        with mistakes.gathered():
            names.append(pattern if args.path is None else render_path.first_name(args, pattern))
    for name in names:
        for buffers in (None, _buffers(args)):
            with mistakes.gathered():
                check_writable(name, buffers)
    for path in (args.stats, args.cache):
        if path is not None:
            with mistakes.gathered():
                files.check_file(path)
    for twin in twins(names, (("--stats", args.stats), ("--cache", args.cache))):
        mistakes.add(twin)


def _buffers(args: argparse.Namespace) -> list[str] | None:
    """The names that --buffers has; None: all."""
    return None if args.buffers is None else [name.strip() for name in args.buffers.split(",")]


def _has_folder(args: argparse.Namespace) -> bool:
    """Whether one of the outputs is a folder, which has the paper's figures."""
    from irrsplat.app import render_path
    from irrsplat.image.frame import check_writable

    names = args.output if args.path is None else [render_path.first_name(args, pattern) for pattern in args.output]
    return "" in [check_writable(name) for name in names]


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
    if not stats.get("converged", True):
        say(f"notice: stopped after {stats.get('rounds')} rounds {_unserved([stats])}")
    return 0


def _end_of_path(args: argparse.Namespace, done: list[Statistics], interrupted: str | None, outputs: Outputs) -> int:
    """The same for the frames of a path that are `done`. interrupted: how far it came; None: to its end."""
    _write_stats(args, {"frames": done}, outputs)
    outputs.tell()
    if interrupted is not None:
        return _fail(f"interrupted; {interrupted}", INTERRUPTED)
    if short := sum(not stats.get("converged", True) for stats in done):
        say(f"notice: {short} of {len(done)} frames stopped {_unserved(done)}")
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
    line = f"round {state.round}: {state.records} records"
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
