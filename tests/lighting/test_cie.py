"""CIE skies and solar position against published formulas, gensky's normalisation and almanacs."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest

from irrsplat.core.color import LUMINANCE, LUMINOUS_EFFICACY, photometric
from irrsplat.sky.cie import SUN_DIAMETER, CieKind, CieSky, clear_sky, sunlight
from irrsplat.sky.sky_text import sun_position
from irrsplat.sky.sphere import solid_angles, texel_directions
from tests.support.skies import irradiance

UP = np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("place", "when", "altitude", "azimuth"),
    [
        # Reda and Andreas 2004, "Solar position algorithm for solar radiation applications", table A5.1: zenith angle 50.11162°,
        # including 0.01° of refraction
        ((39.742476, -105.1786), "2003-10-17T12:30:30-07:00", 39.878, 194.340),
        # Greenwich at the solstice: declination 23.436°, transit 1 min 51 s after noon
        ((51.4769, 0.0), "2026-06-21T12:01:51+00:00", 90.0 - 51.4769 + 23.436, 180.0),
        # Declination 0 on 20 March 2026: at the equator the sun rises due east, 7 min 26 s after 6 o'clock mean time
        ((0.0, -131.59), "2026-03-20T14:53:50+00:00", 0.0, 90.0),
        # Sydney at the December solstice: culmination in the north, 1 min 40 s before noon mean time
        ((-33.8688, 151.2093), "2026-12-22T12:53:30+11:00", 90.0 - 33.8688 + 23.436, 0.0),
    ],
)
def test_the_sun_stands_where_almanacs_have_it(place: tuple[float, float], when: str, altitude: float, azimuth: float) -> None:
    """The direction is within 0.1° on the sky."""
    found = CieSky("clear", *sun_position(*place, datetime.fromisoformat(when))).sun_direction
    expected = CieSky("clear", altitude, azimuth).sun_direction
    assert np.degrees(np.linalg.norm(found - expected)) < 0.1


def test_published_values() -> None:
    """An overcast horizon has a third of the zenith's luminance; zeniths as published in kcd/m², the sun as in gensky."""
    assert CieSky("overcast", 30.0).relative(np.array([1.0, 0.0, 0.0])) == pytest.approx(1.0 / 3.0)
    assert CieSky("clear", 45.0, 0.0, turbidity=3.0).zenith_luminance == pytest.approx(1000.0 * (1.376 * 3.0 - 1.81 + 0.38))
    assert CieSky("overcast", 30.0).zenith_luminance == pytest.approx(1000.0 * (0.123 + 8.6 * 0.5))
    assert CieSky("clear", 90.0, 0.0).sun_illuminance == pytest.approx(90_000.0)


@pytest.mark.parametrize("altitude", [10.0, 60.0])
@pytest.mark.parametrize("kind", ["clear", "intermediate"])
def test_the_sky_s_light_is_what_gensky_reckons_with(kind: CieKind, altitude: float) -> None:
    """The horizontal irradiance, relative to a uniform sky of the zenith's luminance, follows gensky's polynomials.

    They depend on the sun's altitude and are accurate to 2 %.
    """
    fitted = {
        "clear": (2.766521, 0.547665, -0.369832, 0.009237, 0.059229),
        "intermediate": (3.5556, -2.7152, -1.3081, 1.0660, 0.60227),
    }[kind]
    h = np.radians(altitude)
    whole = {
        "clear": 0.274 * (0.91 + 10.0 * np.exp(-3.0 * (0.5 * np.pi - h)) + 0.45 * np.sin(h) ** 2),
        "intermediate": (2.739 + 0.9891 * np.sin(0.3119 + 2.6 * h)) * np.exp(-(0.5 * np.pi - h) * (0.4441 + 1.48 * h)),
    }[kind]
    expected = np.polyval(fitted[::-1], (h - np.pi / 4) / (np.pi / 4)) / whole / np.pi
    sky = CieSky(kind, altitude, 77.0, ground=0.0)
    E = photometric(irradiance(sky.environment("").light, UP)[0])
    assert E / (np.pi * sky.zenith_luminance) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("kind", ["uniform", "overcast"])
def test_a_sky_of_so_many_lux_brings_them(kind: CieKind) -> None:
    """E = π·L_z, and 7/9 of it under an overcast sky; the ground reflects a share of it."""
    sky = CieSky(kind, lux=10_000.0, ground=0.3).environment("")
    share = 1.0 if kind == "uniform" else 7.0 / 9.0
    assert sky.light[0, 0, 0] * LUMINOUS_EFFICACY == pytest.approx(10_000.0 / (np.pi * share), rel=1e-3)
    assert irradiance(sky.light, UP)[0] * LUMINOUS_EFFICACY == pytest.approx([10_000.0] * 3, rel=1e-3)
    assert sky.light[-1, 0] * LUMINOUS_EFFICACY == pytest.approx([0.3 * 10_000.0 / np.pi] * 3, rel=1e-3)


def test_the_sun_is_in_the_picture_of_the_sky_and_not_in_its_light() -> None:
    """The picture has a disc of half a degree with all of the sun's light, at its position."""
    sky = CieSky("clear", 33.0, 250.0)
    made = sky.environment("")
    disc = photometric((made.shown - made.light).astype(float))
    height, width = disc.shape
    weight = disc * solid_angles(height, width)[:, None]
    (sun,) = made.suns
    assert weight.sum() == pytest.approx(photometric(np.array(sun.irradiance)), rel=1e-5) == pytest.approx(sky.sun_illuminance)
    ways = texel_directions(height, width)
    middle = np.einsum("ij,ijk->k", weight, ways)
    assert np.degrees(np.arccos(np.clip(middle @ sun.direction / np.linalg.norm(middle), -1, 1))) < 0.02
    assert np.degrees(np.arccos((ways @ sun.direction)[disc > 0.0].min())) < 0.5 * SUN_DIAMETER + 0.15
    assert made.light.max() < 0.01 * made.shown.max()


def test_a_clear_sky_is_blue_and_a_low_sun_is_red() -> None:
    """Rayleigh scattering grows with the fourth power of the frequency: the sky is blue and a low sun red.

    All colours have luminance 1, so that illuminances do not depend on them.
    """
    ways = np.array([[0.0, 1.0, 0.0], [0.6, 0.8, 0.0]])
    for altitude in (5.0, 30.0, 70.0):
        toward = np.array([0.0, np.sin(np.radians(altitude)), -np.cos(np.radians(altitude))])
        sky, sun = clear_sky(ways, toward, 2.45), sunlight(toward[1], 2.45)
        assert np.concatenate([sky, sun[None]]) @ LUMINANCE == pytest.approx(1.0)
        assert (sky[:, 2] > 1.2 * sky[:, 0]).all() and sun[0] > sun[1] > sun[2]
    low, high = sunlight(np.sin(np.radians(5.0)), 2.45), sunlight(1.0, 2.45)
    assert low[0] / low[2] > 4.0 * high[0] / high[2]
