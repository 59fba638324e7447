"""Records the camera's flight as a path."""

from __future__ import annotations

from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Camera

FPS = 30.0  # frames a second of a path
KEY_EVERY = 0.2  # seconds between the keys of a recorded path


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
