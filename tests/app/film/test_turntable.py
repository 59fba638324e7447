"""--turntable: a level circle around the target that closes."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.app.film.turntable import turntable
from irrsplat.scene.model import Camera


@pytest.mark.parametrize(
    ("camera", "up"),
    [
        (Camera((3, 4, 0), (0, 1, 0), (0, 1, 0), 40.0), (0, 2, 0)),
        (Camera((5, 1, 1), (1, 2, 1), (0.1, 0.9, 0.3), 40.0), (0, 0, 1)),  # tilted, in a scene of another up
        (Camera((0, 7, 0), (0, 1, 0), (0, 0, -1), 40.0), (0, 1, 0)),  # from straight above: about its own up
    ],
)
def test_every_frame_sees_the_target_from_the_same_distance(camera: Camera, up: tuple[float, float, float]) -> None:
    """Steps are all alike, also the one from the last frame to the first, so that no seam shows."""
    path = turntable(camera, up, 12)
    cameras = list(path)
    assert path.frames == len(cameras) == 12 and cameras[0] == camera
    eyes, target = np.array([c.eye for c in cameras]), np.array(camera.target)
    assert all(c.target == camera.target and c.fov == camera.fov for c in cameras)
    assert np.linalg.norm(eyes - target, axis=1) == pytest.approx(np.linalg.norm(eyes[0] - target), rel=1e-12)
    steps = np.linalg.norm(np.roll(eyes, -1, 0) - eyes, axis=1)
    assert steps == pytest.approx(np.full(12, steps[0]), rel=1e-9) and steps[0] > 0.1
    assert eyes.mean(0) - target == pytest.approx(np.mean([eyes[0], eyes[6]], 0) - target, abs=1e-9)  # the circle's centre
    axis = np.asarray(camera.up if camera.eye[0] == 0 else up, float)
    heights = (eyes - target) @ axis
    assert heights == pytest.approx(np.full(12, heights[0]), abs=1e-9)
    tilts = [c.axes[0] @ axis for c in cameras]  # roll is kept as well
    assert tilts == pytest.approx([tilts[0]] * 12, abs=1e-9)
