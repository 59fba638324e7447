"""Lights in units of lighting design: colour temperatures and outputs."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.editing.objects import COLDEST, HOTTEST, blackbody, heated, kelvin_of, light_units
from irrsplat.core.color import LUMINANCE
from irrsplat.meter.light_meter import LightMeter
from irrsplat.scene.model import Light
from tests.support import worlds

REC_709_TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)


@pytest.mark.parametrize(("kelvin", "x", "y"), [(2000.0, 0.5267, 0.4133), (2856.0, 0.4476, 0.4074), (6500.0, 0.3135, 0.3237)])
def test_chromaticities_of_black_bodies(kelvin: float, x: float, y: float) -> None:
    """Chromaticities are those of illuminant A (2856 K, ISO 11664-2) and of the Planckian locus (Wyszecki and Stiles 2000)."""
    X, Y, Z = REC_709_TO_XYZ @ blackbody(kelvin)
    assert pytest.approx((x, y), abs=0.006) == (X / (X + Y + Z), Y / (X + Y + Z))


def test_higher_temperatures_are_bluer_at_equal_luminance() -> None:
    colours = np.array([*blackbody(np.linspace(COLDEST, HOTTEST, 40))])
    assert colours @ LUMINANCE == pytest.approx(1.0) and (colours >= 0.0).all()
    assert (np.diff(colours[:, 0]) < 0.0).all() and (np.diff(colours[:, 2]) >= 0.0).all()
    assert blackbody(6500.0) == pytest.approx(1.0, abs=0.06), "6500 K is nearly white"
    assert [kelvin_of(heated(Light((0, 1, 0), (3, 2, 1)), k).color) for k in (1800, 2700, 11999)] == [1800, 2700, 11999]


@pytest.mark.parametrize(
    ("light", "unit"),
    [
        (Light((0, 1, 0), (3, 2, 1), physical=True), "candela"),
        (Light((0, 1, 0), (3, 2, 1), physical=True, spot_target=(0, 0, 0), spot_cutoff=30, spot_inner=20), "candela"),
        (Light((0, 1, 0), (3, 2, 1), attenuation=(1, 0.5, 0)), "lux at 1 m"),
        (Light((0, 1, 0), (3, 2, 1), directional=True), "lux"),
        (Light((0, 2, 0), (3, 2, 1), directional=True, physical=True), "lux"),
    ],
    ids=["point", "spot", "attenuated", "sun", "physical sun"],
)
def test_intensities_equal_the_readings_of_a_light_meter(ctx: moderngl.Context, light: Light, unit: str) -> None:
    """On a surface 1 m away that faces the light, lux equal candela; a point light emits 4π lumens per candela."""
    with LightMeter(worlds.scene(worlds.floor(), lights=(light,)), ctx=ctx, bounces=0) as meter:
        lux = meter.measure([(0.0, 0.0, 0.0)], (0.0, 1.0, 0.0)).values("lux")["direct"]
    units = light_units(light)
    assert lux == pytest.approx(units[unit], rel=1e-4)
    assert units.get("lumen", 4 * np.pi * units[unit]) == pytest.approx(4 * np.pi * units[unit])
