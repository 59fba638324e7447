"""The position of the sun at a place and time."""

from __future__ import annotations

from datetime import datetime


def sun_position(latitude: float, longitude: float, when: datetime) -> tuple[float, float]:
    """Return (altitude, azimuth) of the sun's centre in degrees, the azimuth clockwise from north; without refraction.

    latitude, longitude: degrees, north and east positive. when: with its offset from UTC. Accurate to a few hundredths of a
    degree from 1900 to 2100 (NOAA's formulas, after Meeus).
    """
    from astral import Observer  # few scenes need it
    from astral.sun import azimuth, elevation

    place = Observer(latitude, longitude)
    return float(elevation(place, when, with_refraction=False)), float(azimuth(place, when))
