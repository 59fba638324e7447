"""The icon: splats on a dark square, rasterized at any size or as SVG from the same data."""

from __future__ import annotations

import numpy as np

SIZES = (16, 32, 48, 64, 128, 256, 512)  # pixels, the sizes of desktops
GROUND = (0.075, 0.085, 0.110)
CORNER = 0.20  # radius of the square's corners, as a share of its side
SPLATS = (  # x, y (down), radius, as shares of the side, and the centre's colour
    (0.50, 0.30, 0.40, (1.00, 0.90, 0.68)),
    (0.24, 0.62, 0.36, (0.93, 0.24, 0.13)),
    (0.77, 0.60, 0.36, (0.22, 0.78, 0.30)),
    (0.50, 0.76, 0.30, (0.95, 0.72, 0.34)),
    (0.62, 0.44, 0.20, (0.98, 0.95, 0.85)),
)
_STOPS = 8  # gradient stops of the SVG
_FINER = 4  # samples per pixel in each direction


def kernel(distance: np.ndarray) -> np.ndarray:
    """Return a splat's weight at a distance in radii: 1 at the centre, 0 at the rim, smooth at both."""
    found: np.ndarray = np.maximum(0.0, 1.0 - distance**2) ** 2
    return found


def icon(side: int) -> np.ndarray:
    """Return sRGB values (side, side, 4) in 0..1 with alpha; colours combine by screen blending, as in the SVG."""
    step = (np.arange(side * _FINER) + 0.5) / (side * _FINER)
    x, y = np.meshgrid(step, step)
    rest = np.broadcast_to(1.0 - np.array(GROUND), (*x.shape, 3)).copy()
    for at_x, at_y, radius, colour in SPLATS:
        rest *= 1.0 - kernel(np.hypot(x - at_x, y - at_y) / radius)[..., None] * np.array(colour)
    beyond = np.maximum(np.abs(np.stack((x, y)) - 0.5) - (0.5 - CORNER), 0.0)
    inside = (np.hypot(*beyond) <= CORNER)[..., None]
    fine = np.concatenate(((1.0 - rest) * inside, inside), axis=2)
    found: np.ndarray = fine.reshape(side, _FINER, side, _FINER, 4).mean((1, 3))
    found[..., :3] /= np.maximum(found[..., 3:], 1e-6)
    return found


def svg() -> str:
    """Return the icon as an SVG of 256 units' side."""
    gradients = circles = ""
    shares = np.linspace(0.0, 1.0, _STOPS + 1)
    for i, (x, y, radius, colour) in enumerate(SPLATS):
        stops = "".join(
            f'<stop offset="{share:.3g}" stop-color="{_hex(colour)}" stop-opacity="{opacity:.3g}"/>'
            for share, opacity in zip(shares, kernel(shares), strict=True)
        )
        gradients += f'<radialGradient id="s{i}">{stops}</radialGradient>\n'
        place = f'cx="{256 * x:.4g}" cy="{256 * y:.4g}" r="{256 * radius:.4g}"'
        circles += f'<circle {place} fill="url(#s{i})" style="mix-blend-mode:screen"/>\n'
    square = f'width="256" height="256" rx="{256 * CORNER:.4g}"'
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 256 256">\n'
        f'<defs>\n<clipPath id="square"><rect {square}/></clipPath>\n{gradients}</defs>\n'
        f'<g clip-path="url(#square)" style="isolation:isolate">\n<rect {square} fill="{_hex(GROUND)}"/>\n'
        f"{circles}</g>\n</svg>\n"
    )


def _hex(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * c):02x}" for c in colour)
