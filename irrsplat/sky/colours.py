"""Colours of a clear sky and of sunlight, as factors of luminance 1."""

from __future__ import annotations

import numpy as np

from irrsplat.core.color import LUMINANCE

# Preetham, Shirley and Smits 1999, A.2: Perez coefficients A to E of the chromaticities x and y, linear in the turbidity.
_PEREZ = np.array(
    [
        [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
        [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
    ]
)
# The same appendix: x and y at the zenith, by powers 2 to 0 of the turbidity and powers 3 to 0 of the sun's zenith angle.
_ZENITH = np.array(
    [
        [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]],
        [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]],
    ]
)
_RGB_FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])  # IEC 61966-2-1
_LOWEST = 0.03  # cosine of the zenith angle: the Perez function has a pole at the horizon
_WAVELENGTHS = np.array([0.610, 0.550, 0.465])  # micrometres: middles of red, green and blue
_TURBIDITIES = (1.7, 10.0)  # range of the fit


def clear_sky(directions: np.ndarray, sun: np.ndarray, turbidity: float) -> np.ndarray:
    """Return the colour (…, 3) of a clear sky in unit directions (…, 3), y up, of luminance 1 (Preetham et al. 1999).

    sun: (3,) unit vector towards the sun. Colours outside of sRGB are clipped at 0 before they are scaled.
    """
    T = min(max(turbidity, _TURBIDITIES[0]), _TURBIDITIES[1])
    theta_sun = float(np.arccos(np.clip(sun[1], 0.0, 1.0)))
    cosine = np.clip(directions @ sun, -1.0, 1.0)
    gamma, rise = np.arccos(cosine), np.maximum(directions[..., 1], _LOWEST)
    chromaticity = []
    for coefficients, zenith in zip(_PEREZ, _ZENITH, strict=True):
        A, B, C, D, E = coefficients @ np.array([T, 1.0])
        at_zenith = np.array([T * T, T, 1.0]) @ zenith @ np.array([theta_sun**3, theta_sun**2, theta_sun, 1.0])
        here = (1.0 + A * np.exp(B / rise)) * (1.0 + C * np.exp(D * gamma) + E * cosine**2)
        there = (1.0 + A * np.exp(B)) * (1.0 + C * np.exp(D * theta_sun) + E * sun[1] ** 2)
        chromaticity.append(at_zenith * here / there)
    return of_chromaticity(*chromaticity)


def of_chromaticity(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the linear colours (…, 3) of CIE chromaticities, with luminance 1. Negative components become 0 before."""
    return _unit_luminance(np.stack([x / y, np.ones_like(x), (1.0 - x - y) / y], -1) @ _RGB_FROM_XYZ.T)


def sunlight(sine: float, turbidity: float) -> np.ndarray:
    """Return the colour (3,) of the sun, of luminance 1, by its height's sine (Preetham et al. 1999, appendix A.1).

    Rayleigh scattering and Angstrom's aerosols redden it; above the atmosphere it is taken for white.
    """
    T = min(max(turbidity, _TURBIDITIES[0]), _TURBIDITIES[1])
    degrees = float(np.degrees(np.arcsin(np.clip(sine, 0.0, 1.0))))
    mass = 1.0 / (max(sine, 0.0) + 0.15 * (degrees + 3.885) ** -1.253)  # relative optical air mass
    aerosol = 0.04608 * T - 0.04586
    depth = 0.008735 * _WAVELENGTHS**-4.08 + aerosol * _WAVELENGTHS**-1.3
    return _unit_luminance(np.exp(-depth * mass))


def _unit_luminance(color: np.ndarray) -> np.ndarray:
    """Return colours (…, 3) clipped at 0 and scaled to luminance 1."""
    clipped = np.maximum(color, 0.0)
    return np.asarray(clipped / (clipped @ LUMINANCE)[..., None])
