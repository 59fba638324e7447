"""What a worker of a farm does: it fills caches and renders frames of a job, with one renderer that it keeps."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path as File
from typing import TYPE_CHECKING, TypeVar

from irrsplat.app.common.outputs import Outputs
from irrsplat.app.common.version import software
from irrsplat.app.film import fill as filling
from irrsplat.app.film import frames
from irrsplat.app.film.flight import Flight
from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.image.frame import numbered
from irrsplat.records import cache_file
from irrsplat.records.cache_file import CacheKey
from irrsplat.scene.camera_path import Path
from irrsplat.settings import SettingValues, preset

if TYPE_CHECKING:
    from irrsplat.app.common.pictures import Pictures
    from irrsplat.image.statistics import Statistics
    from irrsplat.renderer import Renderer

Result = TypeVar("Result")

# OpenGL belongs to one thread, and Dask calls a worker's tasks from several
_thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="irrsplat")
_kept: dict[Job, Renderer] = {}  # of the last job alone
_loaded: dict[str, int] = {}  # what the kept renderer's records are: the hash of a file's bytes


@dataclass(frozen=True)
class Job:
    """The facts that all tasks of one command share, to be sent to workers.

    scene: a path that is the same on all machines, or a bundled scene's name. key: what the scene and the settings are to be
    there. software: the irrsplat that asks, by its version and code.
    """

    scene: str
    loading: LoadOptions
    key: CacheKey = field(hash=False)
    size: tuple[int, int]
    preset: str
    values: SettingValues = field(hash=False)
    path: Path = field(hash=False)
    software: str = field(default_factory=software)


@dataclass(frozen=True)
class Part:
    """A cache file's bytes with the records of some frames, and what came of filling it."""

    cache: bytes
    done: filling.Filled


@dataclass(frozen=True)
class Rendered:
    """The statistics of some frames, and the files that they went to: bytes by the number of the frame and of its output, of a
    folder by the names in it; that of a plain file is the empty text."""

    stats: list[Statistics]
    files: dict[tuple[int, int], dict[str, bytes]]


def driver() -> str:
    """The OpenGL of this process and the version of irrsplat: what is rendered depends on both, to the bit."""
    return _in_thread(_driver)


@cache
def _driver() -> str:
    from irrsplat.gpu import context

    ctx = context.create()
    try:
        return context.machine(context.describe(ctx))
    finally:
        ctx.release()


def fill(job: Job, numbers: range, start: bytes | None = None) -> Part:
    """The records that the frames of these numbers ask for, beside those of the cache file `start`.

    Raises InputError where scene, settings or irrsplat are others here than where the job comes from.
    """

    def work() -> Part:
        renderer = _renderer(job)
        _take(renderer, start)
        _loaded.clear()
        done = filling.fill(renderer, Flight(job.path, numbers))
        return Part(_bytes(renderer), done)

    return _in_thread(work)


def render(
    job: Job,
    numbers: range,
    records: bytes,
    outputs: Sequence[str],
    buffers: list[str] | None,
    files: Pictures,
    drawn_by: str,
) -> Rendered:
    """The frames of these numbers from the frozen cache, as files. drawn_by: what `driver` is to be here.

    Raises InputError as `fill`, and where the driver is another, since bits would differ.
    """
    if (here := driver()) != drawn_by:
        raise InputError(f"this worker draws by '{here}', another by '{drawn_by}', and their frames would differ in their bits")

    def work() -> Rendered:
        renderer = _renderer(job)
        _take(renderer, records)
        with tempfile.TemporaryDirectory() as folder:
            names = [str(File(folder) / f"{i}-{{frame}}{File(name).suffix}") for i, name in enumerate(outputs)]
            written = Outputs()
            flight = Flight(job.path, numbers, tuple(names))
            stats, _ = frames.render(renderer, flight, buffers, False, None, written, files, frozen=True)
            written.tell()
            found = {(number, i): _read(File(numbered(name, number))) for number in numbers for i, name in enumerate(names)}
        return Rendered(stats, found)

    return _in_thread(work)


def release() -> None:
    """Free what this process keeps between tasks."""

    def free() -> None:
        while _kept:
            _kept.popitem()[1].release()
        _loaded.clear()

    _in_thread(free)


def _renderer(job: Job) -> Renderer:
    """The renderer of a job, the one of the last task where that was for the same."""
    import irrsplat

    if job in _kept:
        return _kept[job]
    while _kept:
        _kept.popitem()[1].release()
    _loaded.clear()
    if software() != job.software:
        raise InputError(f"this worker has irrsplat {software()}, and the job is for {job.software}; install the same on all")
    scene = irrsplat.load(job.scene, **vars(job.loading))
    here = cache_file.key(scene.recentred.local, preset(job.preset, **job.values))
    if reason := cache_file.difference(here, job.key):
        raise InputError(
            f"the scene of this worker was made {reason}; bring its files to the same state on all machines", job.scene
        )
    made = irrsplat.Renderer(scene, job.size, job.preset, tile_size=0, **job.values)
    _kept[job] = made
    return made


def _take(renderer: Renderer, records: bytes | None) -> None:
    """Let the renderer hold the records of a cache file, and no others."""
    if records is None:
        renderer.forget()
        _loaded.clear()
    elif _loaded.get("records") != hash(records):
        with tempfile.TemporaryDirectory() as folder:
            file = File(folder) / "records.cache"
            file.write_bytes(records)
            renderer.load_cache(file)
        _loaded["records"] = hash(records)


def _bytes(renderer: Renderer) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        file = File(folder) / "records.cache"
        renderer.save_cache(file)
        return file.read_bytes()


def _read(path: File) -> dict[str, bytes]:
    """The bytes of a file, by the empty text, or of all files in a folder, by their names."""
    if not path.is_dir():
        return {"": path.read_bytes()}
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def _in_thread(work: Callable[[], Result]) -> Result:
    """What `work` gives, done in the thread that OpenGL belongs to. Errors come back as such that can be sent."""
    return _thread.submit(work).result()
