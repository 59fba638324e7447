"""Light of environments on surfaces, by rays, rasters and bounces, and their picture: closed forms and sums over spheres."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.color import LUMINOUS_EFFICACY, photometric
from irrsplat.scene.model import Camera
from irrsplat.sky.cie import CieSky
from irrsplat.sky.sphere import solid_angles, texel_directions
from tests.support.skies import cie, irradiance, mapped, without_lights
from tests.support.worlds import ABOVE, Lit, floor, gather, material, quad, rays, scene, sites

UP = np.array([0.0, 1.0, 0.0])
KINDS = ("trace", "embree")
SIDE = Camera((0.3, 1.5, 2.0), (0.0, 0.3, 0.0), (0.1, 1.0, 0.0), 50.0)
TILTS = np.array([(0, 1, 0), (1, 0, 0), (0, 0, -1), (-0.6, 0.0, 0.8), (0.48, 0.6, 0.64), (0, -1, 0)], float)


@pytest.mark.parametrize("kind", KINDS)
def test_an_overcast_sky(ctx: moderngl.Context, kind: str) -> None:
    """Moon and Spencer's overcast sky above black ground.

    Horizontal plane: ∫ L_z·(1 + 2·sin)/3 over the hemisphere is 7/9·π·L_z. A vertical plane sees half of the sky: a third
    of L_z·π/2, and two thirds of ∫ (n·ω)(up·ω) dω = 2/3, together π/6 + 4/9. From below: 0.
    """
    sky = CieSky("overcast", 30.0, ground=0.0)
    L = sky.zenith_luminance / LUMINOUS_EFFICACY
    world = cie(scene(floor(1.0, -1.0, material(0.0))), sky)
    normals = np.array([(0, 1, 0), (1, 0, 0), (0, 0, -1), (-1, 0, 0)], float)
    E = gather(ctx, world, sites(np.zeros((4, 3)), normals), 64, kind).E
    assert E[0] == pytest.approx([7.0 / 9.0 * np.pi * L] * 3, rel=0.01)
    assert E[1:] == pytest.approx(np.full((3, 3), (np.pi / 6.0 + 4.0 / 9.0) * L), rel=0.01)
    assert gather(ctx, world, sites((0.0, 0.0, 0.0), -UP), 64, kind).E.max() < 0.005 * L


@pytest.mark.parametrize(("kind", "turn"), [("embree", 70.0), ("trace", 0.0), ("trace", 70.0)])
def test_a_map_lights_from_where_it_is_bright(ctx: moderngl.Context, kind: str, turn: float) -> None:
    """A red quarter of the sky to the east and a blue one below the horizon to the north-west: six planes match the map's sum.

    The planes rotate clockwise with the map. Without rotation, the wall towards east gets most of the red.
    """
    radiance = np.full((64, 128, 3), 0.1, "f4")
    ways = texel_directions(64, 128)
    radiance[(ways[..., 0] > abs(ways[..., 2])) & (ways[..., 1] > 0.0), 0] = 5.0
    radiance[(ways[..., 0] < -0.5) & (ways[..., 2] < 0.0) & (ways[..., 1] < 0.0), 2] = 5.0
    world = mapped(scene(), radiance, turn)
    assert world.lights == ()
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = np.stack([c * TILTS[:, 0] - s * TILTS[:, 2], TILTS[:, 1], s * TILTS[:, 0] + c * TILTS[:, 2]], axis=-1)
    E = gather(ctx, world, sites(np.zeros((6, 3)), turned), 64, kind).E
    expected = irradiance(radiance, TILTS)
    assert np.allclose(E, expected, rtol=0.01, atol=0.02)
    assert expected[1, 0] > 3.0 * expected[3, 0], "the wall that faces east, and one that faces west"


@pytest.mark.parametrize("tilt", [25.0, 60.0])
def test_the_sun_of_a_single_texel_falls_on_tilted_planes(tilt: float) -> None:
    """E = L·Ω·cosθ, with the texel's Ω: a directly lit plane of reflectance ρ has radiance ρ/π of that, and 0 on its back."""
    radiance = np.zeros((64, 128, 3), "f4")
    radiance[20, 90] = L = (2000.0, 1000.0, 500.0)
    toward = texel_directions(64, 128)[20, 90]
    a = np.radians(tilt)
    u, v = np.array([np.cos(a), np.sin(a), 0.0]), np.array([0.0, 0.0, -1.0])
    plane = quad(-2.0 * (u + v), 4.0 * u, 4.0 * v, material(0.6))
    frame = irrsplat.render(mapped(scene(plane, camera=ABOVE), radiance), (8, 8), bounces=0, shadow_size=64)
    E = np.array(L) * solid_angles(64, 128)[20] * max(np.cross(u, v) @ toward, 0.0)
    assert (E > 0.0).all() == (tilt < 60.0)
    seen = frame.alpha == 1.0
    assert seen.mean() > 0.7 and np.allclose(frame.direct[seen], 0.6 / np.pi * E, rtol=1e-3)


