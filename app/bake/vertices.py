"""Light as vertex colours, on triangles subdivided where the light is not linear along an edge."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import moderngl
import numpy as np

from irrsplat.app.bake import seams
from irrsplat.app.bake.cutting import Cut
from irrsplat.app.bake.glb import Glb
from irrsplat.app.bake.light import OnBake, PlaceLight
from irrsplat.app.bake.lightmap import Light, limit_of, texture_coordinates
from irrsplat.app.bake.places import Receivers, hidden, places
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import along_a_way, triangle_areas
from irrsplat.gather.record_frame import offset_of
from irrsplat.scene.model import Scene
from irrsplat.scene.model.checks import check_type
from irrsplat.settings import SettingValues

TOLERANCE, MOST = 0.05, 200_000  # defaults: relative error at an edge's midpoint; vertices
_LONGEST, _SHORTEST = 1.0 / 12.0, 1.0 / 384.0  # edges always cut, never cut; in sides of a cube with the scene's diagonal
_DIM = 0.1  # share of the mean light: floor for relative errors
_ROUNDS = 24
_INWARD = 0.02  # share of the way to the triangle's centre: sampling stays off the triangle's edges
_COLUMNS, _TILE = 64, 8  # tiles per row of a picture of points, and points per side of a tile


@dataclass(frozen=True, eq=False)
class VertexLight:
    """Light at vertices, (V, 3) each: irradiance in W/m², with or without direct light; indirect and direct are its parts.

    records, converged: as in a render. complete: True if `most` left no edge uncut.
    """

    receivers: Receivers
    cut: Cut
    light: Light
    irradiance: np.ndarray
    indirect: np.ndarray
    direct: np.ndarray
    records: int
    converged: bool
    complete: bool

    def save(self, path: str | os.PathLike[str]) -> tuple[Path, ...]:
        """Write a .glb, completely or not at all; return its path.

        Raises InputError for another ending, IrrsplatError for a failed write.
        """
        glb = Path(path)
        if glb.suffix.lower() != ".glb":
            raise InputError("vertex colours are written as a .glb; give -o a name that ends so", str(path) or "''")
        files.write_bytes(glb, glb_of(self))
        return (glb,)

    @property
    def summary(self) -> dict[str, Any]:
        """Sizes for --stats."""
        return {"vertices": len(self.cut.root), "triangles": len(self.cut.faces), "complete": self.complete,
                "records": self.records, "converged": self.converged}  # fmt: skip

    @property
    def words(self) -> str:
        """Sizes as lines of text."""
        missing = "" if self.complete else "\nnot all     edges are cut that should be; raise --most or --cut"
        return f"vertices    {len(self.cut.root):,} of {len(self.cut.faces):,} triangles{missing}"


def bake_vertices(
    scene: Scene,
    cut: float = TOLERANCE,
    light: Light = "all",
    most: int = MOST,
    preset: str = "default",
    on_bake: OnBake | None = None,
    ctx: moderngl.Context | None = None,
    **settings: Unpack[SettingValues],
) -> VertexLight:
    """Bake light at the vertices of a scene, with adaptive subdivision.

    Edges are cut until linear interpolation is within `cut`, a share of the light, at every midpoint, or `most` vertices
    exist. Other parameters and errors: as in bake_lightmap, without the extra.
    """
    check_type("what vertex colours are baked of", scene, Scene)
    if not cut > 0.0:
        raise InputError(f"--cut is above 0, not {cut:g}; it is a share of the light")
    notify = on_bake or (lambda share, words: None)
    receivers = Receivers.of(scene, ctx)
    if not receivers.meshes:
        raise InputError("the scene has no triangles to bake light on")
    side = receivers.scene.diagonal / np.sqrt(3.0)
    with PlaceLight(receivers.scene, preset, ctx, **settings) as lights:
        pieces = Cut.whole(receivers)
        found = _Found(receivers, lights, light, side * _SHORTEST)
        known = found.at(pieces.root, pieces.corner)
        fine = np.zeros(0, np.int64)  # edges with a sufficiently exact midpoint
        marked = np.ones(1, bool)
        for _ in range(_ROUNDS):
            notify(min(len(pieces.root) / most, 1.0), f"{len(pieces.root)} vertices")
            edges = pieces.edges(receivers)
            long = edges.length > side * _LONGEST
            (tested,) = np.nonzero(~long & (edges.length > 2.0 * side * _SHORTEST) & ~np.isin(edges.keys, fine))
            marked, tried = long.copy(), found.at(edges.root[tested], edges.middle[tested])
            marked[tested] = _off(known, tried, edges.ends[tested], cut, _DIM * found.mean)
            fine = np.concatenate([fine, edges.keys[tested][~marked[tested]]])
            marked = edges.conforming(marked)
            if not marked.any() or len(pieces.root) + marked.sum() > most:
                break
            at = np.full(len(marked), -1)
            at[tested] = np.arange(len(tested))
            (rest,) = np.nonzero(marked & (at < 0))
            at[rest] = len(tested) + np.arange(len(rest))
            tried = tried.and_(found.at(edges.root[rest], edges.middle[rest]))
            pieces, known = pieces.divided(edges, marked), known.and_(tried, at[marked])
        complete, records = not marked.any(), lights.cache.count
    mesh = receivers.mesh_of[pieces.root][None]
    total = seams.filled(known.total[None], known.seen[None], known.position[None], mesh)[0].astype(np.float32)
    return VertexLight(
        receivers, pieces, light, total, known.indirect, known.direct, records, found.converged,
        complete,
    )  # fmt: skip


# ---- light -------------------------------------------------------------------------------------------------------------


def _off(known: _Known, tried: _Known, ends: np.ndarray, tolerance: float, floor: float) -> np.ndarray:
    """Return a mask (E,) of edges with a midpoint error above the tolerance or with a change of visibility.

    tried: light at midpoints. ends: (E, 2). floor: W/m², least light for relative errors.
    """
    first, second = ends.T
    off = np.abs(tried.total - 0.5 * (known.total[first] + known.total[second])).max(1)
    both = known.seen[first] & known.seen[second]
    wrong = tried.seen & both & (off > tolerance * np.maximum(tried.total.max(1), floor))
    return np.asarray(wrong | (known.seen[first] != known.seen[second]) | (both != tried.seen))


@dataclass(frozen=True, eq=False)
class _Known:
    """Light at N points: (N, 3) W/m² each, visibility, and position."""

    total: np.ndarray
    indirect: np.ndarray
    direct: np.ndarray
    seen: np.ndarray
    position: np.ndarray

    def and_(self, other: _Known, some: np.ndarray | slice = slice(None)) -> _Known:
        """Append the points `some` of another, all by default."""
        return _Known(**{name: np.concatenate([values, getattr(other, name)[some]]) for name, values in vars(self).items()})


class _Found:
    """Evaluator of light at points of the receivers' triangles."""

    def __init__(self, receivers: Receivers, lights: PlaceLight, light: Light, apart: float) -> None:
        self.receivers, self.lights, self.light, self.apart = receivers, lights, light, apart
        self.converged, self._sum, self._count = True, 0.0, 0

    @property
    def mean(self) -> float:
        """Mean of all light so far, W/m²."""
        return self._sum / max(self._count, 1)

    def at(self, root: np.ndarray, corner: np.ndarray) -> _Known:
        """Return the light at points of triangles `root` (N,) with barycentric coordinates `corner` (N, 3)."""
        scene, surfaces = self.receivers.scene, self.receivers.surfaces
        corners = surfaces.positions[surfaces.faces[root]].astype(float)
        size = np.linalg.norm(corners - corners.mean(1, keepdims=True), axis=2).max(1)
        # An equal share would be too far on a large triangle
        share = np.minimum(_INWARD, 10.0 * offset_of(scene) / np.maximum(size, 1e-30))[:, None]
        shares = corner + share * (1.0 / 3.0 - corner)
        order = np.argsort(along_a_way((corners * shares[..., None]).sum(1)), kind="stable")
        index = _tiles(len(root))
        there = index >= 0
        triangle = np.append(root[order], -1)[index]  # index -1 selects the appended entry
        u, v = (np.append(shares[order, k], 0.0)[index] for k in (1, 2))
        where = places(self.receivers, triangle, u, v)
        where = where.but(hidden(scene, where))
        irradiance, covered, converged = self.lights.gathered(where, self.apart)
        direct = self.lights.direct(where)
        self.converged &= converged
        pixel = np.empty(len(root), np.intp)  # of each point
        pixel[order[index[there]]] = np.flatnonzero(there)
        indirect, straight, position = (picture.reshape(-1, 3)[pixel] for picture in (irradiance, direct, where.position))
        seen = covered.ravel()[pixel]
        total = indirect + (straight if self.light == "all" else 0.0)
        self._sum, self._count = self._sum + float(total[seen].max(1).sum()), self._count + int(seen.sum())
        return _Known(total, indirect, straight, seen, position.astype(float))


