"""A scene's images on the GPU at full resolution, for the camera: each uploaded once, with mip-maps, in limited memory."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.gpu.context import describe
from irrsplat.gpu.program import SampledTexture
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.scene.appearance import Run
from irrsplat.scene.image_means import half
from irrsplat.scene.model import Image, Texture

_SRGB8_ALPHA8 = 0x8C43
_TEXEL = 4 * 4 / 3  # bytes, with its share of the mip-maps
_MIB = 2**20
_ANISOTROPY = 8  # samples along the longer axis of a pixel's footprint, at most
_TAPS = 4  # samples along a footprint where shaders filter anisotropically


@dataclass(frozen=True)
class _Use:
    """An image in one encoding. srgb: colours are sRGB-encoded. cutoff: the alpha test's threshold."""

    image: Image
    srgb: bool
    cutoff: float = 0.0


def _uses(runs: Sequence[Run]) -> tuple[_Use, ...]:
    """Return the images of these runs, once per encoding."""
    appearances = dict.fromkeys(run.appearance for run in runs)
    colours = (_Use(one.albedo.image, True, one.alpha_cutoff) for one in appearances if one.albedo is not None)
    emissions = (_Use(one.emission.image, True) for one in appearances if one.emission is not None)
    normals = (_Use(one.normal.image, False) for one in appearances if one.normal is not None)
    return tuple(dict.fromkeys([*colours, *emissions, *normals]))


def halvings(sizes: Iterable[tuple[int, int]], memory: float, side: int) -> list[int]:
    """Return the number of times to halve each image (width, height), the largest first.

    Afterwards no side is longer than `side`, and all images with mip-maps fit into `memory` bytes.
    """
    counts, heap, total = [], [], 0.0
    for i, (width, height) in enumerate(sizes):
        counts.append(max(0, math.ceil(math.log2(max(width, height) / side))))
        size = _halved(width, height, counts[i])
        total += _TEXEL * size[0] * size[1]
        heap.append((-size[0] * size[1], i, size))
    heapq.heapify(heap)
    while total > memory and heap and heap[0][0] < -1:
        area, i, (width, height) = heap[0]
        size = _halved(width, height, 1)
        counts[i] += 1
        total += _TEXEL * (size[0] * size[1] + area)
        heapq.heapreplace(heap, (-size[0] * size[1], i, size))
    return counts


def _halved(width: int, height: int, times: int) -> tuple[int, int]:
    for _ in range(times):
        width, height = (width + 1) // 2, (height + 1) // 2
    return width, height


