"""Lightmaps: all surfaces of a scene in one square picture, and a glTF file with this picture."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, Unpack

import moderngl
import numpy as np

from irrsplat.app.bake import seams
from irrsplat.app.bake.glb import Glb
from irrsplat.app.bake.light import OnBake, PlaceLight
from irrsplat.app.bake.places import Places, Receivers, hidden, places
from irrsplat.app.bake.unwrap import Chartist, Charts, unwrap
from irrsplat.core import files
from irrsplat.core.color import srgb
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import triangle_areas
from irrsplat.scene.model import Material, Mesh, Scene, Texture
from irrsplat.scene.model.checks import check_type
from irrsplat.settings import SettingValues

Light = Literal["all", "indirect"]
Form = Literal["radiance", "irradiance"]
SIZE, SAMPLES = 1024, 8  # defaults: texels per side; sample points per texel for direct light and textures
MOST = 8192  # texels per side
_CLIPPED = 0.005  # largest share of all light lost to clipping in the picture; the EXR is complete
_GOLDEN = 1.32471795724474602596  # root of x³ = x + 1, the base of the R2 sequence (Roberts 2018)


@dataclass(frozen=True, eq=False)
class Lightmap:
    """Light on surfaces as float32 pictures (S, S, 3), top row first; TEXCOORD_1 = (0, 0) is the top left corner.

    irradiance: W/m², with or without direct light. radiance: W/(m² sr), reflected and emitted. indirect, direct: parts of the
    irradiance before seam matching. charts: layout of the surfaces of `receivers`. lit: lit points. owner: (S, S) chart of
    each texel, -1 for none. texel: mean texel side in metres. records, converged: as in a render.
    """

    receivers: Receivers
    charts: Charts
    light: Light
    irradiance: np.ndarray
    radiance: np.ndarray
    indirect: np.ndarray
    direct: np.ndarray
    lit: Places
    owner: np.ndarray
    texel: float
    records: int
    converged: bool

    def save(self, path: str | os.PathLike[str], form: Form = "radiance") -> tuple[Path, ...]:
        """Write a .glb and, with the same stem, the map as an .exr; return both paths.

        form: "radiance": black materials that emit the map; "irradiance": the scene's own materials and a separate map. Each
        file appears complete or not at all. Raises InputError for another ending, IrrsplatError for a failed write.
        """
        glb = Path(path)
        if glb.suffix.lower() != ".glb":
            raise InputError("a lightmap is written as a .glb; give -o a name that ends so", str(path) or "''")
        files.write_bytes(glb, glb_of(self, form))
        exr, values = glb.with_suffix(".exr"), np.ascontiguousarray(getattr(self, form), np.float32)
        files.write_file(exr, partial(files.write_layers, layers={"RGB": values}, rows=len(values)))
        return glb, exr

    @property
    def summary(self) -> dict[str, Any]:
        """Sizes for --stats."""
        share = float((self.owner >= 0).mean())
        return {"texels": self.charts.size, "used": share, "texel_metres": self.texel, "charts": int(self.charts.chart.max()) + 1,
                "records": self.records, "converged": self.converged}  # fmt: skip

    @property
    def words(self) -> str:
        """Sizes as a line of text."""
        size, found = self.charts.size, self.summary
        used = f"{found['used']:.0%} used by {found['charts']:,} charts"
        return f"lightmap    {size} x {size} texels, {used}, {1000.0 * self.texel:.3g} mm a texel"


def bake_lightmap(
    scene: Scene,
    size: int = SIZE,
    light: Light = "all",
    texel_samples: int = SAMPLES,
    preset: str = "default",
    on_bake: OnBake | None = None,
    ctx: moderngl.Context | None = None,
    **settings: Unpack[SettingValues],
) -> Lightmap:
    """Bake the lightmap of a scene, `size` texels per side.

    light: "all", or "indirect": "all" without direct light. texel_samples: points per texel at which lights and textures are
    sampled. preset, settings: Renderer settings of the stages shadow, gather, splat and examine. on_bake: called with the
    completed share and a message. ctx: as in Renderer. Raises InputError for invalid arguments or without the extra `bake`;
    GLError without OpenGL.
    """
    check_type("what a lightmap is baked of", scene, Scene)
    if not 16 <= size <= MOST or texel_samples < 1:
        raise InputError(f"a lightmap has 16 to {MOST} texels a side and 1 sample or more, not {size} and {texel_samples}")
    notify = on_bake or (lambda share, words: None)
    notify(0.0, "unwrapping")
    receivers = Receivers.of(scene, ctx)
    charts = unwrap(receivers, size)
    with PlaceLight(receivers.scene, preset, ctx, **settings) as lights, Chartist(lights.ctx, charts) as chartist:
        return _baked(receivers, charts, chartist, lights, light, texel_samples, notify)


def _baked(
    receivers: Receivers, charts: Charts, chartist: Chartist, lights: PlaceLight, light: Light, samples: int, notify: OnBake
) -> Lightmap:
    scene, texel = receivers.scene, _texel(receivers, charts)
    triangle, u, v = chartist.nearest()
    chart = np.where(triangle >= 0, charts.chart[triangle], -1)
    all_of_them = places(receivers, triangle, u, v)
    unseen = hidden(scene, all_of_them)
    lit = all_of_them.but(unseen)
    indirect, covered, converged = lights.gathered(lit, texel, lambda share, words: notify(0.1 + 0.7 * share, words))
    lit = lit.but(~covered)

    from scipy import ndimage

    beside = ndimage.binary_dilation(unseen, iterations=1)  # texels next to hidden texels may have hidden sample points
    offsets = _offsets(samples)
    sums = {name: np.zeros((*lit.seen.shape, 3)) for name in ("direct", "reflected", "albedo", "emission")}
    count = np.zeros(lit.seen.shape)
    for number, (x, y) in enumerate(offsets):
        notify(0.8 + 0.2 * number / len(offsets), "lights and textures")
        some = lit
        if number:
            triangle, u, v = chartist.at(x, y)
            some = places(receivers, np.where(lit.seen, triangle, -1), u, v)
            if beside.any():
                some = some.but(hidden(scene, some.but(~beside)))
        E = lights.direct(some, number)
        for name, values in (("direct", E), ("reflected", E * some.albedo), ("albedo", some.albedo), ("emission", some.emission)):
            sums[name] += np.where(some.seen[..., None], values, 0.0)
        count += some.seen
    mean = {name: values / np.maximum(count, 1)[..., None] for name, values in sums.items()}
    direct = mean["direct"] if light == "all" else np.zeros_like(mean["direct"])
    reflected = (mean["reflected"] if light == "all" else 0.0) + mean["albedo"] * indirect
    radiance = reflected / np.pi + mean["emission"]
    corners = receivers.surfaces.positions[receivers.surfaces.faces].astype(float)
    normals = receivers.surfaces.normals[receivers.surfaces.faces].astype(float)

    def finished(values: np.ndarray) -> np.ndarray:
        whole = seams.filled(values, lit.seen, all_of_them.position, chart)
        return seams.matched(whole, charts, corners, normals).astype(np.float32)

    return Lightmap(
        receivers,
        charts,
        light,
        finished(direct + indirect),
        finished(radiance),
        indirect,
        mean["direct"].astype(np.float32),
        lit,
        chart,
        texel,
        lights.cache.count,
        converged,
    )


def _offsets(count: int) -> np.ndarray:
    """Return `count` evenly spread offsets (count, 2) from a texel's centre, in texels (R2 sequence); the first is the centre."""
    steps = np.arange(count)[:, None] * np.array([1.0 / _GOLDEN, 1.0 / _GOLDEN**2])
    return np.asarray((steps + 0.5) % 1.0 - 0.5)


