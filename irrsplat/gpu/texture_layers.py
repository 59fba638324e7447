"""The textures that light looks at: all images of a scene, each scaled to a layer of one array of limited size.

The picture has the images as they are; what records, rays and shadow maps see of a texture is never that fine.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.gpu.resource import Owner, Resource
from irrsplat.scene.image_means import area_means, coverage
from irrsplat.scene.model import Image, Material, Texture

MOST_TEXELS = 1024  # along a side of a layer
_LEAST_TEXELS = 16
_BYTES = 8 * 4 / 3  # of a texel of four half floats, and its share of the coarser levels


@dataclass(frozen=True)
class LayerKey:
    """What a layer is made of: an image, and the alpha from which on light sees it (0: its alpha is not looked at)."""

    image: Image
    cutoff: float


def layer_keys(material: Material) -> tuple[LayerKey | None, LayerKey | None]:
    """The layers of a material's albedo and emission; None where it has no such texture."""

    def key(texture: Texture | None, cutoff: float) -> LayerKey | None:
        return None if texture is None else LayerKey(texture.image, cutoff if texture.image.alpha_range[0] < 1.0 else 0.0)

    cutoff = material.light_cutoff
    alpha = cutoff / max(material.opacity, 1e-6) if cutoff > 0.0 else 0.0
    return key(material.albedo_texture, alpha), key(material.emission_texture, 0.0)


@dataclass(frozen=True)
class LayerPlan:
    """Which images get a layer: the layer's number by its key, and the side of all layers in texels, a power of two; images
    without a layer are in `means` with their mean colours (4,), times alpha, and alpha."""

    layers: Mapping[LayerKey, int]
    side: int
    means: Mapping[LayerKey, np.ndarray]

    @property
    def size(self) -> int:
        """Bytes on the GPU."""
        return round(len(self.layers) * self.side**2 * _BYTES)


def plan(keys: Iterable[LayerKey], most_bytes: float, most_layers: int) -> LayerPlan:
    """The plan for these layers, in the order of their importance: where there are more than `most_layers` or than fit into
    `most_bytes`, the last ones get their mean colours. All are as large as fits, and as is of use."""
    every = list(dict.fromkeys(keys))
    kept = every[: max(min(most_layers, int(most_bytes / (_BYTES * _LEAST_TEXELS**2))), 1)]
    largest = max((max(key.image.pixels.shape[:2]) for key in kept), default=1)
    of_use = 1 << max(largest - 1, 0).bit_length()
    fits = math.sqrt(most_bytes / (_BYTES * max(len(kept), 1)))
    side = max(min(of_use, MOST_TEXELS, 1 << int(math.log2(max(fits, 1.0)))), 1)
    means = {key: layer_texels(key, 1)[0, 0] for key in every[len(kept) :]}
    return LayerPlan({key: i for i, key in enumerate(kept)}, side, means)


def layer_texels(key: LayerKey, side: int) -> np.ndarray:
    """(side, side, 4) float32: the image's mean colours, linear and times alpha, and alpha; that is 1 where it is not looked at,
    and of a dithered layer the share of the texel where light sees the image's."""
    if key.cutoff == 0.0:
        opaque = area_means(key.image.pixels, side, weighted=False)
        opaque[..., 3] = 1.0
        return opaque
    texels = area_means(key.image.pixels, side, weighted=True)
    if dithered(key, side):
        texels[..., 3] = coverage(key.image.pixels[..., 3], side, key.cutoff)
    texels[..., :3] *= texels[..., 3:]
    return texels


def dithered(key: LayerKey, side: int) -> bool:
    """Whether the holes of an image may be finer than the texels of a layer: then its alpha is the share that is there, and which
    part of a texel that is, is decided by noise (after Wyman and McGuire 2017, "Hashed Alpha Testing")."""
    return key.cutoff > 0.0 and max(key.image.pixels.shape[:2]) > side


class TextureLayers(Owner):
    """The layers of a plan as a texture array of half floats, with coarser levels; it repeats in both directions."""

    def __init__(self, ctx: moderngl.Context, plan: LayerPlan) -> None:
        side = plan.side
        self.texture = ctx.texture_array((side, side, max(len(plan.layers), 1)), 4, dtype="f2")
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            halves = threads.map(lambda key: layer_texels(key, side).astype("f2"), plan.layers)
            for i, texels in zip(plan.layers.values(), halves, strict=True):
                self.texture.write(texels.tobytes(), viewport=(0, 0, i, side, side, 1))
        self.texture.build_mipmaps()
        self.texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        self.texture.repeat_x = self.texture.repeat_y = True

    def owned(self) -> tuple[Resource, ...]:
        """What this frees."""
        return (self.texture,)
