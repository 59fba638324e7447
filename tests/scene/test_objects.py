"""Odd scenes of arrays, losses of the .scene format, and edge cases of meshes and lights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.core.errors import InputError
from irrsplat.scene import load
from irrsplat.scene.appearance import runs
from irrsplat.scene.change import emits
from irrsplat.scene.image_means import sums_of_four
from irrsplat.scene.io.text.scene_writer import write_scene
from irrsplat.scene.model import Image, Light, Scene, Texture
from irrsplat.scene.motion import posed
from irrsplat.scene.ray_caster import RayCaster
from tests.support.gltf_files import FACES, POINTS
from tests.support.luminaires import ies_text, isotropic
from tests.support.worlds import box, floor, point_light, scene

pytestmark = pytest.mark.usefixtures("without_stand_ins")

SUN = Light((0, 1, 0), (1, 1, 1), directional=True)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: irrsplat.make_scene(floor(), sky=np.full((2, 4, 3), -1.0)), "a sky's radiance is from 0 to"),
        (lambda: irrsplat.make_scene(floor(), sky=[["x"]]), "a sky is a radiance"),
        (lambda: irrsplat.make_scene(floor(), sky="1 2"), "sky"),
        (lambda: irrsplat.make_mesh([["x"]], FACES), r"an array \(N, 3\) of numbers"),
        (lambda: irrsplat.make_mesh(POINTS, [[0, 1, 2], [0]]), "whole numbers"),
        (lambda: irrsplat.make_mesh(POINTS, FACES, colors=np.full((4, 3), 128, np.uint8)), "linear reflectance from 0 to 1"),
        (lambda: irrsplat.make_mesh(POINTS, FACES, transform=np.diag([1.0, 1.0, 1.0, 2.0])), "the last row of a transform"),
        (lambda: irrsplat.make_scene(None), "meshes are a sequence of Mesh"),  # type: ignore[arg-type]
        (lambda: irrsplat.make_scene(floor(), SUN), "lights are a sequence of Light, not one Light"),  # type: ignore[arg-type]
        (lambda: Image(np.zeros((2, 2, 3), np.uint8)), r"an image's pixels are an array \(H, W, 4\) of uint8"),
        (lambda: Texture(np.zeros((2, 2, 4))), "a texture.s image is an Image, not ndarray; make one by"),  # type: ignore[arg-type]
        (lambda: posed(scene(floor()), scene(floor(), floor())), "a pose has the same meshes as the renderer's scene"),
    ],
)
def test_invalid_arguments_are_one_line(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        call()
    assert "\n" not in str(raised.value)


def test_a_large_map_of_a_sky_is_halved_and_emits_in_every_channel() -> None:
    """4096 rows become 2048, each the mean of two; a map emits in every channel."""
    sky = np.zeros((4096, 2, 3), np.float32)
    sky[::2] = [2.0, 0.0, 0.0]
    made = irrsplat.make_scene(floor(), sky=sky)
    assert made.environment is not None and made.environment.shown.shape == (2048, 1, 3)
    assert (made.environment.shown[..., 0] == 1.0).all() and emits(made).all()
    assert irrsplat.make_scene(floor(), sky="0 2 0").sky == (0.0, 2.0, 0.0)


@pytest.mark.parametrize("transform", [False, True])
def test_arrays_far_away_keep_their_precision(transform: bool) -> None:
    """At 5e6 m, float32 numbers are 0.5 m apart. The sides of this triangle, 3 to 5 cm, are correct to 1e-8 m."""
    place, corners = np.array([4.5e5, 5.3e6, 120.3]), np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.0, 0.03, 0.0]])
    move = np.column_stack([np.eye(3), place]) if transform else None
    mesh = irrsplat.make_mesh(corners if transform else corners + place, [[0, 1, 2]], transform=move)
    (placed,) = irrsplat.make_scene(mesh).meshes
    sides = np.linalg.norm(np.diff(placed.positions, axis=0, append=placed.positions[:1]), axis=1)
    assert placed.positions.dtype == np.float32 and sides == pytest.approx([0.04, 0.05, 0.03], abs=1e-8)


def test_a_sky_that_stands_in_is_not_written_and_a_map_by_its_mean(tmp_path: Path) -> None:
    """The reader adds the same stand-in; a map without a file is lost."""
    assert write_scene(replace(scene(floor(), sky=1.0), own_sky=False), tmp_path / "a.scene") == ""
    assert "\nsky " not in (tmp_path / "a.scene").read_text() and load(tmp_path / "a.scene").sky == (1.0, 1.0, 1.0)
    mapped = irrsplat.make_scene(floor(), sky=np.ones((8, 16, 3)) * [1.0, 2.0, 3.0])
    assert "a .scene does not hold the sky's map (its mean replaces it" in write_scene(mapped, tmp_path / "b.scene")
    assert load(tmp_path / "b.scene").sky == pytest.approx((1.0, 2.0, 3.0))


def test_a_luminaire_is_written_with_its_tilt_file(write: Callable[..., Scene], tmp_path: Path) -> None:
    """Read again it has the same flux, mirrored or not; a light without photometry has none."""
    light = "ies b.ies\nposition 0 3 0 1\nspotDirection 0 0 0\nintensity 2 2 2\n"
    text = "obj t.obj\ncam 0 0 5  0 0 0  0 1 0\nlight a.light\nscale -1 1 1\nlight b.ies\n"
    made = write(text, a_light=light, b_ies=ies_text([0, 90], [0, 90, 180], isotropic, tilt="TILT=t.tlt"), t_tlt="1 2 0 90 1 0.8")
    assert write_scene(made, tmp_path / "c.scene") == "c.scene: a .scene does not hold mirrored luminaires (1)"
    again = load(tmp_path / "c.scene")
    assert [one.output for one in again.lights] == [pytest.approx(one.output) for one in made.lights]
    assert made.lights[0].output[1] == pytest.approx(200.0) and point_light((0, 0, 0)).output == (0.0, 0.0)
    assert sorted(file.name for file in (tmp_path / "c-files").glob("*.tlt")) == ["t.tlt"]


def test_empty_geometry() -> None:
    """A caster of no triangles, a mesh without faces, the odd row of an image, a shifted sun."""
    pytest.importorskip("embreex")
    caster, axes = RayCaster(np.zeros((0, 3), np.float32), np.zeros((0, 3), int)), np.eye(3)[None]
    assert caster.first_hits(np.zeros((1, 3)), axes, np.eye(3)).tolist() == [[-1] * 3]
    assert caster.free(np.zeros((2, 3)), np.ones((2, 3))).tolist() == [True, True]
    full = box((0, 0, 0), (1, 1, 1))
    assert [run.count for run in runs(scene(replace(full, faces=full.faces[:0]), full))] == [12]
    assert sums_of_four(np.ones((3, 1, 1)))[..., 0].tolist() == [[4.0], [4.0]]
    assert SUN.shifted((1, 2, 3)) is SUN