def _tiles(count: int) -> np.ndarray:
    """Return the picture of point numbers (H, W), -1 for none; successive points share tiles."""
    rows = -(-max(count, 1) // (_TILE**2 * _COLUMNS))
    of_tiles = np.arange(rows * _COLUMNS * _TILE**2).reshape(rows, _COLUMNS, _TILE, _TILE)
    numbers = of_tiles.swapaxes(1, 2).reshape(rows * _TILE, -1)
    return np.where(numbers < count, numbers, -1)


# ---- the file ----------------------------------------------------------------------------------------------------------


def glb_of(made: VertexLight) -> bytes:
    """Return the bytes of the .glb of `VertexLight.save`.

    Materials are unlit: their colour times the vertex colours is the outgoing radiance, divided by the file's `strength`.
    """
    receivers, cut = made.receivers, made.cut
    scene, surfaces = receivers.scene, receivers.surfaces
    corners = surfaces.faces[cut.root]

    def blended(values: np.ndarray) -> np.ndarray:
        return np.asarray((values[corners].astype(float) * cut.corner[..., None]).sum(1))

    there = surfaces.at(cut.root, cut.corner[:, 1], cut.corner[:, 2])
    lit = made.irradiance / np.pi
    mesh_of = receivers.mesh_of[cut.root]
    glows = np.array([any(mesh.material.emission) for mesh in receivers.meshes], bool)[mesh_of]
    coloured = np.array([mesh.colors is not None for mesh in receivers.meshes], bool)[mesh_of]
    tint = np.where(coloured[:, None], blended(surfaces.albedo), 1.0)
    # Reflection only: light in the vertices and colours in the material; with emission, radiance in the vertices
    colours = np.where(glows[:, None], lit * there.albedo + there.emission, lit * tint)
    positions = blended(surfaces.positions)
    area = np.bincount(cut.faces.ravel(), np.repeat(triangle_areas(positions[cut.faces]), 3), len(positions))
    strength = limit_of(colours.max(1), area) or 1.0
    about = {"light": made.light, "unit": "W/(m² sr)", "strength": strength}
    glb = Glb({"irrsplat": about}, receivers.origin)
    glb.use("KHR_materials_unlit")
    normals = blended(surfaces.normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    uvs, opacity = blended(surfaces.uvs), blended(surfaces.opacity[:, None])
    for i, mesh in enumerate(receivers.meshes):
        (mine,) = np.nonzero(mesh_of == i)
        number = np.zeros(len(cut.root), np.int64)
        number[mine] = np.arange(len(mine))
        material = mesh.material
        emits = any(material.emission)
        base = (1.0, 1.0, 1.0) if emits or mesh.colors is not None else material.albedo
        entry = glb.material(material, base, receivers.is_two_sided(i))
        entry["extensions"] = {"KHR_materials_unlit": {}}
        entry["extras"] = {"strength": strength}
        colour = np.clip(colours[mine] / strength, 0.0, 1.0)
        if mesh.opacities is not None:
            colour = np.concatenate([colour, np.clip(opacity[mine], 0.0, 1.0)], axis=1)
            entry["pbrMetallicRoughness"]["baseColorFactor"][3] = 1.0
        attributes = {"POSITION": positions[mine], "NORMAL": normals[mine], "COLOR_0": colour}
        texture = material.albedo_texture
        if texture is not None and not emits:
            entry["pbrMetallicRoughness"]["baseColorTexture"] = glb.texture(texture)
            attributes["TEXCOORD_0"] = texture_coordinates(uvs[mine], texture)
        faces = number[cut.faces[receivers.mesh_of[cut.of] == i]]
        glb.mesh(scene.meshes[receivers.sources[i]].name, attributes, [(faces, glb.add("materials", entry))])
    glb.json["extensionsUsed"].remove("KHR_materials_specular")
    return glb.encoded(scene.cameras)
