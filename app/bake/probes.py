"""Probes: irradiance at the places of a grid, about every direction, by spherical harmonics of second order (nine numbers a
colour).

E(n) = Σ c_i·Y_i(n), with the real basis Y of `basis` (Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance
Environment Maps"): what stands in a file is irradiance itself, convolved already.
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

ENDINGS = (".json", ".npz")
MOST = 1_000_000  # probes
_DIRECTIONS = 32  # about which irradiance is measured at each probe: of what is no light above the second order little is left
_WITHIN = 0.5  # of the directions about which a probe within a solid sees nothing but it, at least
_USUAL = 8  # probes along the longest side of the scene, where no grid is given
_BATCH = 256  # probes between two reports
_FORMAT = 1
BASIS = (
    "Y = (0.282095, 0.488603 y, 0.488603 z, 0.488603 x, 1.092548 x y, 1.092548 y z, 0.315392 (3 z^2 - 1), 1.092548 x z, "
    "0.546274 (x^2 - y^2)) of a unit vector (x, y, z) in world space"
)


def basis(directions: np.ndarray) -> np.ndarray:
    """(N, 9) the real spherical harmonics up to second order of unit vectors (N, 3), in the order of BASIS."""
    x, y, z = np.asarray(directions, float).T
    one = np.ones_like(x)
    rows = [
        math.sqrt(1.0 / math.pi) / 2.0 * one,
        *(math.sqrt(3.0 / math.pi) / 2.0 * v for v in (y, z, x)),
        *(math.sqrt(15.0 / math.pi) / 2.0 * v for v in (x * y, y * z)),
        math.sqrt(5.0 / math.pi) / 4.0 * (3.0 * z * z - 1.0),
        math.sqrt(15.0 / math.pi) / 2.0 * x * z,
        math.sqrt(15.0 / math.pi) / 4.0 * (x * x - y * y),
    ]
    return np.stack(rows, axis=1)


@dataclass(frozen=True, eq=False)
class Probes:
    """A grid of probes: `origin` (3,) is the first, `step` (3,) metres to the next along x, y and z, `counts` (3,) of them.

    coefficients: (Z, Y, X, 9, 3) W/m² of red, green and blue by the basis above. valid: (Z, Y, X) bool, False for a probe
    within a solid, which has the numbers of the nearest valid one, so that what is interpolated beside it is not dark.
    """

    origin: np.ndarray
    step: np.ndarray
    counts: tuple[int, int, int]
    coefficients: np.ndarray
    valid: np.ndarray

    def irradiance(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N, 3) W/m² at points (N, 3) about unit normals (N, 3): trilinear between the probes, as the documented GLSL has it;
        beyond the grid as at its rim."""
        at = (np.asarray(points, float) - self.origin) / self.step
        last = np.array(self.counts) - 1
        low = np.clip(np.floor(at), 0, np.maximum(last - 1, 0)).astype(np.int64)
        share = np.clip(at - low, 0.0, np.minimum(last, 1))
        found = np.zeros((len(at), 9, 3))
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, share, 1.0 - share).prod(1)
            x, y, z = np.minimum(low + corner, last).T
            found += weight[:, None, None] * self.coefficients[z, y, x]
        light: np.ndarray = np.maximum(np.einsum("nk,nkc->nc", basis(normals), found), 0.0)
        return light

    def save(self, path: str | os.PathLike[str]) -> tuple[Path, ...]:
        """Write a .json or .npz, completely or not at all; its name. Raises InputError for another ending, IrrsplatError where it
        cannot be written."""
        target = Path(path)
        told = {
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
            files.write_text(target, files.json_text(told | arrays, None) + "\n")
        elif target.suffix.lower() == ".npz":
            data = io.BytesIO()
            np.savez_compressed(data, coefficients=self.coefficients.astype(np.float32), valid=self.valid,
                                origin=self.origin, step=self.step, about=np.array(files.json_text(told, None)))  # fmt: skip
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
    """Probes all over the scene's bounding box, at most `grid` metres apart (None: an eighth of its longest side), each in the
    middle of a cell. preset, settings: those of the stages shadow and gather; each direction is gathered from by itself, about as
    finely as a sixteenth of a record unless `gather_size` says otherwise. Of all light, lamps as well.

    Raises InputError for what cannot be, GLError where there is no OpenGL.
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
    solve = np.linalg.pinv(basis(directions))  # least squares
    found, valid = np.zeros((len(places), 9, 3)), np.ones(len(places), bool)
    values: SettingValues = {"gather_size": 16, **settings}
    with LightMeter(scene, preset, ctx, **values) as meter:
        for first in range(0, len(places), _BATCH):
            some = places[first : first + _BATCH]
            told = None if on_bake is None else partial(_tell, on_bake, first, len(some), len(places))
            readings = meter.measure(np.repeat(some, len(directions), axis=0), np.tile(directions, (len(some), 1)), told)
            light = readings.total.reshape(len(some), len(directions), 3)
            found[first : first + len(some)] = np.einsum("kd,ndc->nkc", solve, light)
            blocked = (readings.status != Status.OK).reshape(len(some), -1).mean(1)
            valid[first : first + len(some)] = blocked < _WITHIN
    if valid.any() and not valid.all():
        from scipy.spatial import cKDTree

        found[~valid] = found[valid][cKDTree(places[valid]).query(places[~valid])[1]]
    return Probes(low + 0.5 * step, step, (x, y, z), found.reshape(z, y, x, 9, 3), valid.reshape(z, y, x))


def _tell(on_bake: OnBake, first: int, some: int, whole: int, share: float) -> None:
    on_bake((first + share * some) / whole, f"{whole} probes")


def _rounded(values: np.ndarray) -> list[object]:
    """Nested lists with seven digits each: a probe's 27 numbers in a row of their own would be the same, three times as long."""
    shown: list[object] = np.vectorize(lambda v: float(f"{v:.7g}"))(values).reshape(-1, 9, 3).tolist()
    return shown
