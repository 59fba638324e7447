"""Bakes: lightmaps and vertex colours hold the light that there is, in files that other programs read."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image as Pillow

import irrsplat
from irrsplat.app import cli
from irrsplat.app.bake import seams
from irrsplat.app.bake.cutting import Cut
from irrsplat.app.bake.lightmap import Form
from irrsplat.app.bake.places import Receivers
from irrsplat.scene.model import Camera, Image, Material, Mesh, Scene, Texture

SKY = (1.0, 2.0, 3.0)
FAST: dict[str, Any] = {"bounces": 1, "gather_size": 8, "light_samples": 0, "shadow_size": 256}


def square(z: float = 0.0, side: float = 2.0, **material: Any) -> Mesh:
    """Return a square that faces along z, with texture coordinates from 0 to 1."""
    corners = side * np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]) + (0.0, 0.0, z)
    uvs = np.tile([[0, 1], [1, 1], [1, 0], [0, 0]], (1, 2))
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(
        corners.astype("f4"), normals.astype("f4"), faces, Material(double_sided=False, **material), uvs=uvs.astype(np.float32)
    )


def under_a_sky(*meshes: Mesh) -> Scene:
    """Return a scene of these meshes under a sky of constant radiance."""
    return Scene(meshes, (), (Camera((0, 0, 5), (0, 0, 0)),), sky=SKY)


def parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the JSON and the buffer of a .glb."""
    data = path.read_bytes()
    assert struct.unpack("<4sII", data[:12]) == (b"glTF", 2, len(data))
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


@pytest.fixture(scope="module")
def textured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """Return a folder with both forms of a lightmap, and the lightmap: a square of two colours under a sky."""
    pytest.importorskip("xatlas")
    from irrsplat.app.bake import bake_lightmap

    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[:, 0, :3] = (255, 0, 0)
    red_and_white = Texture(Image(pixels), nearest=True)
    made = bake_lightmap(under_a_sky(square(albedo=(0.5, 0.5, 0.5), albedo_texture=red_and_white)), 32, **FAST)
    folder = tmp_path_factory.mktemp("textured")
    for form in ("radiance", "irradiance"):
        made.save(folder / f"{form}.glb", form)
    return folder, made


def test_the_irradiance_under_a_constant_sky_is_pi_times_its_radiance(textured: tuple[Path, Any]) -> None:
    """E = π·L in all texels, including the margin for filtering; ρ·E/π = ρ·L, and the red half reflects no green."""
    made = textured[1]
    assert np.abs(made.irradiance / (np.pi * np.array(SKY)) - 1.0).max() < 0.01
    assert made.converged
    assert (made.owner >= 0).mean() > 0.5
    assert made.charts.chart.tolist() == [0, 0]  # with two charts the halves could differ in scale
    red = made.lit.seen & (made.lit.albedo[..., 1] < 0.1)
    white = made.lit.seen & (made.lit.albedo[..., 1] > 0.4)
    assert np.median(made.radiance[red][:, 1]) < 1e-3 and min(red.sum(), white.sum()) > 100
    assert np.abs(np.median(made.radiance[white], axis=0) / (0.5 * np.array(SKY)) - 1.0).max() < 0.02


