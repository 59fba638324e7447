"""Objects carried through a scene under a frame budget: error of a frame's irradiance against a fresh render."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

import irrsplat
from irrsplat.app.common.terminal import columns, doing, out
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.core.timing.clock import Clock, RayClock, use_clock
from irrsplat.gpu.target import pixels
from irrsplat.image.frame import Frame
from irrsplat.image.view import Progress, View
from irrsplat.image.view import read as read_view
from irrsplat.reference.truth import errors
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Light, Scene
from irrsplat.scene.motion import moved

SPEED = 1.4  # metres per second, a walk
RATE = 15  # frames per second
TICK = 0.08  # seconds per frame, the frame budget
FRAMES = 28
EVERY = 4  # one frame in EVERY is compared with a reference
NEAR = 0.5  # metres: neighbourhood of a moving mesh (from its bounding box) or light
SIZE = (200, 150)
PACE = 2e6  # rays per second of the counted clock: about two processors without a GPU
LEGEND = f"""\
a mesh or a light moves at {SPEED:g} m/s, {RATE} frames per second, one tick of {1e3 * TICK:.0f} ms per frame
with --counted a tick is {1e-3 * TICK * PACE:.0f} thousand rays instead, so that results do not depend on the machine
off: RMSE of irradiance relative to its mean, in %, against a new render of the frame's scene, over the whole picture
near: RMSE within {NEAR:g} m of the mesh or its last position, relative to the mean there
bare: share of pixels without records, in %; they show the surface cache
stale: stale records at the end of the frame; ms: wall time of a frame, including the move\
"""


@dataclass(frozen=True)
class Case:
    """Object carried through the scene `scene` along `way`, in metres: a mesh by name or a light by index."""

    scene: str
    carried: str | int
    way: tuple[float, float, float]

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.scene}, {self.carried if isinstance(self.carried, str) else f'light {self.carried}'}"


def _way(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the total displacement in this direction over all frames."""
    x, y, z = (float(v) for v in np.array([x, y, z]) / np.linalg.norm([x, y, z]) * SPEED * FRAMES / RATE)
    return x, y, z


CASES = (
    Case("cornell", "short", _way(1.0, 0.0, -0.19)),
    Case("cornell", 0, _way(-0.3, -0.55, -0.8)),
    Case("atrium", "fountain", _way(-1.0, 0.0, -0.6)),
    Case("atrium", 1, _way(-1.0, 0.0, 0.2)),
)


@dataclass(frozen=True)
class Step:
    """One frame compared with its reference; off, near: relative RMSE, near is None without pixels near the object.

    bare: share of the visible pixels without a record.
    """

    frame: int
    off: float
    near: float | None
    bare: float
    stale: int
    new: int
    renewed: int
    surface: float
    milliseconds: float


def at(scene: Scene, case: Case, share: float) -> Scene:
    """Return the scene with the object at the share 0..1 of its way."""
    offset = share * np.asarray(case.way)
    if isinstance(case.carried, str):
        matrix = np.eye(4)
        matrix[:3, 3] = offset
        return moved(scene, scene.meshes, case.carried, matrix)
    lights = list(scene.lights)
    lights[case.carried] = _shifted(lights[case.carried], offset)
    return replace(scene, lights=tuple(lights))


def _shifted(light: Light, offset: np.ndarray) -> Light:
    x, y, z = (float(v) for v in np.add(light.position, offset))
    if light.spot_target is None:
        return replace(light, position=(x, y, z))
    u, v, w = (float(t) for t in np.add(light.spot_target, offset))
    return replace(light, position=(x, y, z), spot_target=(u, v, w))


def carry(renderer: Renderer, case: Case, frames: int = FRAMES) -> Iterator[tuple[int, View, Progress, float]]:
    """Yield frames 1 to `frames` of a renderer with a converged view: number, picture, progress and milliseconds."""
    scene = renderer.scene
    for frame in range(1, frames + 1):
        start = time.perf_counter()
        if isinstance(case.carried, str):
            matrix = np.eye(4)
            matrix[:3, 3] = frame / FRAMES * np.asarray(case.way)
            renderer.move(case.carried, matrix)
        else:
            renderer.relight(at(scene, case, frame / FRAMES).lights)
        view, progress = renderer.frame(seconds=TICK)
        yield frame, view, progress, 1e3 * (time.perf_counter() - start)


