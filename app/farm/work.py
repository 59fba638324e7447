"""Tasks of a farm's worker: fill caches and render frames of a job with one persistent renderer."""

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

# OpenGL belongs to one thread, and Dask runs a worker's tasks in several
_thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="irrsplat")
_kept: dict[Job, Renderer] = {}  # of the last job only
_loaded: dict[str, int] = {}  # hash of the file behind the renderer's records


@dataclass(frozen=True)
class Job:
    """Common data of all tasks of a command.

    scene: a path valid on all machines, or a bundled scene's name. key: expected key of scene and settings on the worker.
    software: version and code digest of the sender's irrsplat.
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
    """Bytes of a cache file with the records of some frames, and the result of the filling."""

    cache: bytes
    done: filling.Filled


@dataclass(frozen=True)
class Rendered:
    """Statistics and files of some frames.

    files: bytes by frame number and output index. A folder has an entry for each name; a plain file has the empty name.
    """

    stats: list[Statistics]
    files: dict[tuple[int, int], dict[str, bytes]]


def driver() -> str:
    """Return this process's OpenGL and irrsplat version: rendered bits depend on both."""
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
    """Gather the records of these frames, starting with those of the cache file `start`.

    Raises InputError if scene, settings or irrsplat differ from the job's.
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
    """Render these frames from the frozen cache as files. drawn_by: expected `driver`.

    Raises InputError as `fill`, and for another driver, whose bits would differ.
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
            written.raise_failures()
            found = {(number, i): _read(File(numbered(name, number))) for number in numbers for i, name in enumerate(names)}
        return Rendered(stats, found)

    return _in_thread(work)


def release() -> None:
    """Free all data kept between tasks."""

    def free() -> None:
        while _kept:
            _kept.popitem()[1].release()
        _loaded.clear()

    _in_thread(free)


def _renderer(job: Job) -> Renderer:
    """Return the renderer of a job; reuse the previous one for an equal job."""
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
    """Replace the renderer's records with those of a cache file."""
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
    """Return the bytes of a file under the empty name, or of all files in a folder by name."""
    if not path.is_dir():
        return {"": path.read_bytes()}
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def _in_thread(work: Callable[[], Result]) -> Result:
    """Run `work` in the OpenGL thread and return its result; errors are converted to serializable ones."""
    return _thread.submit(work).result()
