"""Backdrops: which of them are light, and how pictures are composited over them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat.core.color import LUMINANCE
from irrsplat.image.backdrop import display_picture
from irrsplat.image.tonemap import exposure_of, tonemap
from irrsplat.scene.model import Camera, Scene
from tests.support.worlds import floor, material, point_light, rays, scene

SIZE = (24, 20)
SIDE = Camera((0.3, 1.5, 2.0), (0.0, 0.3, 0.0), (0.1, 1.0, 0.0), 50.0)


def world(own: bool) -> Scene:
    """A room under a sky that is brighter above, with a light."""
    made = scene(floor(1.0, paint=material(0.9)), lights=(point_light((0, 2, 0), 3.0),), sky=(0.2, 0.5, 0.8), camera=SIDE)
    return replace(made, sky_gradient=(0.1, 0.2, 0.3), up=(0.0, 0.6, 0.8), own_sky=own)


def rendered(scene: Scene, **settings: Any) -> irrsplat.Frame:
    return irrsplat.render(scene, SIZE, bounces=1, gather_size=8, shadow_size=64, **settings)


def test_the_sky_behind_is_as_bright_as_its_direction_says() -> None:
    it = world(own=True)
    frame = rendered(it)
    unseen = frame.alpha == 0.0
    assert 0.3 < unseen.mean() < 0.95
    ways = rays(SIDE, SIZE)
    expected = it.sky_radiance(ways / np.linalg.norm(ways, axis=-1, keepdims=True))
    assert np.ptp(expected[..., 2]) > 0.05
    for buffer in (frame.image, frame.emission):
        assert np.allclose(buffer[unseen], expected[unseen], atol=1e-6)
    assert frame.backdrop == "sky" and np.array_equal(frame.alpha, np.isfinite(frame.depth))


@pytest.mark.parametrize("kind", ["auto", "grey", "black", "white", "clear"])
def test_a_backdrop_is_no_light(kind: str) -> None:
    """No buffer holds the backdrop; the sky still lights the scene, and exposure uses visible surfaces only."""
    it = world(own=False)
    frame, lit = rendered(it, backdrop=kind), rendered(it, backdrop="sky")
    unseen = frame.alpha == 0.0
    assert not frame.image[unseen].any() and not frame.emission[unseen].any()
    assert np.array_equal(frame.image[~unseen], lit.image[~unseen]) and np.array_equal(frame.irradiance, lit.irradiance)
    assert frame.exposure == pytest.approx(exposure_of(frame.image[~unseen], frame.albedo[~unseen] @ LUMINANCE), abs=0.01)
    assert frame.backdrop == ("grey" if kind == "auto" else kind)
    picture = frame.picture
    assert picture.shape[2] == (4 if kind == "clear" else 3)
    assert np.allclose(picture[~unseen][:, :3], tonemap(frame.image[~unseen], frame.exposure))
    if kind == "clear":
        assert (picture[..., 3] == frame.alpha).all()
    elif kind in ("auto", "grey"):  # between a dark and a white thing, and the same at every exposure
        assert 0.15 < picture[unseen].min() < picture[unseen].max() < 0.5
        brighter = replace(frame, stats={"exposure": frame.exposure + 5.0}).picture
        assert np.array_equal(picture[unseen], brighter[unseen])
    else:
        assert (picture[unseen] == float(kind == "white")).all()


def test_a_pixel_that_is_covered_in_part_is_a_mixture() -> None:
    """A pixel mixes the exposed radiance of its covered part with the backdrop."""
    radiance, alpha = np.full((2, 1, 3), 0.05), np.array([[0.25], [1.0]])
    made = display_picture(radiance, 1.0, alpha, "white")
    assert np.allclose(made[0, 0], 0.25 * tonemap(np.full(3, 0.2), 1.0) + 0.75)
    assert np.allclose(made[1, 0], tonemap(np.full(3, 0.05), 1.0))
    assert np.array_equal(display_picture(radiance, 1.0, alpha, "sky"), tonemap(radiance, 1.0))


def test_clear_pictures_have_alpha_in_their_files(tmp_path: Path) -> None:
    import OpenEXR

    frame = rendered(world(own=False), backdrop="clear", samples=4)
    frame.save(tmp_path / "a.png")
    frame.save(tmp_path / "a.exr")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.mode == "RGBA"
        assert np.array_equal(np.asarray(picture)[..., 3], np.round(255 * frame.alpha))
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        for name in ("image.A", "alpha"):
            assert np.array_equal(file.channels()[name].pixels, frame.alpha)
