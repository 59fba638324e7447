"""Scenes from trimesh's meshes and scenes, with the diffuse part of their materials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from irrsplat.core.color import clip_color, linear_from_srgb
from irrsplat.core.errors import InputError
from irrsplat.core.load_options import CREASE_ANGLE, LoadOptions
from irrsplat.core.vectors import box, near_origin
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.mesh_builder import build_meshes
from irrsplat.scene.io.objects.arrays import Up, completed, given_sky, smoothed
from irrsplat.scene.io.part import Part, corner_problem
from irrsplat.scene.model import AlphaMode, Camera, Image, Light, Material, Scene, Texture

if TYPE_CHECKING:
    import trimesh

_ALPHA: dict[str, AlphaMode] = {"MASK": "mask", "BLEND": "blend"}
_UNSET = [102.0 / 255.0] * 3  # default colour of a SimpleMaterial
_V_UP = (1.0, 0.0, 0.0, 0.0, -1.0, 1.0)  # trimesh's texture coordinates start at the lower left corner


def from_trimesh(
    source: trimesh.Trimesh | trimesh.Scene,
    lights: Sequence[Light] = (),
    cameras: Sequence[Camera] = (),
    *,
    sky: str | npt.ArrayLike | None = None,
    up: Up = "y",
    crease_angle: float = CREASE_ANGLE,
    name: str = "scene",
) -> Scene:
    """Return the Scene of a trimesh.Trimesh or trimesh.Scene, with lights and sky, which trimesh does not have.

    Materials: base colour or diffuse colour with its texture, emission, alpha; vertex and face colours are sRGB. Lengths are
    converted from `units` to metres. Missing normals are computed by `crease_angle` (degrees). The camera of a trimesh.Scene
    follows those in `cameras`. Other arguments, defaults and errors are those of `make_scene`; omissions are in Scene.notices.
    """
    LoadOptions(crease_angle=crease_angle)  # for its check
    reader = _Reader(name)
    parts = [smoothed(part, crease_angle) for part in reader.parts(source)]
    cameras = (*cameras, *reader.cameras(source))
    origin = near_origin(*_bounds(parts))
    meshes, dropped = [], 0
    for built in build_meshes(parts, origin):
        meshes.append(built.mesh_or_error(Path(built.part.name or name)))
        dropped += built.dropped
    return completed(meshes, lights, cameras, given_sky(sky), up, name, reader.notices, dropped, origin)


def _bounds(parts: Sequence[Part]) -> np.ndarray:
    """Return (2, 3) the least and the greatest corner of the parts in world space; zeros for none."""
    places = [part.positions @ part.matrix[:3, :3].T + part.matrix[:3, 3] for part in parts if part.matrix is not None]
    boxes = [box(place) for place in places if len(place)]
    return box(np.concatenate(boxes)) if boxes else np.zeros((2, 3))


@dataclass
class _Reader:
    """Conversion of trimesh's objects; notices: one line each on omissions."""

    name: str
    notices: list[str] = field(default_factory=list)
    _images: dict[int, Image] = field(default_factory=dict)  # by the id of PIL's, so that surfaces share images

    def parts(self, source: Any) -> Iterator[Part]:
        """Yield the triangles of a mesh or scene, with their world matrices."""
        if hasattr(source, "geometry") and hasattr(source, "graph"):
            for node in source.graph.nodes_geometry:
                matrix, name = source.graph[node]
                geometry = source.geometry[name]
                if hasattr(geometry, "faces"):
                    yield from self._of_mesh(geometry, np.asarray(matrix, float), str(node))
                else:
                    self.notices.append(f"{self.name}: '{node}' is no mesh of triangles, and is left out")
        elif hasattr(source, "faces") and hasattr(source, "visual"):
            yield from self._of_mesh(source, np.eye(4), str(source.metadata.get("name") or ""))
        else:
            raise InputError(f"from_trimesh takes a trimesh.Trimesh or a trimesh.Scene, not {type(source).__name__}")

    def cameras(self, source: Any) -> Iterator[Camera]:
        """Yield the camera of a scene that has one."""
        if not getattr(source, "has_camera", False):
            return
        matrix, scale = np.asarray(source.camera_transform, float), self._metres(source)
        eye, backward, up = scale * matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
        yield Camera(_three(eye), _three(eye - backward), _three(up), float(source.camera.fov[1]))

    def _metres(self, source: Any) -> float:
        """Return the length of a mesh's or scene's unit; 1 for none or an unknown one."""
        units = getattr(source, "units", None)
        if units is None:
            return 1.0
        import trimesh

        try:
            return float(trimesh.units.unit_conversion(units, "meters"))
        except Exception:  # trimesh raises the exceptions of its unit parser
            notice = f"{self.name}: its unit '{units}' is unknown, and taken for metres"
            if notice not in self.notices:
                self.notices.append(notice)
            return 1.0

    def _of_mesh(self, mesh: Any, matrix: np.ndarray, name: str) -> Iterator[Part]:
        positions, corners = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
        if not (np.abs(positions) <= GREATEST).all():
            raise InputError(f"the vertices of '{name}' must be finite numbers, at most {GREATEST:g}")
        if problem := corner_problem(corners, len(positions)):
            raise InputError(problem, name)
        matrix = matrix.copy()
        matrix[:3] *= self._metres(mesh)
        visual = mesh.visual
        make = partial(Part, matrix=matrix, name=name)
        kind = getattr(visual, "kind", None)
        if kind == "texture":
            uvs = None if visual.uv is None or len(visual.uv) != len(positions) else np.tile(np.asarray(visual.uv, float), 2)
            numbers = getattr(visual, "face_materials", None)
            yield from self._textured(make, visual.material, numbers, positions, corners, uvs)
        elif kind == "face":
            colors = np.repeat(linear_from_srgb(np.asarray(visual.face_colors)[:, :3] / 255.0), 3, axis=0)
            yield make(positions[corners].reshape(-1, 3), np.arange(corners.size).reshape(-1, 3), colors=colors)
        elif kind == "vertex":
            yield make(positions, corners, colors=linear_from_srgb(np.asarray(visual.vertex_colors)[:, :3] / 255.0))
        else:
            yield make(positions, corners)

    def _textured(
        self, make: Any, material: Any, numbers: Any, positions: np.ndarray, corners: np.ndarray, uvs: np.ndarray | None
    ) -> Iterator[Part]:
        """Yield the parts of a mesh, one for each of its materials."""
        several = getattr(material, "materials", None)
        if several is None or numbers is None or len(numbers) != len(corners):
            first = material if several is None else (several[0] if len(several) else None)
            yield make(positions, corners, material=self._material(first, uvs is not None), uvs=uvs)
            return
        for number in np.unique(numbers):
            own_material = self._material(several[number], uvs is not None)
            yield make(positions, corners[np.asarray(numbers) == number], material=own_material, uvs=uvs)

    def _material(self, given: Any, has_uvs: bool) -> Material:
        """Return the diffuse part of a PBRMaterial or SimpleMaterial."""
        if given is None:
            return Material()
        ke = getattr(given, "kwargs", {}).get("ke")  # of an OBJ's material, which to_pbr drops
        pbr = given.to_pbr() if hasattr(given, "to_pbr") else given
        red, green, blue, alpha = _unit(getattr(pbr, "baseColorFactor", None))
        if pbr is not given and pbr.baseColorTexture is not None and _unit(given.diffuse)[:3].tolist() in (_UNSET, [0.0] * 3):
            red = green = blue = 1.0  # a picture has no additional colour; in an OBJ, 0 0 0 means that as well
        emission = getattr(pbr, "emissiveFactor", None)
        if emission is None:
            emission = (0.0, 0.0, 0.0) if ke is None else ke
        textures = {
            key: self._texture(getattr(pbr, key, None)) for key in ("baseColorTexture", "emissiveTexture", "normalTexture")
        }
        if not has_uvs:
            textures = dict.fromkeys(textures)
        mode = _ALPHA.get(str(getattr(pbr, "alphaMode", None) or "OPAQUE").upper(), "opaque")
        cutoff = getattr(pbr, "alphaCutoff", None)
        return Material(
            albedo=clip_color((red, green, blue)),
            emission=_three(np.maximum(np.asarray(emission, float), 0.0)),
            albedo_texture=textures["baseColorTexture"],
            emission_texture=textures["emissiveTexture"],
            normal_texture=textures["normalTexture"],
            opacity=float(np.clip(alpha, 0.0, 1.0)),
            alpha_mode=mode,
            alpha_cutoff=0.5 if cutoff is None else float(cutoff),
        )

    def _texture(self, picture: Any) -> Texture | None:
        """Return a PIL image as a texture."""
        if picture is None:
            return None
        if id(picture) not in self._images:
            self._images[id(picture)] = Image(np.asarray(picture.convert("RGBA"), np.uint8))
        return Texture(self._images[id(picture)], transform=_V_UP)


def _unit(color: Any) -> np.ndarray:
    """Return (4,) red, green, blue and alpha in 0..1, from numbers in 0..1 or bytes; white for None."""
    if color is None:
        return np.ones(4)
    values = np.asarray(color)
    values = values / 255.0 if values.dtype.kind in "iu" else values.astype(float)
    return np.append(values[:3], values[3] if len(values) > 3 else 1.0)


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z
