"""What environments bring to surfaces, by rays, rasters and bounces, and the picture of them: closed forms, sums over spheres."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.scene.model import Camera, Scene
from irrsplat.sky.cie import CieKind, CieSky
from irrsplat.sky.sphere import solid_angles, texel_directions
from tests.support.skies import cie, irradiance, mapped, without_lights
from tests.support.worlds import ABOVE, Lit, floor, gather, material, quad, rays, scene, sites

UP = np.array([0.0, 1.0, 0.0])
KINDS = ("raster", "trace")
SIDE = Camera((0.3, 1.5, 2.0), (0.0, 0.3, 0.0), (0.1, 1.0, 0.0), 50.0)
TILTS = np.array([(0, 1, 0), (1, 0, 0), (0, 0, -1), (-0.6, 0.0, 0.8), (0.48, 0.6, 0.64), (0, -1, 0)], float)


@pytest.mark.parametrize("kind", KINDS)
def test_a_uniform_map_is_a_uniform_sky(ctx: moderngl.Context, kind: str) -> None:
    """E = π·L on any plane, whatever way it faces: to float precision by rays."""
    L = np.array([1.0, 2.0, 3.0])
    world = mapped(scene(), np.broadcast_to(L, (32, 64, 3)))
    E = gather(ctx, world, sites(np.zeros((6, 3)), TILTS), 32, kind).E
    assert np.allclose(E, np.pi * L, rtol=2e-3 if kind == "raster" else 1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_an_overcast_sky(ctx: moderngl.Context, kind: str) -> None:
    """Moon and Spencer's, before black ground. A horizontal plane: ∫ L_z·(1 + 2·sin)/3 over the hemisphere is 7/9·π·L_z. A
    vertical one sees half of it: a third of L_z·π/2, and two thirds of ∫ (n·ω)(up·ω) dω = 2/3, together π/6 + 4/9. From below:
    nothing."""
    sky = CieSky("overcast", 30.0, ground=0.0)
    L = sky.zenith_luminance / LUMINOUS_EFFICACY
    world = cie(scene(floor(1.0, -1.0, material(0.0))), sky)
    normals = np.array([(0, 1, 0), (1, 0, 0), (0, 0, -1), (-1, 0, 0)], float)
    E = gather(ctx, world, sites(np.zeros((4, 3)), normals), 64, kind).E
    assert E[0] == pytest.approx([7.0 / 9.0 * np.pi * L] * 3, rel=0.01)
    assert E[1:] == pytest.approx(np.full((3, 3), (np.pi / 6.0 + 4.0 / 9.0) * L), rel=0.01)
    assert gather(ctx, world, sites((0.0, 0.0, 0.0), -UP), 64, kind).E.max() < 0.005 * L


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("turn", [0.0, 70.0])
def test_a_map_lights_from_where_it_is_bright(ctx: moderngl.Context, kind: str, turn: float) -> None:
    """A quarter of the sky to the east is red, one below the horizon to the north-west blue; six planes against the map's own
    sum, turned clockwise with it. Without a turn, the wall that faces east gets most of the red."""
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


@pytest.mark.parametrize("kind", KINDS)
def test_a_clear_sky_and_its_ground(ctx: moderngl.Context, kind: str) -> None:
    """Brightest about the sun: six planes against the map's sum."""
    sky = CieSky("clear", 35.0, 120.0)
    E = gather(ctx, without_lights(cie(scene(), sky)), sites(np.zeros((6, 3)), TILTS), 64, kind).E
    assert np.allclose(E, irradiance(sky.environment("").light, TILTS), rtol=0.01)


