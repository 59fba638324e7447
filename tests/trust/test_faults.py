"""Faults: SIGKILL at any moment, a full disk, Ctrl-C anywhere, a clock that jumps.

Outputs are unchanged or complete, an error is one line, and the next run works. IRRSPLAT_FAULTS: repetitions of each fault
in the long form (4). IRRSPLAT_SEED: the seed of the moments (1). With -s, a summary is printed.
"""

from __future__ import annotations

import json
import os
import signal
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat import Renderer
from irrsplat.app import cli
from irrsplat.core.timing.clock import use_clock
from irrsplat.core.timing.input_waits import InputWaits, checked_by
from irrsplat.records import cache_file
from tests.app.conftest import PLAIN, TRIANGLE
from tests.renderer.test_renderer import FAST, room
from tests.support.counted_clock import CountedClock
from tests.support.interrupts import run
from tests.trust.harm import at_line, killed, limited, rendered, signalled

TIMES = int(os.environ.get("IRRSPLAT_FAULTS", "4"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "1"))
OUTPUTS = ["a.png", "a.exr", "a.npz", "new", "old", "a.cache", "a.json"]  # new, old: folders; old already exists
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


# ---- conditions on the files -------------------------------------------------------------------------------------------------


def read(path: Path) -> object:
    """Return the contents of an output, read completely; raise its reader's error for a damaged one."""
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
    return cache_file.read_any(path) if path.suffix == ".cache" else json.loads(path.read_text())


def check(place: Path, old: dict[str, bytes], parts: bool) -> Counter[str]:
    """Assert that each output is unchanged, still missing, or complete; return the counts.

    parts: temporary files are allowed.
    """
    found: Counter[str] = Counter()
    for path in place.iterdir():
        if path.name.startswith(".irrsplat-"):
            assert parts, f"temporary file {path.name} is left"
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


def write_old(place: Path, draw: np.random.Generator) -> dict[str, bytes]:
    """Write some outputs of an earlier run, including the folder `old`; return their contents by name."""
    (place / "old").mkdir()
    files = {name: b"old" for name in OUTPUTS if name not in ("new", "old", "a.cache") and draw.random() < 0.5}
    for name, content in files.items():
        (place / name).write_bytes(content)
    return files


def remove_outputs(place: Path) -> None:
    for path in sorted(place.rglob("*"), reverse=True):
        if path.is_dir():
            path.rmdir()
        elif path.name not in ("plain.scene", "triangle.obj"):
            path.unlink()


# ---- killed, without space, interrupted --------------------------------------------------------------------------------------


@pytest.mark.parametrize("times", [1, pytest.param(TIMES, marks=pytest.mark.long)])
def test_killed_at_any_moment(times: int, place: Path) -> None:
    """`kill -9` at the creation, writing and renaming of files: the next run finds unchanged or complete outputs, and works."""
    draw, found = np.random.default_rng(SEED), Counter[str]()
    while found["killed"] < times:
        remove_outputs(place)
        old = write_old(place, draw)
        status, _ = rendered(place, RENDER, killed, int(draw.integers(1, 70)))
        assert status in (0, -signal.SIGKILL)
        found["killed" if status else "done before"] += 1
        found += check(place, old, parts=True)
        assert rendered(place, RENDER) == (0, "")
        assert check(place, {}, parts=True)["whole"] == len(OUTPUTS)
    print(f"\nkill -9: {dict(found)}")


@pytest.mark.long
def test_a_full_disk(place: Path) -> None:
    """With a limit of the file size, shorter files are written, and one line names all others."""
    draw, found = np.random.default_rng(SEED), Counter[str]()
    for _ in range(TIMES):
        remove_outputs(place)
        old, most = write_old(place, draw), int(np.exp(draw.uniform(np.log(64), np.log(300_000))))
        status, stderr = rendered(place, RENDER, limited, most)
        assert status in (0, 1) and stderr.count("\n") == status, stderr
        counts = check(place, old, parts=False)
        missing = len(OUTPUTS) - counts["whole"]
        assert stderr.count("cannot write: File too large") >= (missing > 0) and (status == 1) == (missing > 0), (stderr, counts)
        found += counts
    print(f"\nlimited file size: {dict(found)}")


@pytest.mark.long
@pytest.mark.parametrize("how", ["Ctrl-C before a line", "SIGINT", "SIGTERM"])
def test_interrupted_at_any_moment(how: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupts before evenly spaced lines, and signals at random times, also within numpy and OpenGL.

    Each gives one line, status 130, and complete files.
    """
    draw, found = np.random.default_rng(SEED), Counter[str]()
    monkeypatch.chdir(place)
    lines = run(lambda: cli.main(RENDER))[0] if "line" in how else 0
    for share in (np.arange(TIMES) + draw.random()) / TIMES:
        remove_outputs(place)
        old = write_old(place, draw)
        if lines:
            status, stderr = rendered(place, RENDER, at_line, int(share * lines))
        else:
            status, stderr = rendered(place, RENDER, signalled, int(signal.Signals[how]), float(1.5 * share))
        assert status in (0, 130), (status, stderr)
        assert stderr.count("\n") == (status == 130) and "Traceback" not in stderr
        found += check(place, old, parts=False)
        found[f"status {status}"] += 1
    print(f"\n{how}: {dict(found)}")


# ---- clocks -------------------------------------------------------------------------------------------------------------------


class JumpingClock(CountedClock):
    """Clock that sometimes jumps by an hour, as after suspension of a machine."""

    def __init__(self) -> None:
        super().__init__()
        self.draw = np.random.default_rng(SEED)

    def now(self) -> float:
        self.advance(float(self.draw.choice([0.0, 0.0, 0.0, 3600.0])))
        return super().now()


@pytest.mark.parametrize("busy", [0.0, 0.2])
def test_a_jumping_clock_and_pending_input_change_no_picture(busy: float) -> None:
    """Limited frames converge with the records of whole rounds. busy: share of the checks with pending input."""
    clock, done = JumpingClock(), False
    with Renderer(room(), (24, 20), **FAST) as whole, Renderer(room(), (24, 20), **FAST) as framed, use_clock(clock):
        whole.render()
        with checked_by(lambda: bool(clock.draw.random() < busy)):
            for _ in range(6000):
                with suppress(InputWaits):
                    progress = framed.frame(seconds=0.01)[1]
                    done = progress.done
                if done:
                    break
        assert done and progress.coverage == 1.0
        one, two = (sorted(renderer.cache.read()["position"].tolist()) for renderer in (whole, framed))
        assert one == two