def measure(case: Case, scene: Scene, clock: Clock, notify: Callable[[str], object] = lambda words: None) -> Iterator[Step]:
    """Yield the compared frames of a case with a frame budget by this clock; notify: called with progress messages."""
    truths: dict[int, Frame] = {}
    for frame in range(EVERY, FRAMES + 1, EVERY):
        notify(f"{case.name}: truth of frame {frame}")
        with Renderer(at(scene, case, frame / FRAMES), SIZE) as fresh:
            truths[frame] = fresh.render()
    notify(f"{case.name}: carrying")
    with use_clock(clock), Renderer(scene, SIZE) as renderer:
        renderer.render()
        for frame, view, progress, milliseconds in carry(renderer, case):
            if frame not in truths:
                continue
            truth, found = truths[frame], read_view(view, renderer.cache.read(), {})
            seen = np.isfinite(truth.depth)
            near = seen & _near(case, scene, frame, truth.position)
            off = errors(found.irradiance[seen], truth.irradiance[seen])["rmse"]
            close = errors(found.irradiance[near], truth.irradiance[near])["rmse"] if near.any() else None
            counts = progress.stale, progress.new, progress.renewed
            bare = float((pixels(view.splats.weight)[..., 0][seen] <= 0.0).mean())
            yield Step(frame, off or 0.0, close, bare, *counts, progress.surface, milliseconds)


def _near(case: Case, scene: Scene, frame: int, position: np.ndarray) -> np.ndarray:
    """Return a mask (H, W): True at positions (H, W, 3) within NEAR of the object's present or previous place."""
    near = np.zeros(position.shape[:2], bool)
    for share in ((frame - 1) / FRAMES, frame / FRAMES):
        there = at(scene, case, share)
        if isinstance(case.carried, str):
            place = next(mesh for mesh in there.meshes if mesh.name == case.carried).positions
        else:
            place = np.array([there.lights[case.carried].position])
        gap = np.maximum(np.maximum(place.min(0) - position, position - place.max(0)), 0.0)
        near |= np.linalg.norm(gap, axis=-1) < NEAR
    return near


def run(args: Namespace) -> int:
    """Measure all cases, or those of the named scenes, print a table, and write JSON on request; return the exit status.

    Raises InputError for incompatible flags and for scenes without a case.
    """
    if args.size or args.preset or args.peers or args.growth or args.compare or args.output:
        raise InputError("--moving has a size and a preset of its own; give it with scenes and --json alone")
    known = list(dict.fromkeys(case.scene for case in CASES))
    if unknown := [name for name in args.scenes if name not in known]:
        raise InputError(f"--moving has nothing to carry through '{unknown[0]}'; its scenes are {', '.join(known)}")
    rows: list[tuple[str, ...]] = [("carried", "frame", "off %", "near %", "bare %", "stale", "new", "renewed", "ms")]
    found: list[dict[str, object]] = []
    for case in CASES:
        if args.scenes and case.scene not in args.scenes:
            continue
        for step in measure(case, irrsplat.load(case.scene), RayClock(PACE) if args.counted else Clock(), doing):
            shares = (step.off, 1), (step.near, 1), (step.bare, 2)
            errors_of = [f"{100.0 * share:.{digits}f}" if share is not None else "-" for share, digits in shares]
            counts = (str(step.stale), str(step.new), str(step.renewed), f"{step.milliseconds:.0f}")
            rows.append((case.name, str(step.frame), *errors_of, *counts))
            found.append({"case": case.name} | asdict(step))
    doing("")
    out("\n".join([LEGEND, "", *columns(rows, left=1)]))
    if args.json is not None:
        files.write_text(args.json, files.json_text({"moving": found}) + "\n")
    return 0
