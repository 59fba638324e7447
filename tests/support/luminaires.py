"""Photometric files from arrays, and the light of luminaires by formula."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from irrsplat.scene.model import Photometry

Intensity = Callable[[np.ndarray, np.ndarray], np.ndarray]  # cd by vertical and horizontal angle in radians


def steps(first: float, last: float, count: int) -> list[float]:
    """Return evenly spaced angles in degrees."""
    return np.linspace(first, last, count).tolist()


def ies_text(
    vertical: Sequence[float],
    horizontal: Sequence[float],
    candela: Intensity,
    kind: int = 1,
    header: str = "IESNA:LM-63-2002\n[TEST] made for a test",
    tilt: str = "TILT=NONE",
    multiplier: float = 1.0,
    units: int = 2,
    factors: str = "1 1 100",
) -> str:
    """Return a file with these angles in degrees and their intensities; kind: 1, 2 or 3 for photometry of type C, B or A."""
    v, h = np.meshgrid(np.radians(vertical), np.radians(horizontal))
    counts = f"{len(vertical)} {len(horizontal)}"
    rows = [" ".join(f"{x:.9g}" for x in row) for row in (vertical, horizontal, *candela(v, h))]
    lines = [header, tilt, f"1 -1 {multiplier:g} {counts} {kind} {units} 0.5 -0.5 0", factors, *rows]
    return "\n".join(lines) + "\n"


def isotropic(v: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return 100 cd in all directions: 400π lm."""
    return np.full(v.shape, 100.0)


def lambert(v: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return 1000·cos γ cd downwards, 0 upwards: 1000π lm."""
    return 1000.0 * np.maximum(np.cos(v), 0.0)


def street(v: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return a street light's intensity: more to the front (0°), two side beams about 60° from the nadir, 0 upwards."""
    aside = np.degrees(np.arccos(np.cos(h)))  # 0..180, equal on both sides
    beam = 1.0 + 3.0 * np.exp(-(((np.degrees(v) - 60.0) / 12.0) ** 2) - ((aside - 65.0) / 20.0) ** 2)
    return 400.0 * np.maximum(np.cos(v), 0.0) ** 0.3 * beam * (1.2 + np.cos(h) * np.sin(v))


def lopsided(v: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return intensities that differ in every direction, upwards as well."""
    return 300.0 + 150.0 * np.cos(h - 0.7) * np.sin(v) + 80.0 * np.sin(3.0 * h) * np.sin(v) ** 2 + 90.0 * np.cos(v)


def photometry(polar: Sequence[float], azimuth: Sequence[float], candela: Intensity) -> Photometry:
    """Return photometry of type C with these angles in degrees and their intensities."""
    v, h = np.meshgrid(np.radians(polar), np.radians(azimuth))
    return Photometry(np.array(polar), np.array(azimuth), candela(v, h), np.diag([1.0, 1.0, -1.0]))


def bilinear(candela: Intensity, vertical: Sequence[float], horizontal: Sequence[float], way: np.ndarray) -> np.ndarray:
    """Return (…,) cd along directions (…, 3) from a luminaire in its own frame, aimed along −z with 0° at +x.

    The intensity is linear between these angles; horizontal angles cover a full circle or are a single one.
    """
    v, h = np.meshgrid(np.radians(vertical), np.radians(horizontal), indexing="ij")
    values = candela(v, h)
    x, y, z = np.moveaxis(way, -1, 0)
    at_v = np.degrees(np.arccos(np.clip(-z / np.linalg.norm(way, axis=-1), -1.0, 1.0)))
    at_h = np.degrees(np.arctan2(y, x)) % 360.0
    if len(horizontal) == 1:
        horizontal, values = (0.0, 360.0), np.repeat(values, 2, axis=1)
    return RegularGridInterpolator((vertical, horizontal), values, bounds_error=False, fill_value=0.0)((at_v, at_h))
