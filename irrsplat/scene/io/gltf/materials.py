"""The diffuse part of glTF materials: colours, textures, emission and alpha; metals reflect their base colour."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from irrsplat.core.color import clip_color
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import Vector, vector
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.gltf.document import READ_ERRORS, Damaged, Document, Missing, extension, number, numbers, printable
from irrsplat.scene.io.gltf.packed import plain_view
from irrsplat.scene.io.images import read_images
from irrsplat.scene.model import AlphaMode, Image, Material, Texture, Wrap

_WRAPS: dict[object, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_NEAREST = 9728
_UNLIT = "KHR_materials_unlit"
_IMAGE_FORMATS = ("EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu", "MSFT_texture_dds")  # in order of preference


@dataclass(frozen=True)
class Surface:
    """A material for a primitive.

    factor: base colour and alpha, (4,) linear, multiplied by vertex colours. uv_sets: the TEXCOORD_n of the mesh's two sets of
    coordinates.
    """

    material: Material
    factor: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    uv_sets: tuple[int, int] = (0, 1)


@dataclass
class Materials:
    """The materials of a document, each read once, so that equal ones are identical."""

    document: Document
    _surfaces: dict[object, Surface] = field(default_factory=dict)
    _images: dict[object, Image | Exception | None] = field(default_factory=dict)  # None: its error has been reported

    def surface(self, index: object) -> Surface:
        """Return the material at `index`; grey with a reflectance of 0.5 for None and for a damaged one."""
        index = index if index is None or isinstance(index, int) else repr(index)  # other JSON values, as a key
        if index not in self._surfaces:
            self._surfaces[index] = Surface(Material(double_sided=False))
            if index is not None:
                with self.document.part(f"material {index}"):
                    self._surfaces[index] = self._read(self.document.entry("materials", index))
        return self._surfaces[index]

    def read_images(self, indices: Iterable[object]) -> None:
        """Read the images of the materials at these indices in parallel, in the first format of each."""
        sources: dict[object, None] = {}
        for index in dict.fromkeys(index for index in indices if isinstance(index, int)):
            with suppress(*READ_ERRORS):
                for info in filter(None, _texture_infos(self.document.entry("materials", index))):
                    sources |= dict.fromkeys(_sources(self.document.entry("textures", info.get("index")))[:1])
        self._read_sources(sources)

    def _read_sources(self, sources: Iterable[object]) -> None:
        """Read the images at these indices into `_images`, unless they are there."""
        encoded: dict[object, tuple[bytes, str]] = {}
        for source in sources:
            if source not in self._images:
                try:
                    encoded[source] = self._encoded(source)
                except (Damaged, InputError, MemoryError) as error:
                    self._images[source] = error
        self._images |= zip(encoded, read_images(list(encoded.values())), strict=True)

    def mesh_material(self, surface: Surface, colors: np.ndarray | None) -> Material:
        """Return the material of a mesh with vertex colours (V, 3 or 4), linear, or None.

        It is opaque if alpha is nowhere below 1.
        """
        material = surface.material
        seen_through = colors is not None and colors.shape[1] == 4 and not (colors[:, 3] >= 1.0).all()
        if material.alpha_mode == "opaque" or material.opacity < 1.0 or seen_through:
            return material
        texture = material.albedo_texture
        return replace(material, alpha_mode="opaque") if texture is None or texture.image.alpha_range[0] == 1.0 else material

    def _read(self, entry: Mapping[str, Any]) -> Surface:
        base, factor, _ = _base(entry)
        r, g, b, alpha = numbers(base, factor, (1.0, 1.0, 1.0, 1.0))
        unlit = extension(entry, _UNLIT) is not None
        infos = _texture_infos(entry)
        sets = [_uv_set(info) for info in infos if info is not None]
        uv_sets = _two_sets(sets)
        if any(used not in uv_sets for used in sets):
            self.document.unshown["more than two sets of texture coordinates in a material"] = None
        color, emission, normal = (self._texture(info, uv_sets) for info in infos)

        mode = str(entry.get("alphaMode", "OPAQUE")).lower()
        alpha_mode: AlphaMode = mode if mode in get_args(AlphaMode) else "opaque"  # type: ignore[assignment]  # mypy can't narrow
        material = Material(
            albedo=clip_color((r, g, b)),
            # most of a texture of emission is black: the factor alone would light the whole surface
            emission=(0.0, 0.0, 0.0) if infos[1] and emission is None else _emission(entry, self.document.per_unit),
            albedo_texture=color,
            emission_texture=emission,
            normal_texture=normal,
            normal_scale=number(infos[2], "scale", 1.0) if normal is not None and infos[2] is not None else 1.0,
            opacity=min(max(alpha, 0.0), 1.0),
            alpha_mode=alpha_mode,
            alpha_cutoff=number(entry, "alphaCutoff", 0.5),
            transmission=0.0 if unlit else self._transmission(entry, base),
            double_sided=entry.get("doubleSided") is True,
        )
        if unlit:
            material = replace(material, albedo=(0.0, 0.0, 0.0), emission=material.albedo, emission_texture=color, unlit=True)
            if material.alpha_mode == "opaque":
                material = replace(material, albedo_texture=None)  # otherwise its alpha matters
        return Surface(material, (r, g, b, alpha), uv_sets)

    def _transmission(self, entry: Mapping[str, Any], base: Mapping[str, Any]) -> float:
        """Return the share of transmitted light: the factor without metal, times the mean of its texture's red."""
        transmission_entry = extension(entry, "KHR_materials_transmission")
        if transmission_entry is None:
            return 0.0
        share = number(transmission_entry, "transmissionFactor", 0.0)
        if "metallicRoughnessTexture" not in base:
            share *= 1.0 - number(base, "metallicFactor", 1.0)
        texture = self._texture(transmission_entry.get("transmissionTexture"), (0, 1)) if share > 0.0 else None
        if texture is not None:
            share *= float(texture.image.pixels[..., 0].mean()) / 255.0
            self.document.unshown["where a transmission texture varies (its mean is shown)"] = None
        return min(max(share, 0.0), 1.0)

    def _texture(self, info: object, uv_sets: tuple[int, int]) -> Texture | None:
        """Return the texture of a textureInfo; None for a missing or damaged one."""
        if not isinstance(info, dict):
            return None
        with self.document.part(f"texture {info.get('index')}"):
            entry = self.document.entry("textures", info.get("index"))
            image = self._image(entry)
            if image is None:
                return None
            sampler: Mapping[str, Any] = self.document.entry("samplers", entry["sampler"]) if "sampler" in entry else {}
            moved = extension(info, "KHR_texture_transform") or {}
            angle, (sx, sy) = number(moved, "rotation", 0.0), numbers(moved, "scale", (1.0, 1.0))
            x, y = numbers(moved, "offset", (0.0, 0.0))
            cosine, sine = math.cos(angle), math.sin(angle)
            used = _uv_set(info)
            return Texture(
                image,
                uv_set=uv_sets.index(used) if used in uv_sets else 0,
                # counter-clockwise in the image, whose v runs downward; the scale first
                transform=(cosine * sx, sine * sy, x, -sine * sx, cosine * sy, y),
                wrap=(_WRAPS.get(sampler.get("wrapS"), "repeat"), _WRAPS.get(sampler.get("wrapT"), "repeat")),
                nearest=sampler.get("magFilter") == _NEAREST,
            )
        return None

    def _image(self, texture: Mapping[str, Any]) -> Image | None:
        """Return the image of a texture, in the first readable format; None, recorded as lost, for unreadable ones."""
        sources = _sources(texture)
        for index in sources:
            self._read_sources([index])
            image = self._images[index]
            if isinstance(image, Image):
                return image
        for index in sources:
            failure, self._images[index] = self._images[index], None
            if isinstance(failure, Missing):
                self.document.absent[failure.name] = None
            elif failure is not None:
                self.document.leave_out(f"image {index}", str(failure) or "memory does not suffice")
        if not sources:
            raise Damaged("it has no image")
        return None

    def _encoded(self, index: object) -> tuple[bytes, str]:
        """Return the bytes of an image's file, and its name for messages; raise Damaged."""
        entry = self.document.entry("images", index)
        if "bufferView" in entry:
            data, name = plain_view(self.document, entry["bufferView"])[0].tobytes(), entry.get("name") or f"image {index}"
        else:
            data, name = self.document.resource(entry.get("uri"))
            name = entry.get("name") or f"image {index}" if name == "data" else name
        return data, printable(name)