def _texel(receivers: Receivers, charts: Charts) -> float:
    """Return the mean texel side over all surfaces, in metres."""
    corners, flat = receivers.surfaces.positions[receivers.surfaces.faces].astype(float), charts.corners
    area = triangle_areas(np.concatenate([flat, np.zeros_like(flat[..., :1])], axis=-1)).sum()
    return float(np.sqrt(triangle_areas(corners).sum() / max(area, 1e-20)))


# ---- files -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Encoding:
    """Map as an 8-bit picture whose scale differs between groups of charts.

    png: sRGB-encoded, dithered to keep the mean over several texels. strength: (G,) radiance or irradiance of a group's 1.
    part: (F,) group of each triangle. limit: clipping threshold. clipped: share of all light on texels above the limit.
    """

    png: bytes
    strength: np.ndarray
    part: np.ndarray
    limit: float
    clipped: float

    @staticmethod
    def of(made: Lightmap, form: Form) -> Encoding:
        """Encode the map of this form."""
        from scipy import ndimage

        values, on = getattr(made, form), made.owner
        bright = values.max(-1)
        limit = limit_of(bright[on >= 0], np.ones(np.count_nonzero(on >= 0)))
        owner = on[tuple(ndimage.distance_transform_edt(on < 0, return_distances=False, return_indices=True))]
        charts = int(made.charts.chart.max(initial=-1)) + 1
        most = np.minimum(ndimage.maximum(bright, owner, np.arange(charts)), limit)
        mesh = np.zeros(charts, np.int64)
        mesh[made.charts.chart] = made.receivers.mesh_of
        _, group = np.unique(np.stack([mesh, np.floor(np.log2(np.maximum(most, 1e-30)))], axis=1), axis=0, return_inverse=True)
        strength = np.zeros(int(group.max(initial=-1)) + 1)
        np.maximum.at(strength, group.ravel(), most)
        own = strength[group.ravel()]  # (charts,)
        shown = np.minimum(values / np.maximum(own[owner], 1e-30)[..., None], 1.0)
        clipped = float(np.maximum(bright[on >= 0] - limit, 0.0).sum()) / max(float(bright[on >= 0].sum()), 1e-30)
        png = files.as_png(files.dithered(srgb(shown)) * (shown > 0.0) / 255.0)
        return Encoding(png, strength, group.ravel()[made.charts.chart], limit, clipped)


