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
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.gltf.document import READ_ERRORS, Damaged, Document, Missing, extension, number, numbers, printable
from irrsplat.scene.io.gltf.packed import plain_view
from irrsplat.scene.io.images import read_image, read_images
from irrsplat.scene.model import AlphaMode, Image, Material, Texture, Wrap

_WRAPS: dict[object, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_NEAREST = 9728
_Color = tuple[float, float, float]
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
    _images: dict[object, Image | None] = field(default_factory=dict)
    _clear: dict[int, bool] = field(default_factory=dict)  # True for images whose alpha is 1 everywhere, by id

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
        """Read the images of the materials at these indices in parallel; errors are reported when a material uses them."""
        sources: dict[object, None] = {}
        for index in dict.fromkeys(index for index in indices if isinstance(index, int)):
            with suppress(*READ_ERRORS):
                for info in _Pictures.of(self.document.entry("materials", index)).all:
                    sources |= dict.fromkeys(_sources(self.document.entry("textures", info.get("index")))[:1])
        found: dict[object, tuple[bytes, str]] = {}
        for source in sources:
            with suppress(*READ_ERRORS):
                found[source] = self.encoded(source)
        for source, image in zip(found, read_images(list(found.values())), strict=True):
            if isinstance(image, Image):
                self._images[source] = image

    def mesh_material(self, surface: Surface, colors: np.ndarray | None) -> Material:
        """Return the material of a mesh with vertex colours (V, 3 or 4), linear, or None.

        It is opaque if alpha is nowhere below 1.
        """
        material = surface.material
        seen_through = colors is not None and colors.shape[1] == 4 and not (colors[:, 3] >= 1.0).all()
        if material.alpha_mode == "opaque" or material.opacity < 1.0 or seen_through or not self._is_clear(material):
            return material
        return replace(material, alpha_mode="opaque")

    def _is_clear(self, material: Material) -> bool:
        if material.albedo_texture is None:
            return True
        image = material.albedo_texture.image
        if id(image) not in self._clear:
            self._clear[id(image)] = bool((image.pixels[..., 3] == 255).all())
        return self._clear[id(image)]

    def _read(self, entry: Mapping[str, Any]) -> Surface:
        pictures = _Pictures.of(entry)
        base, gloss, unlit = pictures.base, pictures.gloss, pictures.unlit
        r, g, b, alpha = numbers(base, "baseColorFactor" if gloss is None else "diffuseFactor", (1.0, 1.0, 1.0, 1.0))
        infos = pictures.color, pictures.emission, pictures.normal
        sets = [_uv_set(info) for info in infos if isinstance(info, dict)]
        uv_sets = _two_sets(sets)
        if any(used not in uv_sets for used in sets):
            self.document.unshown["more than two sets of texture coordinates in a material"] = None
        color, emission, normal = (self._texture(info, uv_sets) for info in infos)

        glow = _emission(entry, self.document.per_unit)
        mode = str(entry.get("alphaMode", "OPAQUE")).lower()
        alpha_mode: AlphaMode = mode if mode in get_args(AlphaMode) else "opaque"  # type: ignore[assignment]  # mypy can't narrow
        material = Material(
            albedo=clip_color((r, g, b)),
            emission=glow,
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
            lit = clip_color((r, g, b))
            material = replace(material, albedo=(0.0, 0.0, 0.0), emission=lit, emission_texture=color, unlit=True)
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
        failures: dict[object, Exception] = {}
        for index in sources:
            if index not in self._images:
                try:
                    self._images[index] = read_image(*self.encoded(index))
                except (Damaged, InputError, MemoryError) as error:
                    failures[index] = error
                    continue
            image = self._images[index]
            if image is not None:
                return image
        for index, failure in failures.items():
            self._images[index] = None
            if isinstance(failure, Missing):
                self.document.absent[failure.name] = None
            else:
                self.document.leave_out(f"image {index}", str(failure) or "memory does not suffice")
        if not sources:
            raise Damaged("it has no image")
        return None

    def encoded(self, index: object) -> tuple[bytes, str]:
        """Return the bytes of an image's file, and its name for messages; raise Damaged."""
        entry = self.document.entry("images", index)
        if "bufferView" in entry:
            data, name = plain_view(self.document, entry["bufferView"])[0].tobytes(), entry.get("name") or f"image {index}"
        else:
            data, name = self.document.resource(entry.get("uri"))
            name = entry.get("name") or f"image {index}" if name == "data" else name
        return data, printable(name)


@dataclass(frozen=True)
class _Pictures:
    """The relevant textureInfos of a material; None or any JSON value if missing.

    base: the object with factor and texture of the colour. gloss: the same for specular-glossiness materials.
    """

    base: Mapping[str, Any]
    gloss: Mapping[str, Any] | None
    unlit: bool
    color: Any
    emission: Any
    normal: Any

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> _Pictures:
        """Return the textureInfos of the material `entry`."""
        metal = entry.get("pbrMetallicRoughness")
        base: Mapping[str, Any] = metal if isinstance(metal, dict) else {}
        gloss = extension(entry, "KHR_materials_pbrSpecularGlossiness")
        unlit = extension(entry, "KHR_materials_unlit") is not None
        return cls(
            base if gloss is None else gloss,
            gloss,
            unlit,
            base.get("baseColorTexture") if gloss is None else gloss.get("diffuseTexture"),
            entry.get("emissiveTexture") if not unlit and any(_emission(entry)) else None,
            None if unlit else entry.get("normalTexture"),
        )

    @property
    def all(self) -> list[dict[str, Any]]:
        """The existing textureInfos."""
        return [info for info in (self.color, self.emission, self.normal) if isinstance(info, dict)]


def _emission(entry: Mapping[str, Any], per_unit: float = 1.0) -> _Color:
    """Return the emission of a material without its texture. per_unit: see LoadOptions."""
    strength = per_unit * number(extension(entry, "KHR_materials_emissive_strength") or {}, "emissiveStrength", 1.0)
    r, g, b = (min(max(0.0, strength * value), GREATEST) for value in numbers(entry, "emissiveFactor", (0.0, 0.0, 0.0)))
    return r, g, b


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
