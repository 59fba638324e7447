"""--turntable: a level circle around the target that closes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.app.film import lost
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


# ---- frames that lose the scene ------------------------------------------------------------------------------------------


def test_frames_behind_walls_are_those_that_are_black() -> None:
    """Of a turn about the Cornell box, whose walls hide it from behind; it has no sky."""
    scene = irrsplat.load("cornell")
    cameras = list(turntable(scene.camera(), scene.up, 12))
    with irrsplat.Renderer(scene, (24, 24), "preview", bounces=0) as renderer:
        black = [not renderer.render(camera, buffers=("image",)).image.any() for camera in cameras]
    assert 4 < sum(black) < 9
    assert lost.lost(scene, cameras, (24, 24)).tolist() == black


@pytest.mark.parametrize(
    ("camera", "expected"),
    [
        (Camera((2.0, 0.8, 1.6), (2.0, 0.8, 5.0)), True),  # within the short block
        (Camera((2.8, 2.7, 12.0), (2.8, 2.7, 30.0)), True),  # away from everything
        (Camera((2.8, 2.7, 12.0), (2.8, 2.7, 0.0)), True),  # behind the wall at the back
        (Camera((2.8, 2.7, 5.5), (2.8, 2.7, 0.0)), False),  # within the room, and out of its open side
    ],
)
def test_a_camera_is_lost(camera: Camera, expected: bool) -> None:
    """Also where all walls are turned round; where one sees through them from behind, none is in the way."""
    scene = irrsplat.load("cornell")
    turned = tuple(replace(mesh, faces=mesh.faces[:, ::-1].copy()) for mesh in scene.meshes)
    for one in (scene, replace(scene, meshes=turned)):
        assert lost.lost(one, [camera], (32, 24)).tolist() == [expected]
    clear = tuple(replace(mesh, material=replace(mesh.material, double_sided=False)) for mesh in scene.meshes)
    assert lost.lost(replace(scene, meshes=clear), [camera], (32, 24)).tolist() == [camera.target[2] == 30.0]


def test_lost_frames_are_told_once_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    fast = ["--size", "16", "12", "--bounces", "0", "--preset", "preview", "-o", "f{frame}.png"]
    assert cli.main(["render", "cornell", "--turntable", "4", *fast]) == 0
    said = capsys.readouterr().err
    assert said.count("notice:") == 1
    assert "notice: 3 of 4 frames see nothing of the scene, or only backs of its surfaces, the first of them frame 1" in said
    assert "give --eye and --target nearer to one another" in said
    (tmp_path / "a.path").write_text("frames 3\ncam 2.8 2.7 -5 2.8 2.7 0 0 1 0\ncam 2.8 2.7 12 2.8 2.7 30 0 1 0\n")
    assert cli.main(["render", "cornell", "--path", "a.path", "--frames", "0:1", *fast]) == 0
    assert capsys.readouterr().err == ""
    assert cli.main(["render", "cornell", "--path", "a.path", *fast]) == 0
    assert "of 3 frames see nothing of the scene" in (said := capsys.readouterr().err) and "move those keys of the path" in said
