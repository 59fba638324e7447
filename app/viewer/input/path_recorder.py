"""Records the camera's flight as a path, and plays paths."""

from __future__ import annotations

from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Camera

FPS = 30.0  # frames a second of a path
KEY_EVERY = 0.2  # seconds between the keys of a recorded path


class PathRecorder:
    """The recorder and player of one path at a time.

    path: the path that was recorded or opened last. playing: seconds since its start, None while it does not play. recording: the
    keys of the recording so far, None without a recording.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.playing: float | None = None
        self.recording: list[Camera] | None = None
        self._recorded = 0.0  # the length of the recording in seconds

    @property
    def frame(self) -> float | None:
        """The shown frame of the path while it plays, else None."""
        if self.playing is None or self.path is None:
            return None
        return min(self.playing * FPS, self.path.frames - 1.0)

    @property
    def camera(self) -> Camera | None:
        return None if self.path is None or self.frame is None else self.path.camera(self.frame)

    @property
    def at_rest(self) -> bool:
        return self.playing is None and self.recording is None

    def tick(self, dt: float, camera: Camera) -> Camera | None:
        """Advance by `dt` seconds with the present `camera`. Return the path's last camera when playing ends, else None."""
        if self.recording is not None:
            self._recorded += dt
            while self._recorded >= KEY_EVERY * len(self.recording):
                self.recording.append(camera)
        if self.playing is None or self.path is None:
            return None
        self.playing += dt
        return self.stop() if self.playing * FPS >= self.path.frames else None

    def record(self, camera: Camera) -> Path | None:
        """Begin to record at `camera` and return None, or end the recording and return its path."""
        if self.recording is None:
            self.recording, self._recorded = [camera], 0.0
            return None
        keys, self.recording = self.recording, None
        self.path = Path(tuple(keys), 1 + round((len(keys) - 1) * KEY_EVERY * FPS))
        return self.path

    def play(self) -> None:
        self.playing = None if self.path is None else 0.0

    def stop(self) -> Camera | None:
        """Stop playing. Return the camera where it stopped, None if no path was playing."""
        camera, self.playing = self.camera, None
        return camera