def limit_of(values: np.ndarray, area: np.ndarray) -> float:
    """Return the least limit that clips at most the share _CLIPPED of all light; values, area: (N,)."""
    order = np.argsort(values, kind="stable")[::-1]
    down, area = values[order].astype(float), area[order].astype(float)
    excess = np.cumsum(area * down) - np.cumsum(area) * down  # clipped light at each limit
    within = np.flatnonzero(excess <= _CLIPPED * (area @ down))
    return float(down[within[-1]]) if len(within) else 0.0


def glb_of(made: Lightmap, form: Form) -> bytes:
    """Return the bytes of the .glb of `Lightmap.save`."""
    encoding = Encoding.of(made, form)
    unit = "W/(m² sr)" if form == "radiance" else "W/m²"
    about = {"form": form, "light": made.light, "unit": unit, "texCoord": 1, "strength": encoding.limit}
    glb = Glb({"irrsplat": about | {"clipped": round(encoding.clipped, 6)}}, made.receivers.origin)
    size = made.charts.size
    picture = glb.picture(encoding.png, f"{form} of {made.light} light, {unit}") | {"texCoord": 1}
    scene, receivers, first_face = made.receivers.scene, made.receivers, 0
    for i, mesh in enumerate(receivers.meshes):
        source, vertex = scene.meshes[receivers.sources[i]], made.charts.vertex[i]
        material = mesh.material
        two_sided = receivers.is_two_sided(i)
        lying = next((t for t in (material.albedo_texture, material.emission_texture, material.normal_texture) if t), None)
        second = made.charts.uv[i] / size
        first = second if lying is None or mesh.uvs is None else texture_coordinates(mesh.uvs[vertex], lying)
        attributes: dict[str, np.ndarray] = {
            "POSITION": mesh.positions[vertex],
            "NORMAL": unit_normals(mesh, vertex),
            "TEXCOORD_0": first,
            "TEXCOORD_1": second,
        }
        if form == "irradiance" and mesh.colors is not None and not material.unlit:
            attributes["COLOR_0"] = mesh.colors[vertex]
        if mesh.opacities is not None:
            colours = attributes.get("COLOR_0", np.ones((len(vertex), 3)))
            attributes["COLOR_0"] = np.column_stack([colours, np.clip(mesh.opacities[vertex], 0.0, 1.0)])
        part = encoding.part[first_face : first_face + len(mesh.faces)]
        first_face += len(mesh.faces)
        parts = []
        for number in np.unique(part):
            strength = float(encoding.strength[number])
            if form == "radiance":
                entry = glb.material(material, (0.0, 0.0, 0.0), two_sided)
                if material.alpha_mode != "opaque" and material.albedo_texture is not None:  # for its alpha
                    entry["pbrMetallicRoughness"]["baseColorTexture"] = glb.texture(material.albedo_texture)
                glb.emissive(entry, (strength,) * 3, picture)
            else:
                entry = own_material(glb, mesh, two_sided, lying)
                entry["extras"] = {"lightMap": {**picture, "strength": strength}}
            if mesh.opacities is not None:  # in place of the material's
                entry["pbrMetallicRoughness"]["baseColorFactor"][3] = 1.0
            parts.append((made.charts.faces[i][part == number], glb.add("materials", entry)))
        glb.mesh(source.name, attributes, parts)
    return glb.encoded(scene.cameras)


def own_material(glb: Glb, mesh: Mesh, two_sided: bool, lying: Texture | None) -> dict[str, Any]:
    """Return a mesh's diffuse material with the textures that share the coordinates of `lying`."""
    material: Material = mesh.material
    entry = glb.material(material, (1.0, 1.0, 1.0) if mesh.colors is not None else material.albedo, two_sided)
    alike = {
        name: glb.texture(texture)
        for name in ("albedo", "emission", "normal")
        if (texture := getattr(material, f"{name}_texture")) is not None and lying is not None
        and (texture.uv_set, texture.transform) == (lying.uv_set, lying.transform)
    }  # fmt: skip
    if "albedo" in alike:
        entry["pbrMetallicRoughness"]["baseColorTexture"] = alike["albedo"]
    if "normal" in alike:
        entry["normalTexture"] = alike["normal"] | {"scale": material.normal_scale}
    glb.emissive(entry, material.emission, alike.get("emission"))
    return entry


def texture_coordinates(uvs: np.ndarray, texture: Texture) -> np.ndarray:
    """Return transformed coordinates (V, 2) of a texture for vertices with coordinates (V, 4): the file has no transform."""
    a, b, c, d, e, f = texture.transform
    u, v = uvs[:, 2 * texture.uv_set : 2 * texture.uv_set + 2].astype(float).T
    return np.stack([a * u + b * v + c, d * u + e * v + f], axis=1)


def unit_normals(mesh: Mesh, vertex: np.ndarray) -> np.ndarray:
    """Return float64 unit normals of copies of a mesh's vertices, as glTF requires; +y where a normal is zero."""
    normals = mesh.normals[vertex].astype(float)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-6, normals / np.maximum(length, 1e-6), (0.0, 1.0, 0.0))
