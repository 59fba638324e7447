"""The textures that light meets: all images of a scene, each scaled to a layer of one array of limited size.

The picture uses the images at full resolution; records, rays and shadow maps need less.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.gpu.resource import Owner
from irrsplat.scene.image_means import area_means, coverage
from irrsplat.scene.model import Image, Material, Texture

MOST_TEXELS = 256, 1024  # along a side of a layer: a ray stands for the mean of some centimetres; and where there are holes
_LEAST_TEXELS = 16
_BYTES = 8 * 4 / 3  # per texel of four half floats, with its share of the mip-maps


@dataclass(frozen=True)
class LayerKey:
    """The source of a layer: an image, and the least alpha that light hits (0: alpha is ignored)."""

    image: Image
    cutoff: float


def layer_keys(material: Material) -> tuple[LayerKey | None, LayerKey | None]:
    """Return the layers of a material's albedo and emission; None for a missing texture."""

    def key(texture: Texture | None, cutoff: float) -> LayerKey | None:
        return None if texture is None else LayerKey(texture.image, cutoff if texture.image.alpha_range[0] < 1.0 else 0.0)

    cutoff = material.light_cutoff
    alpha = cutoff / max(material.opacity, 1e-6) if cutoff > 0.0 else 0.0
    return key(material.albedo_texture, alpha), key(material.emission_texture, 0.0)


@dataclass(frozen=True)
class LayerPlan:
    """The images that get a layer: layer numbers by key, and the side of all layers in texels, a power of two.

    means: mean colours (4,) times alpha, and alpha, of images without a layer.
    """

    layers: Mapping[LayerKey, int]
    side: int
    means: Mapping[LayerKey, np.ndarray]


def plan(keys: Iterable[LayerKey], most_bytes: float, most_layers: int) -> LayerPlan:
    """Return the plan for these layers, sorted by importance, with the largest useful side that fits.

    Layers beyond `most_layers` or `most_bytes` are replaced by their mean colours.
    """
    every = list(dict.fromkeys(keys))
    kept = every[: max(min(most_layers, int(most_bytes / (_BYTES * _LEAST_TEXELS**2))), 1)]
    largest = max((max(key.image.pixels.shape[:2]) for key in kept), default=1)
    of_use = 1 << max(largest - 1, 0).bit_length()
    fits = math.sqrt(most_bytes / (_BYTES * max(len(kept), 1)))
    most = MOST_TEXELS[any(key.cutoff > 0.0 for key in kept)]
    side = max(min(of_use, most, 1 << int(math.log2(max(fits, 1.0)))), 1)
    means = {key: layer_texels(key, 1)[0, 0] for key in every[len(kept) :]}
    return LayerPlan({key: i for i, key in enumerate(kept)}, side, means)


def layer_texels(key: LayerKey, side: int) -> np.ndarray:
    """Return (side, side, 4) float32: the image's mean colours, linear and times alpha, and alpha.

    Ignored alpha is 1; the alpha of a dithered layer is the share of the texel where light hits the image.
    """
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
    """True if the holes of an image may be finer than the texels of a layer.

    The layer's alpha is then the opaque share, and noise decides which part is hit (after Wyman and McGuire 2017, "Hashed Alpha
    Testing").
    """
    return key.cutoff > 0.0 and max(key.image.pixels.shape[:2]) > side


class TextureLayers(Owner):
    """The layers of a plan as a mip-mapped texture array of half floats, repeating in both directions."""

    def __init__(self, ctx: moderngl.Context, plan: LayerPlan) -> None:
        side = plan.side
        self.texture = self.own(ctx.texture_array((side, side, max(len(plan.layers), 1)), 4, dtype="f2"))
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            halves = threads.map(lambda key: layer_texels(key, side).astype("f2"), plan.layers)
            for i, texels in zip(plan.layers.values(), halves, strict=True):
                self.texture.write(texels.tobytes(), viewport=(0, 0, i, side, side, 1))
        self.texture.build_mipmaps()
        self.texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        self.texture.repeat_x = self.texture.repeat_y = True
