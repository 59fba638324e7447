"""The record cache: irradiance records in world space, valid for all cameras."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import moderngl
import numpy as np

from irrsplat.core import record_layout
from irrsplat.core.buffers import Records, Sites
from irrsplat.core.color import LUMINANCE
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.core.record_layout import GATHERED, TEXTURES
from irrsplat.core.vectors import unit
from irrsplat.gpu import texel_table
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import float_texture
from irrsplat.records.motion import carried, concerned, swallowed
from irrsplat.scene.change import SceneChange

_FLOOR = 0.015  # of the records' mean luminance: see RecordCache.update_luminance_floor
_STEADY = 1.4  # greatest ratio of the luminance floor to its newly computed value, either way, that leaves it unchanged
LINEAR = ("irradiance", "vectors", "gradient")  # columns in proportion to the light; R depends on geometry alone
PROBED = ("irradiance", "radius", "vectors", "gradient")  # columns of a record that a probe keeps, in this order


# CPU arrays with a row for each record: shape and type of a row
_COLUMNS: dict[str, tuple[tuple[int, ...], str]] = {
    "position": ((4,), "f4"),  # xyz, world space
    "normal": ((4,), "f4"),  # xyz, unit shading normal
    "geometric": ((4,), "f4"),  # xyz, unit geometric normal
    "triangle": ((), "i8"),  # number of the triangle below the record; -1: unknown
    "epoch": ((), "i8"),  # invalidation epoch of its last gather
    "last_view": ((), "i8"),  # number of the last view that contained it
    "id": ((), "i8"),  # identity of the record, constant while its number changes
    "frame_rotation": ((), "i8"),  # random seed of the rotation of its frame, see Sites
    "screen": ((), "f4"),  # height of the image at its distance in the view that requested it, metres; 0: unknown
    # E in W/m², R in metres, M and ∇E of its last probe, see change_probe.py; R = 0: no probe yet
    "probe": ((sum(math.prod(record_layout.COLUMNS[name].shape) for name in PROBED),), "f4"),
    "drift": ((), "f4"),  # change of its probes since its gather, 0..1; 1: unknown
    "gather_size": ((), "i8"),  # side of its gather; 0: the settings' side
    "due": ((), "f4"),  # estimated change around it since its last probe; 0: none
}
_SAVED = [name for name in _COLUMNS if name not in ("gather_size", "due")]  # in files
_ON_GPU = [name for name, column in record_layout.COLUMNS.items() if column.source != "site"]  # files have the same names


class RecordCache(Owner):
    """Irradiance records in the order of their creation: content on the GPU, places on the CPU as well.

    A record's number may change when earlier records are dropped; its id does not. A change of the gather, or of
    their light, makes records stale: they keep their content until they are refreshed.

    Methods prepare a change first and assign it last, so that Ctrl-C leaves the cache either unchanged or fully changed.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.count = 0
        self.invalidation_epoch = 0  # number of invalidations
        self.refresh_count = 0  # number of refreshes
        self.revision = 0  # rises when existing records change or are dropped: their splats are void
        self.evicted = 0  # records dropped by `keep_only` so far
        self.luminance_floor = 0.0  # W/m², see `update_luminance_floor`
        self._columns = {name: np.zeros((TABLE_COLUMNS, *shape), kind) for name, (shape, kind) in _COLUMNS.items()}
        self._textures = {name: self._texture(name, 1) for name in TEXTURES}
        self._view = 0  # number of the present view
        self._next_id = 0

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return tuple(self._textures.values())

    @property
    def records(self) -> Records:
        """The present textures; valid until records are added or dropped."""
        return Records(dict(self._textures), self.count, self.luminance_floor)

    @property
    def positions(self) -> np.ndarray:
        """(N, 3) float32, world space: a view of the cache's own array."""
        return self._columns["position"][: self.count, :3]

    def _texture(self, name: str, rows: int, texels: np.ndarray | None = None) -> moderngl.Texture:
        """Return a new texture of so many rows with `texels` (N, channels) in its first places. All other limits are 1."""
        texture = float_texture(self.ctx, (TABLE_COLUMNS, rows), TEXTURES[name])
        if name == "limit":
            texture.write(np.ones(rows * TABLE_COLUMNS, "f4"))
        if texels is not None:
            texel_table.write(texture, 0, texels)
        return texture

    @property
    def _rows(self) -> int:
        return int(self._textures["limit"].height)

    def _replace(self, textures: Mapping[str, moderngl.Texture]) -> None:
        """Use these textures from now on, and free their predecessors."""
        old = [self._textures[name] for name in textures]
        self._textures = {**self._textures, **textures}
        for texture in old:
            texture.release()

    # ---- adding and reading records ----------------------------------------------------------------------------------

    def append(self, sites: Sites, values: np.ndarray | None = None) -> int:
        """Add records at `sites`; return the number of the first.

        values: (N, 4) float32 E in W/m² and R_k in metres; None: the reduction writes them on the GPU later.
        """
        first, count = self.count, self.count + len(sites)
        self._reserve(count)
        new, columns = slice(first, count), self._columns
        for name, rows in (("position", sites.position), ("normal", sites.normal), ("geometric", sites.geometric)):
            columns[name][new, :3] = rows
        columns["triangle"][new] = -1 if sites.triangle is None else sites.triangle
        columns["epoch"][new], columns["last_view"][new] = self.invalidation_epoch, self._view
        for name in ("probe", "drift", "due", "gather_size"):
            columns[name][new] = 0
        columns["screen"][new] = sites.screen_heights
        columns["id"][new] = self._next_id + np.arange(len(sites))
        columns["frame_rotation"][new] = sites.frame_rotations(columns["id"][new])
        for name in ("position", "normal"):
            texel_table.write(self._textures[name], first, columns[name][new])
        limits = np.ones(len(sites)) if sites.radius is None else -sites.radius
        texel_table.write(self._textures["limit"], first, limits[:, None])
        if values is not None:
            texels = {name: np.zeros((len(sites), TEXTURES[name]), "f4") for name in GATHERED}
            record_layout.pack(texels, "irradiance", values[:, :3])
            for name in ("radius", "max_radius"):  # a greatest radius of 0 would mark enclosed records
                record_layout.pack(texels, name, values[:, 3])
            # without directions: E independent of the normal, E = n_k·M, and no derivatives
            record_layout.pack(texels, "vectors", sites.normal[:, None] * values[:, :3, None])
            for name, rows in texels.items():
                texel_table.write(self._textures[name], first, rows)
        next_id = self._next_id + len(sites)
        self.count, self._next_id = count, next_id
        return first

    def _reserve(self, count: int) -> None:
        """Double the rows of arrays and textures until they hold `count` records."""
        rows = self._rows
        if count <= rows * TABLE_COLUMNS:
            return
        while count > rows * TABLE_COLUMNS:
            rows *= 2
        columns = {
            name: np.concatenate([array, np.zeros((rows * TABLE_COLUMNS - len(array), *array.shape[1:]), array.dtype)])
            for name, array in self._columns.items()
        }
        textures = {
            name: self._texture(name, rows, texel_table.read(self.ctx, texture, 0, self.count))
            for name, texture in self._textures.items()
        }
        self._columns = columns
        self._replace(textures)

    @property
    def values(self) -> np.ndarray:
        """(N, 4) float32 E in W/m² and R_k in metres, read back from the GPU."""
        return texel_table.read(self.ctx, self._textures["irradiance"], 0, self.count)

    def read(self) -> dict[str, np.ndarray]:
        """Return the records as numpy arrays: `position`, `normal`, `irradiance` (N, 3) and `radius` (N,), float32."""
        return self.records.read("position", "normal", "irradiance", "radius")

    def sites(self, numbers: np.ndarray | slice) -> Sites:
        """Return the sites of the records of these numbers."""
        triangle = self._columns["triangle"][numbers]
        position, normal, geometric = (self._columns[name][numbers, :3] for name in ("position", "normal", "geometric"))
        known = triangle if (triangle >= 0).all() else None
        return Sites(position, normal, geometric, known, *(self._columns[name][numbers] for name in ("frame_rotation", "screen")))

    def column(self, name: str) -> np.ndarray:
        """Return the column of this name in _COLUMNS, (N, …), writable."""
        return self._columns[name][: self.count]

    # ---- the luminance floor and limits ------------------------------------------------------------------------------

    def update_luminance_floor(self) -> None:
        """Set `luminance_floor` to a share of the records' mean luminance, unless it is close to that already.

        Each change of the floor voids all splats. Without a floor, noise alone would fill an unlit room with records.
        """
        floor = luminance_floor(self.values[:, :3])
        if not floor <= self.luminance_floor * _STEADY <= floor * _STEADY**2:
            self.luminance_floor = floor
            self.revision += 1

    def limits(self, count: int) -> np.ndarray:
        """Return (count,) float32: the limits of the first `count` records, see record_layout.COLUMNS."""
        return texel_table.read(self.ctx, self._textures["limit"], 0, count)[:, 0]

    def set_limits(self, limits: np.ndarray) -> None:
        """Write the limits (N,) of the first records. The caller raises `revision` if splats have used other limits."""
        texel_table.write(self._textures["limit"], 0, limits[:, None])

    # ---- stale records -----------------------------------------------------------------------------------------------

    @property
    def stale(self) -> np.ndarray:
        """The numbers of the stale records, the oldest first."""
        epoch = self.column("epoch")
        (numbers,) = np.nonzero(epoch < self.invalidation_epoch)
        return numbers[np.argsort(epoch[numbers], kind="stable")]

    @property
    def waiting(self) -> int:
        """Number of records that are stale or may be, by changes around them since their last probe."""
        return int(np.count_nonzero((self.column("epoch") < self.invalidation_epoch) | (self.column("due") > 0.0)))

    def age(self, numbers: np.ndarray) -> np.ndarray:
        """Return (N,) the number of invalidations of these records since they were gathered; 0 for dropped records."""
        there = numbers < self.count
        age = np.zeros(len(numbers), np.intp)
        age[there] = self.invalidation_epoch - self._columns["epoch"][numbers[there]]
        return age

    def invalidate(self, numbers: np.ndarray | None = None) -> None:
        """Make the records of these numbers stale; None: all records, whose probes become void."""
        columns, later = dict(self._columns), self.invalidation_epoch + 1
        if numbers is None:
            columns |= {name: np.zeros_like(columns[name]) for name in ("probe", "due")}
            columns["drift"] = np.ones_like(columns["drift"])
        else:
            epoch = columns["epoch"].copy()
            fresh = epoch[: self.count] == self.invalidation_epoch
            fresh[numbers] = False
            epoch[: self.count][fresh] = later
            columns["epoch"] = epoch
        self._columns, self.invalidation_epoch = columns, later

    def mark_refreshed(self, numbers: np.ndarray, sizes: np.ndarray | int = 0) -> None:
        """Mark the records of these numbers as refreshed, no longer stale. sizes: sides of their gathers."""
        columns = self._columns
        columns["gather_size"][numbers] = sizes
        columns["drift"][numbers] = 0.0
        columns["probe"][numbers[columns["due"][numbers] > 0.0]] = 0.0  # taken before the change of the scene
        columns["due"][numbers] = 0.0
        columns["epoch"][numbers] = self.invalidation_epoch
        self.refresh_count += 1
        self.revision += 1

    # ---- dropping and moving records ---------------------------------------------------------------------------------

    @contextmanager
    def adding(self, sites: Sites) -> Iterator[np.ndarray]:
        """Add records at `sites`, and yield their numbers. After a failure from here on, drop them: their columns are empty."""
        first = self.count
        try:
            yield self.append(sites) + np.arange(len(sites))
        except BaseException:
            self.truncate(first)
            raise

    def truncate(self, count: int) -> None:
        """Drop every record from number `count` on; 0 drops all."""
        if count < self.count:
            next_id = int(self._columns["id"][count - 1]) + 1 if count else 0
            self.count, self._next_id = count, next_id
            self.revision += 1

    def mark_seen(self, numbers: np.ndarray) -> None:
        """Begin a new view, with these records in it."""
        self._view += 1
        self._columns["last_view"][numbers] = self._view

    def keep_only(self, numbers: np.ndarray) -> None:
        """Drop all records except these numbers, ascending; the order stays. Frame rotations stay as well: a refresh samples the
        same directions."""
        if len(numbers) == self.count:
            return
        count = len(numbers)
        columns = {name: np.concatenate([array[numbers], array[count:]]) for name, array in self._columns.items()}
        textures = {
            name: self._texture(name, self._rows, texel_table.read(self.ctx, texture, 0, self.count)[numbers])
            for name, texture in self._textures.items()
        }
        evicted = self.evicted + self.count - count
        self._columns, self.count, self.evicted = columns, count, evicted
        self.revision += 1
        self._replace(textures)

    def move_with_meshes(self, change: SceneChange) -> np.ndarray:
        """Move records on moved meshes, with their content, and raise `due` of records that see the change.

        Return the numbers of the records to keep: those outside the moved meshes.
        """
        columns = {name: self._columns[name].copy() for name in ("position", "normal", "geometric", "probe", "due")}
        there = {name: array[: self.count] for name, array in columns.items()}
        triangle = self._columns["triangle"][: self.count]
        geometric = there["geometric"][:, :3]
        kept = ~swallowed(self.positions, geometric, triangle, change)
        there["due"] += concerned(self.positions, geometric, triangle, change)
        moved = carried(self.positions, triangle, change)
        if len(moved.numbers):
            moved.write(there)
            there["probe"][moved.numbers[~moved.rigid]] = 0.0
            vectors = there["probe"][moved.numbers, 4:].reshape(-1, 6, 3)
            there["probe"][moved.numbers, 4:] = np.einsum("nij,nkj->nki", moved.linear_map, vectors).reshape(-1, 18)
            directions = {name: rows[moved.numbers] for name, rows in self.records.read("vectors", "gradient", "axis").items()}
            axis = unit(np.einsum("nij,nj->ni", moved.linear_map, directions.pop("axis")))
            turned = {name: np.einsum("nij,ncj->nci", moved.linear_map, rows) for name, rows in directions.items()}
            texels = {name: there[name] for name in ("position", "normal")}
            texels |= self._corrected(turned | {"axis": axis}, moved.numbers)
            textures = {name: self._texture(name, self._rows, rows) for name, rows in texels.items()}
            self.revision += 1
            self._replace(textures)
        self._columns = {**self._columns, **columns}
        return np.flatnonzero(kept)

    def correct(self, values: Mapping[str, np.ndarray], numbers: np.ndarray) -> None:
        """Overwrite columns of the records of these numbers (K,); values: (K, …) by the names of the columns."""
        textures = {name: self._texture(name, self._rows, rows) for name, rows in self._corrected(values, numbers).items()}
        self.revision += 1
        self._replace(textures)

    def dim(self, factor: np.ndarray) -> None:
        """Scale all records and their probes by `factor` (3,), red, green and blue. No record becomes stale.

        The second derivatives stay: they are relative to luminance, and change only if the factors differ. They affect radii
        only.
        """
        f = np.asarray(factor, np.float32)
        found, before = self.records.read(*LINEAR), luminance_floor(self.values[:, :3])
        scaled = {name: values * (f if name == "irradiance" else f[:, None]) for name, values in found.items()}
        self.correct(scaled, np.arange(self.count))
        if before > 0.0:  # the split into dark and bright records stays
            self.luminance_floor *= luminance_floor(self.values[:, :3]) / before
        probe = self.column("probe")
        probe[:, :3] *= f
        probe[:, 4:] *= np.tile(np.repeat(f, 3), 2)  # M and ∇E, three numbers of each channel
        self.refresh_count += 1  # triggers a new comparison of radii

    def _corrected(self, values: Mapping[str, np.ndarray], numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Return the texels of the textures that these columns lie in, with `values` as in `correct`."""
        names = {texture for column in values for texture, _ in record_layout.COLUMNS[column].slots}
        texels = {name: texel_table.read(self.ctx, self._textures[name], 0, self.count).copy() for name in names}
        rows = {name: array[numbers] for name, array in texels.items()}
        for name, value in values.items():
            record_layout.pack(rows, name, value)
        for name, array in texels.items():
            array[numbers] = rows[name]
        return texels

    # ---- files -------------------------------------------------------------------------------------------------------

    def state(self, stale: bool = False) -> dict[str, np.ndarray]:
        """Return all data of the records for `restore`, as arrays by their names in files.

        stale: mark all records as stale in the result.
        """
        return {
            **{name: self._columns[name][: self.count].copy() for name in _SAVED},
            **{name: rows.copy() for name, rows in self.records.read(*_ON_GPU).items()},  # row by row, as files hold them
            "clocks": np.array([self.invalidation_epoch + stale, self._view, self._next_id]),
            "luminance_floor": np.array(self.luminance_floor),
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Replace all records by those of `state`. Raises KeyError or ValueError for an invalid state, and changes nothing."""
        check_state(state)
        count = len(state["id"])
        self._reserve(count)
        columns = {name: array.copy() for name, array in self._columns.items()}
        for name in _SAVED:
            columns[name][:count] = state[name]
        for name in ("gather_size", "due"):
            columns[name][:count] = 0
        texels = {name: np.zeros((count, channels), "f4") for name, channels in TEXTURES.items()}
        texels |= {name: columns[name][:count] for name in ("position", "normal")}
        for name in _ON_GPU:
            record_layout.pack(texels, name, state[name])
        textures = {name: self._texture(name, self._rows, rows) for name, rows in texels.items()}
        epoch, view, next_id = (int(clock) for clock in state["clocks"])
        self._columns, self.count, self.luminance_floor = columns, count, float(state["luminance_floor"])
        self.invalidation_epoch, self._view, self._next_id = epoch, view, next_id
        self.revision += 1
        self._replace(textures)


def luminance_floor(irradiance: np.ndarray) -> float:
    """Return a share of the mean luminance of irradiance (N, 3) in W/m²; 0 for no records."""
    mean = float((irradiance @ LUMINANCE).mean(dtype=float)) if len(irradiance) else 0.0
    return _FLOOR * max(mean, 0.0)


def check_state(state: Mapping[str, np.ndarray]) -> None:
    """Raise KeyError or ValueError if the arrays of RecordCache.state are incomplete, of wrong shape or not finite."""
    count = len(state["id"])
    shapes = {name: (count, *_COLUMNS[name][0]) for name in _SAVED}
    shapes |= {name: (count, *record_layout.COLUMNS[name].shape) for name in _ON_GPU} | {"clocks": (3,), "luminance_floor": ()}
    for name, shape in shapes.items():
        found = state[name]
        if found.shape != shape or found.dtype.kind not in "fiu" or not np.isfinite(found).all():
            raise ValueError(name)
        # no counter exceeds the integers that float64 holds exactly
        if found.dtype.kind != "f" and not (-(1 << 53) <= found.min(initial=0) <= found.max(initial=0) <= 1 << 53):
            raise ValueError(name)
