"""A bad day: killed at any moment, a disk that is full or read-only, Ctrl-C anywhere, a clock that jumps, files edited while they
are read. Outputs are as before or whole, an error is one line, and the next run works.

IRRSPLAT_FAULTS: how often each is tried (4). IRRSPLAT_SEED: which moments (1). With -s, what came of it is summed up.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat import InputError, Renderer
from irrsplat.app.viewer import file_watch
from irrsplat.records import cache_file
from tests.app.conftest import PLAIN, TRIANGLE
from tests.renderer.test_live import ticks
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.gltf_files import GltfFile
from tests.trust.harm import at_line, killed, limited, rendered, signalled

TIMES = int(os.environ.get("IRRSPLAT_FAULTS", "4"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "1"))
OUTPUTS = ["a.png", "a.exr", "a.npz", "new", "old", "a.cache", "a.json"]  # new, old: folders, of which old is there already
RENDER = [
    *("render", "plain.scene", "--size", "40", "30", "--gather-size", "8", "--shadow-size", "64", "--bounces", "1"),
    *("-o", "a.png", "-o", "a.exr", "-o", "a.npz", "-o", "new", "-o", "old", "--cache", "a.cache", "--stats", "a.json"),
]

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked, and end by signals")


@pytest.fixture
def place(tmp_path: Path) -> Path:
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "plain.scene").write_text(PLAIN)
    (folder / "triangle.obj").write_text(TRIANGLE)
    return folder


# ---- what has to hold of the files -------------------------------------------------------------------------------------------


def read(path: Path) -> object:
    """What is in an output, read whole; raises what its reader raises for a damaged one."""
    if path.is_dir():
        return [read(one) for one in sorted(path.iterdir())]
    if path.suffix == ".png":
        with Image.open(path) as image:
            return np.asarray(image).shape
    if path.suffix == ".npz":
        with np.load(path) as file:
            return {name: file[name].shape for name in file.files}
    if path.suffix == ".exr":
        import OpenEXR

        with OpenEXR.File(str(path)) as file:
            return {name: channel.pixels.shape for name, channel in file.channels().items()}
    return cache_file._read(path)[0] if path.suffix == ".cache" else json.loads(path.read_text())


def check(place: Path, old: dict[str, bytes], parts: bool) -> Counter[str]:
    """Each output is as it was, missing as it was, or whole; how many are which. parts: temporary files may be there, too."""
    found: Counter[str] = Counter()
    for path in place.iterdir():
        if path.name.startswith(".irrsplat-"):
            assert parts, f"{path.name} stays behind"
            found["parts left"] += 1
        elif path.name not in ("plain.scene", "triangle.obj"):
            assert path.name in OUTPUTS, path.name
            if path.is_file() and path.read_bytes() == old.get(path.name):
                found["as before"] += 1
            else:
                read(path) if path.name != "old" else [read(one) for one in path.glob("[!.]*.png")]
                assert parts or path.name != "old" or not list(path.glob(".*"))
                found["whole"] += 1
    return found


def laid(place: Path, draw: np.random.Generator) -> dict[str, bytes]:
    """Some outputs of another run, the folder `old` among them; their content by name."""
    (place / "old").mkdir()
    files = {name: b"old" for name in OUTPUTS if name not in ("new", "old", "a.cache") and draw.random() < 0.5}
    for name, content in files.items():
        (place / name).write_bytes(content)
    return files


def emptied(place: Path) -> None:
    for path in sorted(place.rglob("*"), reverse=True):
        if path.is_dir():
            path.rmdir()
        elif path.name not in ("plain.scene", "triangle.obj"):
            path.unlink()


# ---- killed ------------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_killed_at_any_moment(place: Path) -> None:
    """`kill -9` around the moments at which files are made, filled and renamed: the next run finds all as before or whole, works,
    and leaves nothing of the killed one behind."""
    draw, found = np.random.default_rng(SEED), Counter[str]()
    while found["killed"] < TIMES:
        emptied(place)
        old = laid(place, draw)
        event, seconds = int(draw.integers(1, 70)), float(draw.choice([0.0, draw.uniform(0.0, 0.004)]))
        status, _ = rendered(place, RENDER, killed, event, seconds)
        assert status in (0, -signal.SIGKILL)
        found["killed" if status else "done before"] += 1
        found += check(place, old, parts=True)
        status, said = rendered(place, RENDER)
        assert (status, said) == (0, "")
        assert not [*place.rglob(".irrsplat-*")] and check(place, {}, parts=False)["whole"] == len(OUTPUTS)
    print(f"\nkill -9: {dict(found)}")


# ---- no room, and no permission ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_full_disk(place: Path) -> None:
    """No file may be longer than so many bytes: those that are shorter are written, all others are named in one line."""
    draw, found = np.random.default_rng(SEED), Counter[str]()
    for _ in range(TIMES):
        emptied(place)
        old, most = laid(place, draw), int(np.exp(draw.uniform(np.log(64), np.log(300_000))))
        status, said = rendered(place, RENDER, limited, most)
        assert status in (0, 1) and said.count("\n") == status, said
        told = check(place, old, parts=False)
        missing = len(OUTPUTS) - told["whole"]
        assert said.count("cannot write: File too large") >= (missing > 0) and (status == 1) == (missing > 0), (said, told)
        found += told
        found["told"] += said.count("cannot write")
    print(f"\nat most so long a file: {dict(found)}")


@contextmanager
def mounted(folder: Path, options: str) -> Iterator[None]:
    """A file system of its own in `folder`, where that is allowed."""
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True, check=False).returncode:
        pytest.skip("no file system may be mounted here")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def copied(place: Path, folder: Path) -> None:
    for name in ("plain.scene", "triangle.obj"):
        (folder / name).write_bytes((place / name).read_bytes())


@pytest.mark.slow
def test_a_small_disk(place: Path) -> None:
    """A file system of so many bytes: outputs for which there is room are whole, the others are told."""
    draw, found = np.random.default_rng(SEED), Counter[str]()
    for number in range(TIMES):
        folder = place / f"disk{number}"
        with mounted(folder, f"size={int(draw.integers(3, 120)) * 4096}"):
            copied(place, folder)
            status, said = rendered(folder, RENDER)
            assert status in (0, 1, 2) and said.count("\n") == (status != 0), said
            told = check(folder, {}, parts=False)
            assert (status == 0) == (told["whole"] == len(OUTPUTS)), (said, told)
            assert not status or "No space left on device" in said
            found += told
        folder.rmdir()
    print(f"\nsmall disks: {dict(found)}")


def test_a_read_only_disk(place: Path) -> None:
    """Told before any work, and nothing is there."""
    folder = place / "disk"
    with mounted(folder, "size=1m"):
        copied(place, folder)
        subprocess.run(["mount", "-o", "remount,ro", folder], check=True)
        status, said = rendered(folder, RENDER)
        assert status == 2 and said.count("\n") == 1 and said.count("cannot write: Read-only file system") == len(OUTPUTS)
        assert {path.name for path in folder.iterdir()} == {"plain.scene", "triangle.obj"}


# ---- interrupted -------------------------------------------------------------------------------------------------------------


def lines_of_a_render(place: Path) -> int:
    """So many lines of irrsplat are executed by a whole one."""
    low, high = 1000, 10_000_000
    while high > 1.1 * low:
        middle = int((low * high) ** 0.5)
        status, _ = rendered(place, RENDER, at_line, middle)
        low, high = (low, middle) if status == 0 else (middle, high)
    return low


@pytest.mark.slow
def test_ctrl_c_at_every_stage(place: Path) -> None:
    """Before lines that lie evenly in all that a render executes: one line, status 130, and whole files."""
    draw, found = np.random.default_rng(SEED), Counter[str]()
    lines = lines_of_a_render(place)
    for share in (np.arange(TIMES) + draw.random()) / TIMES:
        emptied(place)
        old = laid(place, draw)
        status, said = rendered(place, RENDER, at_line, int(share * lines))
        assert status in (0, 130), (int(share * lines), status, said)
        assert said.count("\n") == (status == 130) and "Traceback" not in said
        found += check(place, old, parts=False)
        found[f"status {status}"] += 1
    print(f"\nCtrl-C in {lines} lines: {dict(found)}")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_at_any_time(place: Path, number: signal.Signals) -> None:
    """As they really come, also within numpy, OpenGL and the writers of files."""
    draw, found = np.random.default_rng(SEED), Counter[str]()
    start = time.perf_counter()
    rendered(place, RENDER)
    whole = time.perf_counter() - start
    for _ in range(TIMES):
        emptied(place)
        old, seconds = laid(place, draw), float(draw.uniform(0.02, 1.2 * whole))
        status, said = rendered(place, RENDER, signalled, int(number), seconds)
        assert status in (0, 130), (status, said)
        assert said.count("\n") == (status == 130) and "Traceback" not in said
        found += check(place, old, parts=False)
        found[f"status {status}"] += 1
    print(f"\n{number.name}: {dict(found)}")


# ---- clocks and editors ------------------------------------------------------------------------------------------------------


def test_a_clock_that_leaps_changes_no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hours forward (a suspended machine), and back by the wall clock: ticks come to rest with the records of whole rounds."""
    draw, real, wall = np.random.default_rng(SEED), time.perf_counter, time.time
    leapt = 0.0

    def later() -> float:
        nonlocal leapt
        leapt += float(draw.choice([0.0, 0.0, 0.0, 3600.0]))
        return real() + leapt

    with Renderer(room(), SIZE, **FAST) as whole, Renderer(room(), SIZE, **FAST) as leaping:
        whole.render()
        monkeypatch.setattr(time, "perf_counter", later)
        monkeypatch.setattr(time, "time", lambda: wall() + float(draw.uniform(-1e6, 1e6)))
        assert ticks(leaping, 0.01)[-1].coverage == 1.0
        one, two = (sorted(renderer.cache.read()["position"].tolist()) for renderer in (whole, leaping))
        assert one == two


