"""Scripted flight through an off-screen viewer window: frame times while the cache fills, and afterwards."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as File
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.scene.camera_path import Path, load_path
from irrsplat.scene.model import Camera, Scene

if TYPE_CHECKING:
    from irrsplat.app.viewer.viewer import Viewer

FRAMES = 150
DT = 1.0 / 30.0  # seconds per frame of the script
LEGEND = """\
frames of the viewer's window with its interface, in a scripted flight; ms: wall time per frame
filling: from an empty cache; warm: the same flight again, with all records along it\
"""


@dataclass(frozen=True)
class Flown:
    """One flight: `ms` of each frame, mean milliseconds by stage, new records, and final records.

    first: seconds from the loaded scene to the first picture, including window and shaders.
    """

    case: str
    first: float
    ms: np.ndarray
    stages: dict[str, float]
    new: int
    records: int

    @property
    def median(self) -> float:
        """Milliseconds of the median frame."""
        return float(np.median(self.ms))

    @property
    def worst(self) -> float:
        """Milliseconds of the longest frame."""
        return float(self.ms.max())


def route(scene: Scene) -> Path:
    """Return the scene's own flight.path, or a flight from its first camera: turns to both sides and a way ahead."""
    camera = scene.camera()
    beside = File(scene.path).parent / "flight.path"
    if beside.is_file():
        return load_path(beside, camera.fov)
    keys = [_moved(camera, ahead, degrees) for ahead, degrees in ((0, 0), (0.1, -25), (0.25, -40), (0.25, 40), (0.1, 25), (0, 0))]
    return Path(tuple(keys), FRAMES)


def _moved(camera: Camera, ahead: float, degrees: float) -> Camera:
    """Return `camera` nearer to its target by the share `ahead`, and turned to the right about its up axis."""
    right, up, backward = camera.axes
    distance = float(np.linalg.norm(np.subtract(camera.target, camera.eye)))
    eye = np.asarray(camera.eye) - ahead * distance * backward
    angle = np.radians(degrees)
    x, y, z = eye + distance * (np.sin(angle) * right - np.cos(angle) * backward)
    return replace(
        camera,
        eye=(float(eye[0]), float(eye[1]), float(eye[2])),
        target=(float(x), float(y), float(z)),
        up=(float(up[0]), float(up[1]), float(up[2])),
    )


def fly(scene: Scene, size: tuple[int, int], frames: int = FRAMES) -> Iterator[Flown]:
    """Yield both flights through `scene` in a window of `size`; the user's preferences stay untouched."""
    from irrsplat.app.viewer.preferences import Preferences
    from irrsplat.app.viewer.viewer import Viewer
    from irrsplat.app.viewer.window import open_window

    path = route(scene)
    cameras = [path.camera(t) for t in np.linspace(0.0, path.frames - 1, frames)]
    start = time.perf_counter()
    wnd = open_window(size, headless=True)
    try:
        viewer = Viewer(wnd, scene, scene.name, Preferences())
        try:
            _frame(viewer, cameras[0])
            first = time.perf_counter() - start
            while viewer.actions.session.progress[0].surface < 1.0:
                _frame(viewer, cameras[0])
            viewer.actions.clear()
            yield _flight("filling", first, viewer, cameras)
            for camera in cameras:
                viewer.actions.session.renderers[0].converge(camera)
            yield _flight("warm", first, viewer, cameras)
        finally:
            viewer.close(remember=False)
    finally:
        wnd.destroy()


def _frame(viewer: Viewer, camera: Camera) -> float:
    """Render one frame from `camera`; return its milliseconds."""
    start = time.perf_counter()
    viewer.actions.session.free_camera.go(camera)
    viewer.wnd.use()
    viewer.frame(DT)
    viewer.wnd.swap_buffers()
    return 1e3 * (time.perf_counter() - start)


def _flight(case: str, first: float, viewer: Viewer, cameras: Sequence[Camera]) -> Flown:
    ms, stages, new = [], dict[str, float](), 0
    for camera in cameras:
        ms.append(_frame(viewer, camera))
        session = viewer.actions.session
        new += sum(p.new for p in session.progress)
        for stage, took in session.renderers[0].timers.milliseconds().items():
            stages[stage] = stages.get(stage, 0.0) + took / len(cameras)
    return Flown(case, first, np.array(ms), stages, new, viewer.actions.session.progress[0].records)