def daylight(sky: CieSky, p: np.ndarray, low: tuple[float, float, float], high: tuple[float, float, float]) -> float:
    """Return lux at p, facing up, through an upright window x = const in a black wall, as a sum over 60² points."""
    y, z = (lo + (hi - lo) * (np.arange(60) + 0.5) / 60 for lo, hi in zip(low[1:], high[1:], strict=True))
    toward = np.stack(np.broadcast_arrays(low[0] - p[0], (y - p[1])[:, None], (z - p[2])[None, :]), axis=-1)
    r = np.linalg.norm(toward, axis=-1)
    way = toward / r[..., None]
    area = (high[1] - low[1]) * (high[2] - low[2]) / 60**2
    return float((sky.relative(way) * way[..., 1] * abs(way[..., 0]) / r**2).sum() * area * sky.zenith_luminance)


def test_the_daylight_factor_of_a_black_room(ctx: moderngl.Context) -> None:
    """A window of 2 × 1.5 m in a black room, at two distances: the mean of 128 records matches the window's sum to 1 %.

    The window's rim cuts strata, which count completely or not at all: 5 % of the light at the back of the room. The
    records are slightly apart, so that the rim cuts them differently.
    """
    sky = CieSky("clear", 30.0, 200.0, ground=0.0)
    black = material(0.0)
    walls = [
        quad((0, 0, 0), (4, 0, 0), (0, 0, -6), black),
        quad((0, 3, 0), (0, 0, -6), (4, 0, 0), black),
        quad((0, 0, 0), (0, 0, -6), (0, 3, 0), black),
        quad((0, 0, -6), (4, 0, 0), (0, 3, 0), black),
        quad((0, 0, 0), (0, 3, 0), (4, 0, 0), black),
        quad((4, 0, 0), (0, 0.9, 0), (0, 0, -6), black),
        quad((4, 2.4, 0), (0, 0.6, 0), (0, 0, -6), black),
        quad((4, 0.9, 0), (0, 1.5, 0), (0, 0, -2), black),
        quad((4, 0.9, -4), (0, 1.5, 0), (0, 0, -2), black),
    ]
    apart = np.random.default_rng(1).uniform(-0.15, 0.15, (128, 3))
    with Lit(ctx, without_lights(cie(scene(*walls), sky))) as lit:
        for place in ((3.0, 0.2, -3.0), (1.0, 0.2, -2.5)):
            share = photometric(lit.gather(sites(place + apart, UP), 64, "trace").E)
            share /= [daylight(sky, p, (4.0, 0.9, -4.0), (4.0, 2.4, -2.0)) for p in place + apart]
            assert share.mean() == pytest.approx(1.0, abs=0.01)
            assert share.std() < 0.01


def test_the_paper_s_records_see_it() -> None:
    """Records summed on the CPU match too, within the field of view of their single plane."""
    sky = CieSky("overcast", 40.0)
    frame = irrsplat.render(cie(scene(floor(1.0), camera=ABOVE), sky), (8, 8), preset="paper")
    expected = 7.0 / 9.0 * np.pi * sky.zenith_luminance / LUMINOUS_EFFICACY
    assert np.median(frame.irradiance[frame.alpha == 1.0]) == pytest.approx(expected, rel=0.06)


def test_the_picture_shows_the_map_behind(software: bool) -> None:
    """The background equals the map in the pixel's direction, approximately for four samples, whose mean is 0.1 pixels off
    centre.
    """
    ways, size = texel_directions(128, 256), (60, 50)
    world = mapped(scene(floor(1.0), camera=SIDE), (2.0 + ways + np.sin(5.0 * ways[..., ::-1])).astype("f4"), 30.0)
    seen = rays(SIDE, size)
    behind = world.sky_radiance(seen / np.linalg.norm(seen, axis=-1, keepdims=True))
    for samples, limit in ((1, 2e-4 if software else 4.0 / 256.0), (4, 0.02)):
        frame = irrsplat.render(world, size, bounces=0, samples=samples)
        unseen = frame.alpha == 0.0
        assert 0.3 < unseen.mean() < 0.95
        for buffer in (frame.image, frame.emission):
            assert np.allclose(buffer[unseen], behind[unseen], atol=limit)
