"""The free camera (turns, flight, orbit and dolly), and the recorder of its flight."""

from __future__ import annotations

import math

import numpy as np

from irrsplat.core.vectors import unit, vector
from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Camera

PITCH = math.radians(89.0)  # radians: the steepest pitch of a turn, up and down
STALL = 0.25  # seconds: the longest time step that counts, so that the camera does not leap through a wall after a stall
FAR = 1e3  # extents of the scene: the greatest distance from the first camera
NEAR = 1e-3  # extents of the scene: the least distance to a pivot and to the target
STEPS = 200.0  # the most steps of a wheel in one call; more steps would overflow
POLE = 1e-6  # radians from the world's up: nearer to it, a view's own right gives its heading
FPS = 30.0  # frames a second of a path
KEY_EVERY = 0.2  # seconds between the keys of a recorded path


class FreeCamera:
    """A camera that flies, turns and orbits. It always stays valid. Without a motion, `camera` stays one object.

    Lengths are in metres; world space is right-handed. Arguments that are not finite are ignored, and so are moves beyond FAR
    extents from the first camera. A roll stays until the first turn. camera: the present camera, which any other may replace;
    its target lies straight ahead, at the distance of the last pivot. first: the camera to which `home` returns. speed: metres
    per second.
    """

    def __init__(self, camera: Camera, extent: float, up: tuple[float, float, float]) -> None:
        """Start at `camera`.

        extent: the scene's in metres, > 0, which scales the speed. up: the world's up.
        """
        self.camera = self.first = camera
        self.speed = extent / 6.0
        self._extent = extent
        self._up = unit(np.asarray(up, float)[None])[0]

    def move(self, right: float, up: float, ahead: float, seconds: float, pace: float = 1.0) -> None:
        """Fly for `seconds` (at most STALL count) by keys, each -1..1. pace: a factor on the speed.

        right and ahead are directions of the view; up is the world's up. Two keys together are no faster than one.
        """
        axes, keys = self.camera.axes, np.clip([right, up, ahead], -1.0, 1.0)
        way = keys @ np.stack([axes[0], self._up, -axes[2]])
        way = way / max(1.0, float(np.linalg.norm(way)))
        self._stand(self.camera.eye + way * (self.speed * pace * min(max(seconds, 0.0), STALL)))

    def dolly(self, steps: float, pivot: tuple[float, float, float] | None = None) -> None:
        """Move towards `pivot` (None: the target), or away from it if `steps` is negative. Each step leaves 9/10 of the distance.

        The least distance is NEAR extents. n steps towards the pivot and n steps back cancel. The view does not turn.
        """
        about = np.asarray(self.camera.target if pivot is None else pivot, float)
        offset, least = self.camera.eye - about, NEAR * self._extent
        distance = float(np.linalg.norm(offset))
        if steps == 0.0 or (steps > 0.0 and distance <= least):
            return
        out = offset / distance if distance > 0.0 else self.camera.axes[2]
        self._stand(about + out * max(distance * 0.9 ** min(max(steps, -STEPS), STEPS), least), about=about)

    def home(self) -> None:
        self.camera = self.first

    def turn(self, right: float, down: float, pivot: tuple[float, float, float] | None = None) -> None:
        """Turn to the right and down by angles in radians, about the eye or the world point `pivot`.

        The view turns right and left about the world's up. Its pitch ends at ±89°. The view never rolls, and a pivot keeps its
        place on the screen.
        """
        before, about = self.camera.axes, None if pivot is None else np.asarray(pivot, float)
        side = np.cross(self._up, before[2])
        side = unit((side if np.linalg.norm(side) > POLE else before[0])[None])[0]  # the view's right without roll
        behind = np.cross(side, self._up)
        now = math.atan2(-before[2] @ self._up, before[2] @ behind)
        pitch = min(max(now - down, -PITCH), PITCH)
        if not math.isfinite(right + down) or (right == 0.0 and (down == 0.0 or abs(pitch - now) < POLE)):
            return
        level = math.cos(right) * behind - math.sin(right) * side
        back = math.cos(pitch) * level - math.sin(pitch) * self._up
        side = np.cross(self._up, level)
        axes, eye = np.stack([side, np.cross(back, side), back]), np.asarray(self.camera.eye)
        # the pivot keeps its view space position: axes' (about - eye') = axes (about - eye)
        self._stand(eye if about is None else about - (before @ (about - eye)) @ axes, axes, about)

    def _stand(self, eye: np.ndarray, axes: np.ndarray | None = None, about: np.ndarray | None = None) -> None:
        """Put the camera at `eye`, if this place is allowed, with `axes` (None: unchanged). Its target is as far as `about`."""
        camera, up = self.camera, self.camera.up if axes is None else vector(self._up)
        if not np.isfinite(eye).all() or (axes is None and np.array_equal(eye, camera.eye)):
            return
        if math.dist(eye, self.first.eye) > max(FAR * self._extent, math.dist(camera.eye, self.first.eye)):
            return
        back = (camera.axes if axes is None else axes)[2]
        depth = 0.0 if about is None else float(back @ (eye - about))
        reach = depth if depth > 0.0 else math.dist(camera.eye, camera.target)
        # far from the origin, the target must differ from the eye by enough digits to give the view's direction
        reach = max(min(max(reach, NEAR * self._extent), FAR * self._extent), 1e-7 * float(np.abs(eye).max()))
        self.camera = Camera(vector(eye), vector(eye - back * reach), up, camera.fov)


class PathRecorder:
    """The recorder of one path at a time.

    path: the path that was recorded last. recording: the keys of the recording so far, None without a recording.
    """

    def __init__(self) -> None:
        self.path: Path | None = None
        self.recording: list[Camera] | None = None
        self._recorded = 0.0  # the length of the recording in seconds

    def tick(self, dt: float, camera: Camera) -> None:
        """Advance a recording by `dt` seconds with the present `camera`."""
        if self.recording is not None:
            self._recorded += dt
            while self._recorded >= KEY_EVERY * len(self.recording):
                self.recording.append(camera)

    def record(self, camera: Camera) -> Path | None:
        """Begin to record at `camera` and return None, or end the recording and return its path."""
        if self.recording is None:
            self.recording, self._recorded = [camera], 0.0
            return None
        keys, self.recording = self.recording, None
        self.path = Path(tuple(keys), 1 + round((len(keys) - 1) * KEY_EVERY * FPS))
        return self.path