class TextureMaps(Owner):
    """The textures of a scene's materials, uploaded at first use. memory: MiB; larger images are halved until all fit."""

    def __init__(self, ctx: moderngl.Context, memory: int = 1024) -> None:
        self.ctx, self.memory = ctx, memory
        # Mesa's software renderer has an anisotropic filter that blurs too much
        driver = self.ctx.max_anisotropy >= _ANISOTROPY and not describe(ctx)["software"]
        self.taps = 1 if driver else _TAPS  # samples that shaders take along a footprint
        self._runs: Sequence[Run] = ()
        self._counts: Mapping[_Use, int] = {}  # halvings of each image
        self._textures: dict[_Use, moderngl.Texture] = {}
        self._samplers: dict[tuple[object, ...], moderngl.Sampler] = {}

    def owned(self) -> tuple[Resource | None, ...]:
        return (*self._textures.values(), *self._samplers.values())

    def prepare(self, runs: Sequence[Run]) -> None:
        """Prepare the images of these runs, and free all others."""
        if runs is self._runs:
            return
        counts = self._plan(_uses(runs))
        for use in [use for use in self._textures if counts.get(use) != self._counts[use]]:
            self._textures.pop(use).release()
        self._counts, self._runs = counts, runs

    def _plan(self, uses: tuple[_Use, ...]) -> dict[_Use, int]:
        sizes = [use.image.pixels.shape[1::-1] for use in uses]
        counts = halvings(sizes, self.memory * _MIB, int(self.ctx.info["GL_MAX_TEXTURE_SIZE"]))
        return dict(zip(uses, counts, strict=True))

    def notices(self, runs: Sequence[Run]) -> tuple[str, ...]:
        """Return a notice if images of these runs are scaled down."""
        counts = self._plan(_uses(runs))
        smaller = {use.image: count for use, count in counts.items() if count}
        if not smaller:
            return ()
        image, count = max(smaller.items(), key=lambda item: item[0].pixels.size)
        width, height = image.pixels.shape[1::-1]
        now = "x".join(map(str, _halved(width, height, count)))
        return (
            f"{len(smaller)} of {len({use.image for use in counts})} images are scaled down to fit into "
            f"{self.memory} MiB: {image.name or 'the largest'}, {width}x{height}, is shown as {now}",
        )

    def __call__(self, texture: Texture, srgb_encoded: bool, cutoff: float = 0.0) -> SampledTexture:
        """Return the texture with its sampler; mirroring is done in the shader with a clamping sampler.

        cutoff: the alpha test's threshold, if any.
        """
        return SampledTexture(self._texture(_Use(texture.image, srgb_encoded, cutoff)), self._sampler(texture))

    def _texture(self, use: _Use) -> moderngl.Texture:
        if use not in self._textures:
            pixels = use.image.pixels
            for _ in range(self._counts[use]):
                pixels = half(pixels, use.srgb)
            size, data = pixels.shape[1::-1], np.ascontiguousarray(pixels, "u1")
            made = self.ctx.texture(size, 4, data, internal_format=_SRGB8_ALPHA8) if use.srgb else self.ctx.texture(size, 4, data)
            made.build_mipmaps()
            if use.cutoff > 0.0:
                _keep_coverage(made, pixels[..., 3], use.cutoff)
            self._textures[use] = made
        return self._textures[use]

    def _sampler(self, texture: Texture) -> moderngl.Sampler:
        key = *texture.wrap, texture.nearest
        if key not in self._samplers:
            self._samplers[key] = self.ctx.sampler(
                repeat_x=texture.wrap[0] == "repeat",
                repeat_y=texture.wrap[1] == "repeat",
                filter=(moderngl.LINEAR_MIPMAP_LINEAR, moderngl.NEAREST if texture.nearest else moderngl.LINEAR),
                anisotropy=1.0 if texture.nearest or self.taps > 1 else float(_ANISOTROPY),
            )
        return self._samplers[key]


def _keep_coverage(texture: moderngl.Texture, alpha: np.ndarray, cutoff: float) -> None:
    """Scale the alphas of every mip-map to the image's share of opaque texels; alpha: (H, W) uint8."""
    for level in range(1, max(texture.size).bit_length()):
        width, height = (max(side >> level, 1) for side in texture.size)
        texels = np.frombuffer(texture.read(level=level), "u1").reshape(height, width, 4).copy()
        texels[..., 3] = scaled_alpha(alpha, texels[..., 3], cutoff)
        texture.write(texels, level=level)


def scaled_alpha(alpha: np.ndarray, means: np.ndarray, cutoff: float) -> np.ndarray:
    """Return (h, w) uint8: `means` of opacities `alpha` (H, W), all uint8, scaled to the same share above the cutoff (Castano
    2010, "Computing Alpha Mipmaps")."""
    least = np.ceil(255.0 * cutoff)
    share = float((alpha >= least).mean())
    if share in (0.0, 1.0):
        return means
    levels, counts = np.unique(means, return_counts=True)
    passing = np.cumsum(counts[::-1])[::-1] / means.size  # share of texels at or above each level
    level = max(float(levels[np.argmin(np.abs(passing - share))]), 1.0)
    return np.asarray(np.minimum(np.ceil(means * (least / level)), 255.0).astype("u1"))


def map_uniforms(name: str, texture: Texture) -> dict[str, np.ndarray | tuple[float, ...]]:
    """Return the uniforms of shaders/image/texture_map.glsl for the map of this name."""
    a, b, c, d, e, f = texture.transform
    from_uv = np.zeros((2, 4))
    from_uv[:, 2 * texture.uv_set : 2 * texture.uv_set + 2] = (a, b), (d, e)
    mirrored = (float(wrap == "mirror") for wrap in texture.wrap)
    return {f"{name}_from_uv": from_uv, f"{name}_place": (c, f, *mirrored)}