def _base(entry: Mapping[str, Any]) -> tuple[Mapping[str, Any], str, str]:
    """Return the object with the base colour of a material, and the keys of its factor and its texture."""
    found = entry.get("pbrMetallicRoughness")
    metal = found if isinstance(found, dict) else {}
    gloss = extension(entry, "KHR_materials_pbrSpecularGlossiness")
    # most files have both; the diffuse colour alone is black for metals
    if gloss is not None and "baseColorFactor" not in metal and "baseColorTexture" not in metal:
        return gloss, "diffuseFactor", "diffuseTexture"
    return metal, "baseColorFactor", "baseColorTexture"


def _texture_infos(entry: Mapping[str, Any]) -> list[dict[str, Any] | None]:
    """Return the textureInfos of a material for colour, emission and normals; None for a missing or invisible one."""
    base, _, texture = _base(entry)
    unlit = extension(entry, _UNLIT) is not None
    emission = entry.get("emissiveTexture") if not unlit and any(_emission(entry)) else None
    infos = base.get(texture), emission, None if unlit else entry.get("normalTexture")
    return [info if isinstance(info, dict) else None for info in infos]


def _emission(entry: Mapping[str, Any], per_unit: float = 1.0) -> Vector:
    """Return the emission of a material without its texture. per_unit: see Document."""
    strength = per_unit * number(extension(entry, "KHR_materials_emissive_strength") or {}, "emissiveStrength", 1.0)
    factor = numbers(entry, "emissiveFactor", (0.0, 0.0, 0.0))
    return vector([min(max(0.0, strength * value), GREATEST) for value in factor])


def _sources(texture: Mapping[str, Any]) -> list[object]:
    """Return the images of a texture in different formats, best first."""
    sources = [found["source"] for name in _IMAGE_FORMATS if (found := extension(texture, name)) and "source" in found]
    return sources + ([texture["source"]] if "source" in texture else [])


def _uv_set(info: Mapping[str, Any]) -> int:
    """Return the n of a textureInfo's TEXCOORD_n."""
    moved = (extension(info, "KHR_texture_transform") or {}).get("texCoord")
    used = moved if moved is not None else info.get("texCoord", 0)
    return used if isinstance(used, int) and used >= 0 else 0


def _two_sets(used: list[int]) -> tuple[int, int]:
    """Return the two sets of coordinates for a mesh: 0 and 1 if these suffice."""
    if max(used, default=0) <= 1:
        return 0, 1
    first, *more = sorted(set(used))
    return (first, more[0]) if more else (first, 0 if first else 1)