def test_the_glb_has_black_materials_that_emit_the_map(textured: tuple[Path, Any]) -> None:
    folder, made = textured
    document, data = parts(folder / "radiance.glb")
    (material,) = document["materials"]
    assert material["pbrMetallicRoughness"]["baseColorFactor"][:3] == [0.0, 0.0, 0.0]
    assert material["emissiveTexture"]["texCoord"] == 1
    strength = material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    (folder / "inside.png").write_bytes(data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
    shown = np.asarray(Pillow.open(folder / "inside.png")).astype(float) / 255.0
    linear = strength * np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    seen = made.lit.seen
    # dithering keeps the mean, although each texel has one of 256 values
    assert np.abs(linear[seen].mean(0) / made.radiance[seen].mean(0) - 1.0).max() < 0.01
    # trimesh reads the mesh
    (mesh,) = trimesh.load_scene(folder / "radiance.glb").geometry.values()
    assert len(mesh.faces) == 2


def test_the_irradiance_form_keeps_materials_and_refers_to_the_map(textured: tuple[Path, Any]) -> None:
    """An EXR contains the map's exact values."""
    import OpenEXR

    folder, made = textured
    document, _ = parts(folder / "irradiance.glb")
    (material,) = document["materials"]
    light_map = material["extras"]["lightMap"]
    assert light_map["texCoord"] == 1 and document["textures"][light_map["index"]]["source"] == 0
    assert light_map["strength"] == pytest.approx(made.irradiance.max(), rel=0.02)
    again = irrsplat.load(str(folder / "irradiance.glb"))  # irrsplat reads the original colours
    assert again.meshes[0].material.albedo == (0.5, 0.5, 0.5) and again.meshes[0].material.albedo_texture is not None
    assert not any("not shown" in notice for notice in again.notices)
    with OpenEXR.File(str(folder / "irradiance.exr")) as file:
        assert np.array_equal(file.channels()["RGB"].pixels, made.irradiance)


@pytest.mark.parametrize("form", ["radiance", "irradiance"])
def test_a_lightmap_of_a_microscopic_mesh_keeps_the_opacity_of_its_vertices(tmp_path: Path, form: Form) -> None:
    """A square of 2 µm under a sky: E = π·L in its map, and alpha in its vertices."""
    pytest.importorskip("xatlas")
    from irrsplat.app.bake import bake_lightmap

    clear = replace(square(side=2e-6, alpha_mode="blend"), opacities=np.array([1.0, 1.0, 0.125, 0.75], np.float32))
    made = bake_lightmap(under_a_sky(clear), 32, **FAST)
    assert np.abs(made.irradiance / (np.pi * np.array(SKY)) - 1.0).max() < 0.01
    (mesh,) = irrsplat.load(made.save(tmp_path / "a.glb", form)[0]).meshes
    assert mesh.opacities is not None and sorted(mesh.opacities.tolist()) == [0.125, 0.75, 1.0, 1.0]


def test_hidden_texels_are_filled_from_their_own_chart() -> None:
    values = np.zeros((4, 6, 3))
    values[:, :3], values[:, 3:] = 1.0, 9.0
    chart = np.repeat([[0, 0, 0, 1, 1, -1]], 4, axis=0)
    known = np.ones((4, 6), bool)
    known[:, 2] = known[:, 5] = False
    values[~known] = 0.0
    y, x = np.indices((4, 6)).astype(float)
    position = np.dstack([x, y, 0.0 * x])
    found = seams.filled(values, known, position, chart)
    assert np.allclose(found[:, 2], 1.0)
    assert np.allclose(found[:, 5], 9.0)


def test_both_sides_of_a_seam_become_equal() -> None:
    pytest.importorskip("xatlas")
    from irrsplat.app.bake.unwrap import Charts

    # in a flat strip, the common edge of two squares has two places in the map
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    here = 2.0 + 10.0 * corners[[0, 1, 2, 3], :2]
    there = np.array([18.0, 2.0]) + 10.0 * (corners[[1, 4, 5, 2], :2] - (1.0, 0.0))
    flat = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    charts = Charts(32, (np.array([0, 1, 2, 3, 1, 4, 5, 2]),), (flat,), (np.concatenate([here, there]),), np.array([0, 0, 1, 1]))
    values = np.zeros((32, 32, 1))
    values[:, :16], values[:, 16:] = 1.0, 2.0
    up = np.broadcast_to([0.0, 0.0, 1.0], (4, 3, 3))
    found = seams.matched(values, charts, corners[faces], up)
    left, right = found[4:10, 11:13].mean(), found[4:10, 17:19].mean()  # both sides of the edge
    assert abs(left - right) < 0.02
    assert abs(left - 1.5) < 0.1
    assert found[6, 6, 0] == 1.0
    assert found[6, 24, 0] == 2.0


def test_divided_triangles_have_no_vertex_within_an_edge() -> None:
    receivers = Receivers.of(under_a_sky(square()))
    cut, random = Cut.whole(receivers), np.random.default_rng(1)
    for _ in range(5):
        edges = cut.edges(receivers)
        cut = cut.divided(edges, edges.conforming(random.random(len(edges.ends)) < 0.2))
    corners = cut.positions(receivers)[cut.faces]
    areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(4.0)
    # an inner edge belongs to two faces, an outer edge to one
    edges = cut.edges(receivers)
    middle = cut.positions(receivers)[edges.ends].mean(1)
    rim = np.abs(np.abs(middle[:, :2]).max(1) - 1.0) < 1e-6
    assert np.array_equal(np.bincount(edges.of_face.ravel()), np.where(rim, 1, 2))


def test_vertex_colours_are_unlit_and_hold_the_sky(tmp_path: Path) -> None:
    """E = π·L in colours that nothing lights again. A scene far from the origin stays there in its file."""
    from irrsplat.app.bake import bake_vertices

    far = np.array([100_000.0, 200_000.0, -50_000.0])
    mesh = square(albedo=(0.5, 0.4, 0.3))
    mesh = replace(mesh, positions=(mesh.positions + far).astype(np.float32))
    eye = (far[0], far[1], far[2] + 5.0)
    made = bake_vertices(Scene((mesh,), (), (Camera(eye, tuple(far.tolist())),), sky=SKY), **FAST)
    assert np.abs(made.irradiance / (np.pi * np.array(SKY)) - 1.0).max() < 0.01
    assert made.complete
    (path,) = made.save(tmp_path / "v.glb")
    document, _ = parts(path)
    (material,) = document["materials"]
    assert material["extensions"] == {"KHR_materials_unlit": {}}
    assert material["pbrMetallicRoughness"]["baseColorFactor"][:3] == [0.5, 0.4, 0.3]
    assert document["asset"]["extras"]["irrsplat"]["strength"] == pytest.approx(3.0, rel=0.02)
    assert np.allclose(trimesh.load_scene(path).bounds.mean(0), far, atol=0.02)


def test_a_bake_has_one_scale_wherever_its_surfaces_lie() -> None:
    """A bake has no camera: squares at the origin and far from it have eyes of one height."""
    from irrsplat.app.bake.light import PlaceLight
    from irrsplat.app.bake.places import places

    receivers = Receivers.of(under_a_sky(*(square(z) for z in (-40.0, 0.0, 0.5, 40.0))))
    triangle, third = np.arange(8).reshape(2, 4), np.full((2, 4), 1.0 / 3.0)
    with PlaceLight(receivers.scene, "default", **FAST) as lights:
        lights.gathered(places(receivers, triangle, third, third), 1.0)
        heights = lights.cache.sites(np.arange(lights.cache.count)).screen_heights
    assert len(heights) > 1 and np.ptp(heights) < 0.01 * heights.max()


def test_charts_fit_a_small_map_wherever_the_scene_lies() -> None:
    """Densities approach the map's side from both ends; the densest charts that fit count, not the last ones."""
    pytest.importorskip("xatlas")
    from irrsplat.app.bake.unwrap import unwrap

    scene = irrsplat.load("cornell")
    for by in (0.0, 32.0):
        meshes = tuple(
            replace(mesh, positions=(mesh.positions + np.array([by, 0.0, 0.0])).astype(np.float32)) for mesh in scene.meshes
        )
        charts = unwrap(Receivers.of(replace(scene, meshes=meshes, lights=())), 64)
        assert all(uv.max(initial=0.0) <= 64.0 for uv in charts.uv)


def test_the_range_of_vertex_colours_counts_light_by_area(tmp_path: Path) -> None:
    """E = π·L everywhere on a large square. The many vertices of a small one, of all colours, have hardly any light."""
    from irrsplat.app.bake import bake_vertices

    coin = trimesh.Trimesh(square(side=0.01).positions + np.array([1.5, 0.0, 0.0]), square().faces)
    for _ in range(6):
        coin = coin.subdivide()
    colours = np.tile(np.linspace(0.0, 1.0, len(coin.vertices))[:, None], 3)
    coloured = irrsplat.make_mesh(coin.vertices, coin.faces, colors=colours)
    (path,) = bake_vertices(under_a_sky(square(), coloured), **FAST).save(tmp_path / "v.glb")
    assert parts(path)[0]["asset"]["extras"]["irrsplat"]["strength"] == pytest.approx(3.0, rel=0.006)


def test_the_command_writes_and_reports_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The terminal and the statistics show the same counts."""
    monkeypatch.chdir(tmp_path)
    words = ["bake", "cornell", "-o", "v.glb", "--to", "vertices", "--most", "2000", "--stats", "s.json", "--bounces", "1"]
    assert cli.main([*words, "--gather-size", "8", "--shadow-size", "128"]) == 0
    out, stats = capsys.readouterr().out, json.loads((tmp_path / "s.json").read_text())
    assert f"vertices    {stats['vertices']:,} of {stats['triangles']:,} triangles" in out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.json", "v.glb"]
