"""Where the sun stands at a place and time."""

from __future__ import annotations

from datetime import datetime


def sun_position(latitude: float, longitude: float, when: datetime) -> tuple[float, float]:
    """(altitude, azimuth) of the sun's middle in degrees, the azimuth clockwise from north; without refraction.

    latitude, longitude: degrees, north and east positive. when: with its offset from UTC. Good to a few hundredths of a degree
    from 1900 to 2100 (the formulas of NOAA, after Meeus).
    """
    from astral import Observer  # few scenes need it
    from astral.sun import azimuth, elevation

    place = Observer(latitude, longitude)
    return float(elevation(place, when, with_refraction=False)), float(azimuth(place, when))
