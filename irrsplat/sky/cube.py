"""Skies that are given otherwise than by an equirectangular map: by the six faces of a cube, and by spherical harmonics."""

from __future__ import annotations

import numpy as np

from irrsplat.sky.sphere import solid_angles, texel_directions

# Of each face, as glTF's EXT_lights_image_based orders them: the directions of its middle, of its right and of its upper edge, as
# seen from inside. They are those of OpenGL's cube maps, each mirrored about its vertical axis, as the extension has it.
_FACES = np.array(
    [
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[-1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, -1]],
        [[0, -1, 0], [-1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [-1, 0, 0], [0, 1, 0]],
        [[0, 0, -1], [1, 0, 0], [0, 1, 0]],
    ],
    float,
)
_ROWS = 64  # of a map that is made of harmonics: they are smooth
_MOST_ROWS = 2048
# what the bands of harmonics become when radiance is gathered over a hemisphere (Ramamoorthi and Hanrahan 2001, eq. 8)
_COSINE = np.pi * np.array([1.0, *[2.0 / 3.0] * 3, *[0.25] * 5])


def map_of_faces(faces: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32 the equirectangular map of a cube's faces (6, N, N, 3): +x, −x, +y, −y, +z, −z, top row first, as seen
    from inside. turn: (3, 3) takes the directions of the map to those of the cube, as `turn @ direction`."""
    size = faces.shape[1]
    height = min(2 * size, _MOST_ROWS)
    found = np.zeros((height, 2 * height, 3), np.float32)
    for row in range(0, height, 64):  # so many at once: for memory's sake
        rows = np.arange(row, min(row + 64, height))
        d = texel_directions(height, 2 * height, rows) @ turn.T
        face = np.argmax(d @ _FACES[:, 0].T, axis=-1)
        middle, right, up = (np.einsum("...i,...i", _FACES[face, k], d) for k in range(3))
        x, y = ((0.5 + 0.5 * part / middle) * size - 0.5 for part in (right, -up))
        found[rows] = _between(faces, face, x, y)
    return found


def _between(faces: np.ndarray, face: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(…, 3) values between the texels of faces, at (x, y) from the middle of the upper left one; at edges those of the edge."""
    size = faces.shape[1]
    x, y = np.clip(x, 0.0, size - 1.0), np.clip(y, 0.0, size - 1.0)
    i, k = np.minimum(x.astype(int), max(size - 2, 0)), np.minimum(y.astype(int), max(size - 2, 0))
    s, t = (x - i)[..., None], (y - k)[..., None]
    right, below = np.minimum(i + 1, size - 1), np.minimum(k + 1, size - 1)
    upper = faces[face, k, i] * (1.0 - s) + faces[face, k, right] * s
    lower = faces[face, below, i] * (1.0 - s) + faces[face, below, right] * s
    found: np.ndarray = upper * (1.0 - t) + lower * t
    return found


def map_of_harmonics(irradiance: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32 an equirectangular map of radiance whose irradiance has these coefficients (9, 3) of three bands.

    Where the radiance would be below 0 it is 0, and the rest is made as much weaker: the mean is right. turn: as for
    `map_of_faces`.
    """
    d = texel_directions(_ROWS, 2 * _ROWS) @ turn.T
    radiance = harmonics(d) @ (irradiance / _COSINE[:, None])
    area = solid_angles(_ROWS, 2 * _ROWS)[:, None, None]
    kept = np.maximum(radiance, 0.0)
    before, after = np.maximum((radiance * area).sum((0, 1)), 0.0), (kept * area).sum((0, 1))
    found: np.ndarray = kept * np.divide(before, after, out=np.zeros(3), where=after > 0.0)
    return found.astype(np.float32)


def harmonics(directions: np.ndarray) -> np.ndarray:
    """(…, 9) the real spherical harmonics of bands 0 to 2 in unit directions (…, 3), in the order of Ramamoorthi and Hanrahan
    2001, eq. 3: 00, 1−1, 10, 11, 2−2, 2−1, 20, 21, 22."""
    x, y, z = np.moveaxis(directions, -1, 0)
    one = np.full(x.shape, 0.282095)
    first = [0.488603 * y, 0.488603 * z, 0.488603 * x]
    second = [1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3.0 * z * z - 1.0), 1.092548 * x * z, 0.546274 * (x * x - y * y)]
    return np.stack([one, *first, *second], axis=-1)
