"""Irradiance probes on a grid, as spherical harmonics of second order (nine coefficients per colour).

E(n) = Σ c_i·Y_i(n), with the real basis Y of `harmonics` (Ramamoorthi and Hanrahan 2001, "An Efficient Representation for
Irradiance Environment Maps"). Files hold irradiance: the cosine convolution is already applied.
"""

from __future__ import annotations

import io
import math
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Unpack

import moderngl
import numpy as np

from irrsplat.app.bake.light import OnBake
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import sphere
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.readings import Status
from irrsplat.scene.model import Scene
from irrsplat.scene.model.checks import check_type
from irrsplat.settings import SettingValues
from irrsplat.sky.cube import harmonics

ENDINGS = (".json", ".npz")
MOST = 1_000_000  # probes
_DIRECTIONS = 32  # normals per probe: enough to suppress aliasing from light above the second order
_WITHIN = 0.5  # share of blocked directions above which a probe counts as inside a solid
_USUAL = 8  # probes along the longest side of the scene by default
_BATCH = 256  # probes between two progress reports
_FORMAT = 1
BASIS = (
    "Y = (0.282095, 0.488603 y, 0.488603 z, 0.488603 x, 1.092548 x y, 1.092548 y z, 0.315392 (3 z^2 - 1), 1.092548 x z, "
    "0.546274 (x^2 - y^2)) of a unit vector (x, y, z) in world space"
)


@dataclass(frozen=True, eq=False)
class Probes:
    """Grid of probes: `origin` (3,) is the first probe, `step` (3,) the spacing in metres, `counts` (3,) the size.

    coefficients: (Z, Y, X, 9, 3) W/m² for red, green and blue. valid: (Z, Y, X) bool, False inside solids. An invalid probe
    holds the nearest valid probe's coefficients, so that interpolation next to it is not dark.
    """

    origin: np.ndarray
    step: np.ndarray
    counts: tuple[int, int, int]
    coefficients: np.ndarray
    valid: np.ndarray

    def irradiance(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return irradiance (N, 3) in W/m² at points (N, 3) with unit normals (N, 3).

        The interpolation is trilinear, as in the documented GLSL; points outside the grid have the values of its boundary.
        """
        at = (np.asarray(points, float) - self.origin) / self.step
        last = np.array(self.counts) - 1
        low = np.clip(np.floor(at), 0, np.maximum(last - 1, 0)).astype(np.int64)
        share = np.clip(at - low, 0.0, np.minimum(last, 1))
        found = np.zeros((len(at), 9, 3))
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, share, 1.0 - share).prod(1)
            x, y, z = np.minimum(low + corner, last).T
            found += weight[:, None, None] * self.coefficients[z, y, x]
        light: np.ndarray = np.maximum(np.einsum("nk,nkc->nc", harmonics(normals), found), 0.0)
        return light

    def save(self, path: str | os.PathLike[str]) -> tuple[Path, ...]:
        """Write a .json or .npz, completely or not at all; return its path.

        Raises InputError for another ending, IrrsplatError for a failed write.
        """
        target = Path(path)
        about = {
            "format": "irrsplat probes",
            "version": _FORMAT,
            "unit": "W/m2",
            "quantity": "irradiance E(n) = sum over i of coefficients[i] * Y_i(n), clamped at 0",
            "basis": BASIS,
            "order": "z slowest, then y, then x; nine coefficients each; red, green, blue each",
            "origin": self.origin.tolist(),
            "step": self.step.tolist(),
            "counts": list(self.counts),
        }
        if target.suffix.lower() == ".json":
            arrays = {"valid": self.valid.ravel().astype(int).tolist(), "coefficients": _rounded(self.coefficients)}
            files.write_text(target, files.json_text(about | arrays, None) + "\n")
        elif target.suffix.lower() == ".npz":
            data = io.BytesIO()
            np.savez_compressed(data, coefficients=self.coefficients.astype(np.float32), valid=self.valid,
                                origin=self.origin, step=self.step, about=np.array(files.json_text(about, None)))  # fmt: skip
            files.write_bytes(target, data.getvalue())
        else:
            raise InputError(f"probes are written as {' or '.join(ENDINGS)}; give -o a name that ends so", str(path) or "''")
        return (target,)


def bake_probes(
    scene: Scene,
    grid: float | None = None,
    preset: str = "default",
    on_bake: OnBake | None = None,
    ctx: moderngl.Context | None = None,
    **settings: Unpack[SettingValues],
) -> Probes:
    """Bake probes over the scene's bounding box, at most `grid` metres apart, at the centres of grid cells.

    grid: None for an eighth of the longest side. preset, settings: settings of the stages shadow and gather. Each direction
    has a gather of its own, by default as fine as a sixteenth of a record (`gather_size`). Direct light is included. Raises
    InputError for invalid arguments, GLError without OpenGL.
    """
    check_type("what probes are baked of", scene, Scene)
    low, high = scene.bounds
    size = np.maximum(high - low, 1e-6 * scene.diagonal)
    if grid is None:
        grid = float(size.max()) / _USUAL
    if not grid > 0.0:
        raise InputError(f"--grid is {grid:g}; it takes metres above 0")
    x, y, z = (max(math.ceil(length / grid - 1e-6), 1) for length in size)
    if x * y * z > MOST:
        raise InputError(f"there would be {x * y * z:,} probes, at most {MOST:,} go; widen the grid")
    step = size / (x, y, z)
    iz, iy, ix = (v.ravel() for v in np.indices((z, y, x)))
    places = low + (np.stack([ix, iy, iz], axis=1) + 0.5) * step
    directions = sphere(_DIRECTIONS)
    solve = np.linalg.pinv(harmonics(directions))  # least squares
    found, valid = np.zeros((len(places), 9, 3)), np.ones(len(places), bool)
    values: SettingValues = {"gather_size": 16, **settings}
    with LightMeter(scene, preset, ctx, **values) as meter:
        for first in range(0, len(places), _BATCH):
            some = places[first : first + _BATCH]
            notify = None if on_bake is None else partial(_notify, on_bake, first, len(some), len(places))
            readings = meter.measure(np.repeat(some, len(directions), axis=0), np.tile(directions, (len(some), 1)), notify)
            light = readings.total.reshape(len(some), len(directions), 3)
            found[first : first + len(some)] = np.einsum("kd,ndc->nkc", solve, light)
            blocked = (readings.status != Status.OK).reshape(len(some), -1).mean(1)
            valid[first : first + len(some)] = blocked < _WITHIN
    if valid.any() and not valid.all():
        from scipy.spatial import cKDTree

        found[~valid] = found[valid][cKDTree(places[valid]).query(places[~valid])[1]]
    return Probes(low + 0.5 * step, step, (x, y, z), found.reshape(z, y, x, 9, 3), valid.reshape(z, y, x))


def _notify(on_bake: OnBake, first: int, some: int, whole: int, share: float) -> None:
    on_bake((first + share * some) / whole, f"{whole} probes")


def _rounded(values: np.ndarray) -> list[object]:
    """Return nested lists with seven digits: one row per number would triple the length of the file."""
    shown: list[object] = np.vectorize(lambda v: float(f"{v:.7g}"))(values).reshape(-1, 9, 3).tolist()
    return shown
