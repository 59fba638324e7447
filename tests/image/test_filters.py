"""Filters: surfaces that let most light pass tint the picture of what is behind them, and are in no buffer but `opacity`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import irrsplat
from irrsplat.core.color import linear_from_srgb
from irrsplat.scene.model import Camera, Image, Material, Mesh, Texture
from tests.image.test_textures import HEAD_ON, square
from tests.support.worlds import material, scene

SIZE = (12, 12)
RED, BLUE = (0.9, 0.2, 0.1), (0.1, 0.3, 0.8)
WALL = square(material(0.5, (2.0, 3.0, 4.0)), z=-0.5, half=3.0)
EMISSIVE = np.array((2.0, 3.0, 4.0))


def shown(*meshes: Mesh, camera: Camera = HEAD_ON, **settings: object) -> irrsplat.Frame:
    """A picture without indirect light."""
    return irrsplat.render(scene(*meshes, camera=camera), SIZE, bounces=0, **settings)  # type: ignore[arg-type]


def glass(albedo: tuple[float, float, float], opacity: float = 0.3, z: float = 0.0, **rest: object) -> Mesh:
    """A pane across the view."""
    return square(Material(albedo=albedo, opacity=opacity, alpha_mode="blend", **rest), z=z)  # type: ignore[arg-type]


def left(albedo: tuple[float, float, float], opacity: float = 0.3) -> np.ndarray:
    """(3,) the share of what is behind that a pane leaves."""
    return 1.0 - opacity * (1.0 - np.asarray(albedo))


@pytest.mark.parametrize("nearer", [RED, BLUE])
def test_two_panes_leave_the_product_of_what_each_leaves(nearer: tuple[float, float, float]) -> None:
    """1 - opacity·(1 - albedo) each, in any order; the wall's own buffers are the wall's, and the opacity the nearer one's."""
    farther = BLUE if nearer == RED else RED
    plain = shown(WALL)
    frame = shown(WALL, glass(nearer, 0.4, 0.2), glass(farther, 0.3, 0.1))
    assert np.allclose(frame.image, EMISSIVE * left(nearer, 0.4) * left(farther, 0.3), rtol=1e-5)
    assert np.allclose(frame.opacity, 0.4)
    for name in ("emission", "albedo", "depth", "normal", "position", "direct", "alpha"):
        assert np.array_equal(getattr(frame, name), getattr(plain, name)), name


@pytest.mark.parametrize(("opacity", "transmission", "mode", "solid"), [
    (0.49, 0.0, "blend", False), (0.51, 0.0, "blend", True), (0.9, 0.4, "blend", True), (0.8, 0.4, "blend", False),
    (0.2, 0.6, "opaque", False), (0.2, 0.4, "opaque", True),
])  # fmt: skip
def test_what_holds_back_half_of_the_light_is_a_surface(opacity: float, transmission: float, mode: str, solid: bool) -> None:
    """A filter has opacity·(1 - transmission) below 1/2; opaque materials are filters by transmission alone."""
    paint = Material(albedo=RED, opacity=opacity, transmission=transmission, alpha_mode=mode)  # type: ignore[arg-type]
    frame = shown(WALL, square(paint))
    if solid:
        assert np.allclose(frame.albedo, RED) and np.allclose(frame.image, 0.0) and np.allclose(frame.opacity, 1.0)
    else:
        held = opacity if mode == "blend" else 1.0
        assert np.allclose(frame.image, EMISSIVE * left(RED, held), rtol=1e-5) and np.allclose(frame.opacity, held)


def test_an_image_decides_from_place_to_place() -> None:
    """Alpha 1 is a surface, 0.3 a filter of its own colour, 0 nothing: three columns."""
    texels = np.array([[[200, 50, 20, 255], [200, 50, 20, 77], [200, 50, 20, 0]]], "u1")
    paint = Material(albedo=(1.0, 1.0, 1.0), albedo_texture=Texture(Image(texels), nearest=True), alpha_mode="blend")
    frame = shown(WALL, square(paint))
    colour = linear_from_srgb(texels[0, 0, :3] / 255.0)
    for columns, radiance, opacity in (
        (slice(0, 4), 0.0 * EMISSIVE, 1.0),
        (slice(4, 8), EMISSIVE * (1.0 - 77 / 255 * (1.0 - colour)), 77 / 255),
        (slice(8, 12), EMISSIVE, 1.0),
    ):
        assert np.allclose(frame.image[:, columns], radiance, rtol=0.01)
        assert np.allclose(frame.opacity[:, columns], opacity, rtol=0.01)


def test_the_sky_is_tinted_in_the_picture_alone() -> None:
    """A pane without a surface behind it shows the sky; its own radiance stays in the buffer of emission."""
    world = scene(glass(RED, 0.3), sky=(2.0, 3.0, 4.0), camera=HEAD_ON)
    frame = irrsplat.render(world, SIZE, bounces=0, backdrop="sky")
    assert np.allclose(frame.image, EMISSIVE * left(RED), rtol=1e-5) and np.allclose(frame.emission, EMISSIVE)
    assert np.isinf(frame.depth).all() and np.allclose(frame.opacity, 0.3)
    clear = irrsplat.render(world, SIZE, bounces=0, backdrop="clear")
    rest = left(RED) - left(RED).min()
    assert np.allclose(clear.image, EMISSIVE * rest, rtol=1e-5) and np.allclose(clear.alpha, 1.0 - left(RED).min(), atol=1e-6)


def test_what_a_pane_emits_is_added() -> None:
    """opacity·emission, on top of what it leaves of the wall; through a nearer pane it is not tinted."""
    frame = shown(WALL, glass(RED, 0.4, 0.1, emission=(1.0, 0.5, 0.25)), glass(BLUE, 0.3, 0.2))
    requested = EMISSIVE * left(RED, 0.4) * left(BLUE) + 0.4 * np.array((1.0, 0.5, 0.25))
    assert np.allclose(frame.image, requested, rtol=1e-5) and np.allclose(frame.emission, EMISSIVE)


def test_samples_are_tinted_one_by_one() -> None:
    """Half of each pixel in the middle column is behind the pane, as far as samples tell."""
    pane = replace(glass(RED), positions=glass(RED).positions - np.array([1.0 + 1 / 12, 0, 0], "f4"))
    frame = shown(WALL, pane, samples=64)
    middle = EMISSIVE * (1.0 + left(RED)) / 2.0
    assert np.allclose(frame.image[:, :5], EMISSIVE * left(RED), rtol=1e-5) and np.allclose(
        frame.image[:, 6:], EMISSIVE, rtol=1e-5
    )
    assert np.abs(frame.image[:, 5] / middle - 1.0).max() < 0.05