def test_a_file_of_tomorrow_is_read_again_all_the_same(tmp_path: Path) -> None:
    """The clock was set back, or the file lies on a server whose clock is ahead: it counts as left alone at the second look."""
    path = tmp_path / "a.scene"
    path.write_text("sky 1 1 1\n")
    watch = file_watch.FileWatch([str(path)])
    path.write_text("sky 1 1 1 # more\n")
    then = time.time() + 1e5
    os.utime(path, (then, then))
    looks = []
    for _ in range(3):
        watch._next = 0.0
        looks.append(watch.changed())
    assert looks == [False, True, False]


def written_glb(path: Path) -> None:
    file = GltfFile()
    file.add("scenes", {"nodes": [file.node(mesh=file.mesh())]})
    file.glb(path)


EDITED: dict[str, Callable[[Path], object]] = {
    "a.scene": lambda path: path.write_text(PLAIN.replace("triangle", "a")),
    "a.obj": lambda path: path.write_text(TRIANGLE + "# more\n" * 200),
    "b.glb": written_glb,
}


@pytest.mark.parametrize("name", EDITED)
def test_a_scene_that_is_edited_while_it_is_read(name: str, tmp_path: Path) -> None:
    """By an editor that writes in place, and by one that cuts it short: a scene comes of it, or an error of one line."""
    for file, write in EDITED.items():
        write(tmp_path / file)
    path = tmp_path / name
    content, draw, ended, found = path.read_bytes(), np.random.default_rng(SEED), threading.Event(), Counter[str]()

    def edit() -> None:
        while not ended.is_set():
            cut = int(draw.integers(len(content) + 1))
            with open(path, "r+b") as file:
                file.truncate(cut)
                file.seek(cut)
                file.write(content[cut:])

    editor = threading.Thread(target=edit)
    editor.start()
    try:
        for _ in range(25 * TIMES):
            try:
                irrsplat.load(str(tmp_path / ("b.glb" if name == "b.glb" else "a.scene")))
                found["read"] += 1
            except InputError as error:
                assert "\n" not in str(error)
                found["refused"] += 1
    finally:
        ended.set()
        editor.join()
    assert irrsplat.load(str(tmp_path / ("b.glb" if name == "b.glb" else "a.scene"))).meshes
    print(f"\n{name}: {dict(found)}")