@pytest.mark.parametrize("tilt", [0.0, 25.0, 60.0, -40.0])
def test_the_sun_of_a_single_texel_falls_on_tilted_planes(tilt: float) -> None:
    """E = L·Ω·cosθ, Ω of the texel: the radiance of a plane of reflectance ρ, lit directly, is ρ/π of that; where it faces away,
    there is none."""
    radiance = np.zeros((64, 128, 3), "f4")
    radiance[20, 90] = L = (2000.0, 1000.0, 500.0)
    toward = texel_directions(64, 128)[20, 90]
    a = np.radians(tilt)
    u, v = np.array([np.cos(a), np.sin(a), 0.0]), np.array([0.0, 0.0, -1.0])
    plane = quad(-2.0 * (u + v), 4.0 * u, 4.0 * v, material(0.6))
    world = mapped(scene(plane, camera=ABOVE), radiance)
    frame = irrsplat.render(world, (8, 8), bounces=0, shadow_size=64)
    E = np.array(L) * solid_angles(64, 128)[20] * max(np.cross(u, v) @ toward, 0.0)
    assert (E > 0.0).all() == (tilt < 60.0)
    seen = frame.alpha == 1.0
    assert seen.mean() > 0.7 and np.allclose(frame.direct[seen], 0.6 / np.pi * E, rtol=1e-3)


def daylight(sky: CieSky, p: np.ndarray, low: tuple[float, float, float], high: tuple[float, float, float]) -> float:
    """E at p, facing up, through an upright window x = const in a black wall, by a sum over 200² points of it."""
    y, z = (lo + (hi - lo) * (np.arange(200) + 0.5) / 200 for lo, hi in zip(low[1:], high[1:], strict=True))
    toward = np.stack(np.broadcast_arrays(low[0] - p[0], (y - p[1])[:, None], (z - p[2])[None, :]), axis=-1)
    r = np.linalg.norm(toward, axis=-1)
    way = toward / r[..., None]
    area = (high[1] - low[1]) * (high[2] - low[2]) / 200**2
    return float(
        (sky.relative(way) * way[..., 1] * abs(way[..., 0]) / r**2).sum() * area * sky.zenith_luminance / LUMINOUS_EFFICACY
    )


@pytest.mark.parametrize("gathering", KINDS)
@pytest.mark.parametrize("kind", ["overcast", "clear"])
def test_the_daylight_factor_of_a_black_room(ctx: moderngl.Context, kind: CieKind, gathering: str) -> None:
    """A window of 2 × 1.5 m in the wall of a black room, at three distances from it: the mean of 128 records, each against the
    window's own sum, within 1 %. Its rim cuts strata, which count whole or not at all, 5 % of the light at the back of the room;
    the records are a little apart, so that it cuts them differently."""
    sky = CieSky(kind, 30.0, 200.0, ground=0.0)
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
        for place in ((3.0, 0.2, -3.0), (2.0, 0.2, -3.0), (1.0, 0.2, -2.5)):
            share = lit.gather(sites(place + apart, UP), 64, gathering).E[:, 0]
            share /= [daylight(sky, p, (4.0, 0.9, -4.0), (4.0, 2.4, -2.0)) for p in place + apart]
            assert share.mean() == pytest.approx(1.0, abs=0.01)
            assert share.std() < 0.05


def test_a_sun_is_no_noise(ctx: moderngl.Context) -> None:
    """A sun that brings as much as the sky: it is not in what rays see, and records that differ by their turn alone agree within
    half a percent, where two strips hide half of the sky at random."""
    sky = np.ones((256, 512, 3), "f4")
    sky[texel_directions(256, 512) @ np.array([0.48, 0.6, 0.64]) > np.cos(np.radians(0.5))] = 4.0 / 7.6e-5
    world = mapped(scene(), sky)
    assert len(world.lights) == 1 and np.linalg.norm(world.lights[0].color) > 1.0
    E = gather(ctx, world, sites(np.zeros((64, 3)), UP), 64, "trace").E
    assert np.allclose(E, np.pi, rtol=5e-3)


def test_a_sky_of_many_colours_is_smooth_to_few_rays(ctx: moderngl.Context) -> None:
    """Of 16² rays each stands for what lies around it: noise of one texel in the map is gone, 64 turned records agree within 1 %;
    a single lookup a ray would leave 6 % of noise, 1/16 of its standard deviation of one."""
    radiance = np.random.default_rng(4).exponential(1.0, (256, 512, 1)).astype("f4").repeat(3, -1)
    E = gather(ctx, mapped(scene(), radiance), sites(np.zeros((64, 3)), UP), 16, "trace").E
    assert E.std() / E.mean() < 0.01


