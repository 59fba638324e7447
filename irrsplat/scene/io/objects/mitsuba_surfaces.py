"""Mitsuba's shapes as meshes, and its BSDFs and area emitters as materials."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.color import clip_color, linear_from_srgb, srgb
from irrsplat.core.vectors import unit
from irrsplat.scene.io.mesh_builder import build_meshes, welded
from irrsplat.scene.io.part import Part
from irrsplat.scene.model import Image, Material, Mesh, Texture

_DIFFUSE = ("reflectance", "diffuse_reflectance", "base_color")  # names of the diffuse part of BSDFs
_CLEAR = ("SmoothDielectric", "ThinDielectric", "RoughDielectric")
_DIFFUSE_BSDF, _MASK, _TWO_SIDED = "SmoothDiffuse", "MaskBSDF", "TwoSidedBRDF"
_BACKING = 5e-4  # of the scene's diagonal: distance of the black backing behind an open emitter
_ROUND = 64  # corners of a circle


@dataclass
class Remarks:
    """Notices on differences to Mitsuba, without duplicates."""

    name: str
    lines: list[str] = field(default_factory=list)

    def add(self, words: str) -> None:
        """Add a remark."""
        line = f"{self.name}: {words}"
        if line not in self.lines:
            self.lines.append(line)


def values_of(mitsuba: Any, thing: Any) -> dict[str, Any]:
    """Return the parameters of a Mitsuba object by name."""
    parameters = mitsuba.traverse(thing)
    return {key: parameters[key] for key in parameters.keys()}  # noqa: SIM118  # it is no dict


def numbers(value: Any) -> np.ndarray:
    """Return (N,) float64 of a number, vector or array of any variant."""
    return np.array(value, float).reshape(-1)


def three(values: np.ndarray) -> tuple[float, float, float]:
    """Return three numbers as a tuple."""
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


def color(values: Mapping[str, Any], key: str) -> tuple[float, float, float] | None:
    """Return the uniform colour called `key`, at least 0; None for other values."""
    if f"{key}.value" not in values:
        return None
    found = np.maximum(numbers(values[f"{key}.value"]), 0.0)
    return three(np.broadcast_to(found, 3)) if found.size in (1, 3) else None


class Surfaces:
    """Conversion of shapes; differences to Mitsuba go to `remarks`."""

    def __init__(self, mitsuba: Any, remarks: Remarks) -> None:
        self.mitsuba, self.remarks = mitsuba, remarks
        self._images: dict[bytes, Image] = {}

    def meshes(self, shapes: Iterable[Any], diagonal: float) -> tuple[list[Mesh], int]:
        """Return the meshes of the shapes, and the number of dropped degenerate triangles. diagonal: of the whole scene.

        They are sorted by name and content, because Mitsuba's order varies from load to load, and records must not.
        """
        found: list[list[Mesh]] = []
        dropped = 0
        for shape in shapes:
            part = self._part(shape)
            if part is None:
                continue
            material = self._material(shape)
            (built,) = build_meshes([replace(part, material=material)])
            mesh = built.mesh_or_error(Path(part.name or self.remarks.name))
            dropped += built.dropped
            lit = any(material.emission) and len(mesh.faces)
            found.append([mesh, *(self._backing(shape, mesh, diagonal) if lit else [])])
        found.sort(key=lambda meshes: _content(meshes[0]))
        return [mesh for meshes in found for mesh in meshes], dropped

    # ---- shapes ------------------------------------------------------------------------------------------------------

    def _part(self, shape: Any) -> Part | None:
        """Return the triangles of a shape in world space; None if unsupported."""
        kind, name = shape.class_name(), str(shape.id())
        name = "" if name.startswith(("__", "object_")) else name
        if shape.is_mesh() and hasattr(shape, "vertex_positions_buffer"):
            return replace(_of_mesh(shape), name=name)
        values = values_of(self.mitsuba, shape)
        canonical = {"Sphere": _sphere, "Disk": _disk, "Cylinder": _cylinder, "Rectangle": _rectangle}.get(kind)
        if canonical is None or "to_world" not in values:
            self.remarks.add(f"the shape {kind} is not supported, and is left out")
            return None
        return replace(canonical(), name=name, matrix=np.array(values["to_world"].matrix, float).reshape(4, 4))

    def _backing(self, shape: Any, mesh: Mesh, diagonal: float) -> list[Mesh]:
        """Return a black backing for an emitter, because Mitsuba's area emitters do not light their back.

        It consists of the same triangles a little behind, and walls along the rim. A closed emitter with outward front needs
        none.
        """
        corners = mesh.positions[mesh.faces].astype(float)
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        point = self._sample(shape)
        nearest = int(np.argmin(((corners.mean(1) - point[0]) ** 2).sum(1)))
        outward = float(area[nearest] @ point[1]) >= 0.0
        if mesh.closed and outward:
            return []
        places, weld = welded(mesh.positions)
        front, faces = mesh.positions[places].astype(float), weld[mesh.faces]
        normals = np.zeros((len(front), 3))
        for corner in range(3):
            np.add.at(normals, faces[:, corner], area)
        behind = front - (_BACKING if outward else -_BACKING) * diagonal * unit(normals)
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
        a, b = edges[first[count == 1]].T  # of the rim
        back = len(front)
        corners_of = np.concatenate([faces + back, np.stack([a, a + back, b], -1), np.stack([b, a + back, b + back], -1)])
        part = Part(
            np.concatenate([front, behind]), corners_of, material=Material((0.0, 0.0, 0.0)), name=f"{mesh.name} back".strip()
        )
        return [built.mesh_or_error(Path(part.name)) for built in build_meshes([part])]

    def _sample(self, shape: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return a point of a shape, and its normal there."""
        found = shape.sample_position(self.mitsuba.Float(0.0), self.mitsuba.Point2f(0.4, 0.3))
        return numbers(found.p), numbers(found.n)

    # ---- materials ---------------------------------------------------------------------------------------------------

    def _material(self, shape: Any) -> Material:
        """Return a shape's BSDF and emission."""
        bsdf = shape.bsdf()
        material = Material() if bsdf is None else self._reflection(bsdf)
        if not shape.is_emitter():
            return material
        emitter = shape.emitter()
        kind, values = emitter.class_name(), values_of(self.mitsuba, emitter)
        if kind != "AreaLight":
            self.remarks.add(f"the emitter {kind} is not supported, and is left out")
            return material
        radiance = color(values, "radiance")
        if radiance is not None:
            return replace(material, emission=radiance)
        if "radiance.data" in values:
            picture = _picture(values["radiance.data"], "radiance", str(emitter))
            brightest = float(picture.max()) or 1.0
            texture = self._texture(picture / brightest, values.get("radiance.to_uv"))
            return replace(material, emission=(brightest,) * 3, emission_texture=texture)
        self.remarks.add("the radiance of an area emitter is neither a colour nor a bitmap; using 1 1 1")
        return replace(material, emission=(1.0, 1.0, 1.0))

    def _reflection(self, bsdf: Any) -> Material:
        """Return the diffuse part of a BSDF."""
        kind, values, text = bsdf.class_name(), values_of(self.mitsuba, bsdf), str(bsdf)
        if kind in _CLEAR:
            self.remarks.add(f"the BSDF {kind} is shown as clear glass, without refraction and reflection")
            return Material(albedo=(1.0, 1.0, 1.0), transmission=1.0)
        inner = _innermost(kind, text)
        if inner != _DIFFUSE_BSDF:
            self.remarks.add(f"of the BSDF {inner} only diffuse reflection is shown")
        if any(key.startswith("brdf_1.") for key in values):
            self.remarks.add("a two-sided BSDF with two sides that differ has the front's on both")
        material = self._diffuse(values, inner, text)
        if "opacity.data" in values:
            return self._cut_out(material, _picture(values["opacity.data"], "opacity", text)[..., 0], values.get("opacity.to_uv"))
        if "opacity.value" in values:
            opacity = float(np.clip(numbers(values["opacity.value"]).mean(), 0.0, 1.0))
            material = replace(material, opacity=opacity, alpha_mode="blend" if opacity < 1.0 else "opaque")
        return material

    def _cut_out(self, material: Material, opacity: np.ndarray, to_uv: Any) -> Material:
        """Return the material with the opacities (H, W) of a mask, in the alpha of its texture."""
        below, given = material.albedo_texture, self._texture(np.repeat(opacity[..., None], 3, axis=2), to_uv)
        if below is not None and below.transform != given.transform:
            self.remarks.add("a mask with another mapping than the texture below it is shown by its mean")
            mean = float(opacity.mean())
            return replace(material, opacity=mean, alpha_mode="blend" if mean < 1.0 else "opaque")
        pixels = np.full((1, 1, 4), 255, np.uint8) if below is None else below.image.pixels
        height, width = np.maximum(pixels.shape[:2], opacity.shape)
        rows, columns = np.arange(height), np.arange(width)[None]
        pixels = pixels[(rows * len(pixels) // height)[:, None], columns * pixels.shape[1] // width].copy()
        alpha = opacity[(rows * len(opacity) // height)[:, None], columns * opacity.shape[1] // width]
        pixels[..., 3] = np.round(255.0 * np.clip(alpha, 0.0, 1.0))
        sharp = np.isin(pixels[..., 3], (0, 255)).all()
        texture = replace(given if below is None else below, image=self._image(pixels))
        return replace(material, albedo_texture=texture, alpha_mode="mask" if sharp else "blend")

    def _diffuse(self, values: Mapping[str, Any], kind: str, text: str) -> Material:
        for key in values:
            stem, _, last = key.rpartition(".")
            if stem.rpartition(".")[2] not in _DIFFUSE or last not in ("value", "data"):
                continue
            if last == "value":
                found = color(values, stem)
                if found is not None:
                    return Material(albedo=clip_color(found))
            else:
                picture = np.clip(_picture(values[key], stem.rpartition(".")[2], text), 0.0, 1.0)
                return Material((1.0, 1.0, 1.0), albedo_texture=self._texture(picture, values.get(f"{stem}.to_uv")))
        board = next((key.removesuffix("color0.value") for key in values if key.endswith("reflectance.color0.value")), None)
        if board is not None:
            first, second = color(values, f"{board}color0"), color(values, f"{board}color1")
            if first is not None and second is not None:
                picture = np.array([[first, second], [second, first]])
                texture = self._texture(np.clip(picture, 0.0, 1.0), values.get(f"{board}to_uv"), nearest=True)
                return Material((1.0, 1.0, 1.0), albedo_texture=texture)
        self.remarks.add(f"the BSDF {kind} has no readable diffuse colour; using a reflectance of 0.5")
        return Material()

    def _texture(self, picture: np.ndarray, to_uv: Any, nearest: bool = False) -> Texture:
        """Return a texture of linear colours (H, W, 3) in 0..1; coordinates start at the image's first row in both programs.

        Mitsuba does not expose filter and wrap mode: the texture is interpolated and repeated.
        """
        data = np.round(255.0 * srgb(picture)).astype(np.uint8)
        pixels = np.dstack([data, np.full(data.shape[:2], 255, np.uint8)])
        matrix = np.eye(3) if to_uv is None else np.array(to_uv.matrix, float).reshape(3, 3)
        a, b, c, d, e, f = matrix[:2].reshape(-1).tolist()
        return Texture(self._image(pixels), transform=(a, b, c, d, e, f), nearest=nearest)

    def _image(self, pixels: np.ndarray) -> Image:
        """Return the image of these pixels, one object for equal pixels."""
        return self._images.setdefault(repr(pixels.shape).encode() + pixels.tobytes(), Image(pixels))


def _innermost(kind: str, text: str) -> str:
    """Return the class of the BSDF within masks, and of the front of two-sided ones, from Mitsuba's printed form."""
    for outer, inner in ((_MASK, r"nested_bsdf = (\w+)"), (_TWO_SIDED, r"brdf\[0\] = (\w+)")):
        if kind == outer and (found := re.search(inner, text)):
            kind = found[1]
    return kind


def _picture(data: Any, name: str, text: str) -> np.ndarray:
    """Return (H, W, 3) linear values of a bitmap's data, grey or colour. name, text: of the bitmap in Mitsuba's printed form.

    Mitsuba 3.9 keeps integers as in the file, in sRGB unless the bitmap is raw; other versions keep linear values.
    """
    array = np.array(data)
    if array.dtype.kind == "u":
        raw = re.search(rf"{name} = BitmapTexture\[.*?raw = (\d)", text, re.DOTALL)
        array = array / np.iinfo(array.dtype).max
        array = array if raw is not None and raw[1] == "1" else linear_from_srgb(array)
    array = array.astype(float)
    array = array[..., None] if array.ndim == 2 else array
    return array[..., :3] if array.shape[2] >= 3 else np.repeat(array[..., :1], 3, axis=2)


# ---- geometry --------------------------------------------------------------------------------------------------------------


def _content(mesh: Mesh) -> tuple[str, str]:
    """Return a name and a hash of the triangles, which identify a shape across loads."""
    return mesh.name, sha256(mesh.positions.tobytes() + mesh.faces.tobytes()).hexdigest()


def _of_mesh(shape: Any) -> Part:
    """Return the triangles of a mesh, which are in world space in Mitsuba."""
    positions = np.array(shape.vertex_positions_buffer(), float).reshape(-1, 3)
    corners = np.array(shape.faces_buffer(), np.int64).reshape(-1, 3)
    normals = np.array(shape.vertex_normals_buffer(), float).reshape(-1, 3) if shape.has_vertex_normals() else None
    uvs = np.array(shape.vertex_texcoords_buffer(), float).reshape(-1, 2) if shape.has_vertex_texcoords() else None
    usable = normals is not None and len(normals) == len(positions) and bool(normals.any())
    return Part(
        positions,
        corners,
        normals=normals if usable else None,
        uvs=None if uvs is None or len(uvs) != len(positions) else np.tile(uvs, 2),
    )


def _sphere() -> Part:
    """Return the unit sphere about 0 0 0, scaled to a sphere's exact area."""
    rows, columns = _ROUND // 2, _ROUND
    theta, phi = np.pi * np.arange(rows + 1) / rows, 2.0 * np.pi * np.arange(columns + 1) / columns
    sine, cosine = np.sin(theta)[:, None], np.repeat(np.cos(theta)[:, None], columns + 1, axis=1)
    around = np.where(np.arange(columns + 1) == columns, 0.0, phi)  # both sides of the seam coincide exactly
    sine[[0, -1]] = 0.0
    points = np.stack([sine * np.cos(around), sine * np.sin(around), cosine], -1).reshape(-1, 3)
    u, v = np.meshgrid(phi / (2.0 * np.pi), theta / np.pi)
    corners = _grid(rows, columns)
    half = len(corners) // 2
    corners = np.concatenate(
        [corners[: half - columns], corners[half + columns :]]
    )  # without triangles with two corners at a pole
    return Part(
        _of_area(points, corners, 4.0 * np.pi), corners, normals=points, uvs=np.tile(np.stack([u, v], -1).reshape(-1, 2), 2)
    )


def _disk() -> Part:
    """Return the unit disk in z = 0, facing +z, scaled to the exact area; its coordinates are radius and angle, as in Mitsuba."""
    turn = np.arange(_ROUND + 1) / _ROUND
    phi = 2.0 * np.pi * (np.arange(_ROUND + 1) % _ROUND) / _ROUND
    rim = np.stack([np.cos(phi), np.sin(phi), np.zeros(_ROUND + 1)], -1)
    points = np.concatenate([np.zeros((_ROUND + 1, 3)), rim])
    uvs = np.stack([np.repeat([0.0, 1.0], _ROUND + 1), np.tile(turn, 2)], -1)
    corners = _grid(1, _ROUND)[:_ROUND]  # the others have two corners in the middle
    return Part(
        _of_area(points, corners, np.pi), corners, normals=np.tile([0.0, 0.0, 1.0], (len(points), 1)), uvs=np.tile(uvs, 2)
    )


def _cylinder() -> Part:
    """Return the tube of radius 1 about the z axis from 0 to 1, facing outward, scaled to the exact area."""
    phi = 2.0 * np.pi * (np.arange(_ROUND + 1) % _ROUND) / _ROUND
    ring = np.stack([np.cos(phi), np.sin(phi), np.zeros(_ROUND + 1)], -1)
    wide = (np.pi / _ROUND) / np.sin(np.pi / _ROUND)
    points = np.concatenate([wide * ring + [0.0, 0.0, 1.0], wide * ring])
    return Part(points, _grid(1, _ROUND), normals=np.concatenate([ring, ring]))


def _rectangle() -> Part:
    """Return the square from −1 to 1 in z = 0, facing +z."""
    points = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    uvs = np.tile(0.5 + 0.5 * points[:, :2], 2)
    return Part(points, np.array([[0, 1, 2], [0, 2, 3]]), normals=np.tile([0.0, 0.0, 1.0], (4, 1)), uvs=uvs)


def _grid(rows: int, columns: int) -> np.ndarray:
    """Return (F, 3) the triangles of a grid of (rows + 1)·(columns + 1) points, rows downward, columns to the left."""
    row, column = (index.reshape(-1) for index in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    a = row * (columns + 1) + column
    b, c, d = a + 1, a + columns + 1, a + columns + 2
    return np.concatenate([np.stack([a, c, d], -1), np.stack([a, d, b], -1)])


def _of_area(points: np.ndarray, corners: np.ndarray, area: float) -> np.ndarray:
    """Return the points, scaled so that the triangles have this total area."""
    a, b, c = (points[corners[:, i]] for i in range(3))
    found = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    scaled: np.ndarray = points * np.sqrt(area / found)
    return scaled