@pytest.mark.parametrize("bounces", [1, 3])
def test_all_of_the_renderer_takes_a_map(bounces: int) -> None:
    """Records, the surface cache and the picture under a uniform map are those under the same uniform sky. (Sites round otherwise
    under the two, by which at the rim of a record a pixel may ask for one: of eight seeds at most 1.4 % of the pixels, by 5 %.)
    """
    parts = floor(1.0, paint=material(0.7)), quad((-1, 0, -0.5), (2, 0, 0), (0, 1, 0), material(0.5))
    plain = scene(*parts, sky=(0.5, 1.0, 2.0), camera=SIDE)
    world = mapped(replace(plain, sky=(0.0, 0.0, 0.0)), np.broadcast_to((0.5, 1.0, 2.0), (32, 64, 3)))
    frames = [irrsplat.render(it, (32, 24), bounces=bounces, gather_size=16, samples=2) for it in (plain, world)]
    seen = frames[0].alpha == 1.0
    assert 0.2 < seen.mean() < 0.9
    assert np.allclose(frames[0].emission, frames[1].emission, rtol=0.01)
    for pictures in ([frame.image for frame in frames], [frame.irradiance[seen] for frame in frames]):
        one, other = pictures
        assert np.allclose(one, other, rtol=0.01 if bounces == 1 else 0.1)
        assert np.isclose(one, other, rtol=0.01).all(-1).mean() >= (1.0 if bounces == 1 else 0.97)


def test_the_paper_s_records_see_it() -> None:
    """Those that are summed on the CPU as well, within what its single plane sees of the hemisphere."""
    world = cie(scene(floor(1.0), camera=ABOVE), CieSky("overcast", 40.0))
    frame = irrsplat.render(world, (24, 24), preset="paper")
    sky = CieSky("overcast", 40.0)
    assert np.median(frame.irradiance[frame.alpha == 1.0]) == pytest.approx(
        7.0 / 9.0 * np.pi * sky.zenith_luminance / LUMINOUS_EFFICACY, rel=0.06
    )


def before(world: Scene, size: tuple[int, int]) -> np.ndarray:
    """(H, W, 3) what the map has in the directions of the pixels."""
    ways = rays(SIDE, size)
    return world.sky_radiance(ways / np.linalg.norm(ways, axis=-1, keepdims=True))


def test_the_picture_shows_the_map_behind(software: bool) -> None:
    """As its direction says; as the mean of four samples, whose places are 0.1 pixels off its middle in the mean, about so."""
    ways = texel_directions(128, 256)
    radiance = (2.0 + ways + np.sin(5.0 * ways[..., ::-1])).astype("f4")
    world = mapped(scene(floor(1.0), camera=SIDE), radiance, 30.0)
    for samples in (1, 4):
        frame = irrsplat.render(world, (60, 50), bounces=1, gather_size=8, samples=samples)
        unseen = frame.alpha == 0.0
        assert 0.3 < unseen.mean() < 0.95
        for buffer in (frame.image, frame.emission):
            assert np.allclose(
                buffer[unseen], before(world, (60, 50))[unseen], atol=0.02 if samples > 1 else 2e-4 if software else 4.0 / 256.0
            )


def test_a_map_finer_than_pixels_is_shown_by_its_means() -> None:
    """Noise of a texel, seen by pixels of 5 × 5 texels, fades to about a fifth; its mean stays."""
    radiance = (1.0 + np.random.default_rng(3).choice([-1.0, 1.0], (1024, 2048, 1))).astype("f4").repeat(3, -1)
    frame = irrsplat.render(mapped(scene(floor(0.1), camera=SIDE), radiance), (60, 50), bounces=0)
    sky = frame.image[frame.alpha == 0.0][:, 0]
    assert sky.mean() == pytest.approx(1.0, abs=0.03) and sky.std() < 0.35
