"""glTF's materials, textures, cameras and lights, in this project's units."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np
import pytest

from irrsplat.scene import Camera, Light, Material, Mesh
from tests.support.gltf_files import GltfFile, encoded, typed

pytestmark = pytest.mark.usefixtures("without_stand_ins")

HALF = math.sqrt(0.5)
PIXELS = typed(np.uint8, [[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [9, 9, 9, 0]]])  # red green / blue clear


@pytest.fixture
def mesh_with(file: GltfFile, show):
    """Return the mesh with a material and these attributes."""

    def mesh_with(material: dict[str, Any], **attributes: Any) -> Mesh:
        file.tree.pop("nodes", None)
        file.node(mesh=file.mesh(material, **attributes))
        (mesh,) = show().meshes
        return mesh

    return mesh_with


def base(**metallic_roughness: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": metallic_roughness}


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({}, Material((1, 1, 1), double_sided=False)),
        (base(baseColorFactor=[0.123456, 0.5, 2, 1], metallicFactor=1), Material((0.123456, 0.5, 1), double_sided=False)),
        ({"doubleSided": True}, Material((1, 1, 1))),
        (
            {"emissiveFactor": [0.5, 0.25, 0], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8}}},
            Material((1, 1, 1), (4, 2, 0), double_sided=False),
        ),
        (
            {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.1, 0.2, 0.3, 1]}}},
            Material((0.1, 0.2, 0.3), double_sided=False),
        ),
        (
            {**base(baseColorFactor=[1, 0.5, 0, 1]), "extensions": {"KHR_materials_pbrSpecularGlossiness": {}}},
            Material((1, 0.5, 0), double_sided=False),
        ),
        (
            {**base(baseColorFactor=[0.1, 0.2, 0.3, 1]), "emissiveFactor": [9, 9, 9], "extensions": {"KHR_materials_unlit": {}}},
            Material((0, 0, 0), (0.1, 0.2, 0.3), double_sided=False, unlit=True),
        ),
        (
            {**base(metallicFactor=0.25), "extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.8}}},
            Material((1, 1, 1), transmission=0.8 * 0.75, double_sided=False),
        ),
        (
            {**base(baseColorFactor=[1, 1, 1, 0.25]), "alphaMode": "MASK", "alphaCutoff": 0.1},
            Material((1, 1, 1), opacity=0.25, alpha_mode="mask", alpha_cutoff=0.1, double_sided=False),
        ),
    ],
)
def test_a_material_has_the_values_of_its_entry(mesh_with, entry, expected):
    assert mesh_with(entry).material == expected


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_vertex_colours_are_linear_factors_of_colour_and_opacity(mesh_with, kind):
    # (1, 1/2, 0) and an alpha of 1/4 times a base colour of (1, 1/2, 1) and an alpha of 1/2
    most = 1.0 if kind is np.float32 else float(np.iinfo(kind).max)
    colors = np.tile(np.array([1, 0.5, 0, 0.25]) * most, (4, 1)).astype(kind)
    mesh = mesh_with({**base(baseColorFactor=[1, 0.5, 1, 0.5]), "alphaMode": "BLEND"}, COLOR_0=colors)
    np.testing.assert_allclose(mesh.colors, [[1, 0.25, 0]] * len(mesh.positions), atol=0.002)
    assert mesh.opacities is not None
    np.testing.assert_allclose(mesh.opacities, 0.125, atol=0.002)
    opaque = mesh_with(base(), COLOR_0=np.ascontiguousarray(colors[:, :3]))
    assert opaque.opacities is None
    np.testing.assert_allclose(opaque.colors, [[1, 0.5, 0]] * len(mesh.positions), atol=0.002)


def test_textures_share_images_with_separate_mappings(file, mesh_with):
    index = file.texture(PIXELS, wrapS=33071, wrapT=33648, magFilter=9728)
    plain = file.add("textures", {"source": file.tree["textures"][index]["source"]})
    entry = {
        **base(baseColorTexture={"index": index}),
        "emissiveTexture": {"index": plain, "texCoord": 1},
        "emissiveFactor": [1, 1, 1],
        "normalTexture": {"index": plain, "scale": 0.5},
    }
    material = mesh_with(entry, TEXCOORD_0=np.zeros((4, 2), np.float32)).material
    assert (material.albedo_texture.wrap, material.albedo_texture.nearest) == (("clamp", "mirror"), True)
    assert (material.emission_texture.wrap, material.emission_texture.nearest) == (("repeat", "repeat"), False)
    assert (material.albedo_texture.uv_set, material.emission_texture.uv_set, material.normal_scale) == (0, 1, 0.5)
    assert material.albedo_texture.image is material.emission_texture.image is material.normal_texture.image
    np.testing.assert_array_equal(material.albedo_texture.image.pixels, PIXELS)


def test_a_texture_transform_scales_turns_and_moves(file, mesh_with):
    # the example of KHR_texture_transform: the lower left quadrant, turned clockwise; and its texCoord overrides
    moved = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5], "texCoord": 1}
    info = {"index": file.texture(PIXELS), "texCoord": 0, "extensions": {"KHR_texture_transform": moved}}
    texture = mesh_with(base(baseColorTexture=info), TEXCOORD_1=np.ones((4, 2), np.float32)).material.albedo_texture
    assert texture.uv_set == 1
    a, b, c, d, e, f = texture.transform
    corners = [(a * u + b * v + c, d * u + e * v + f) for u, v in ((0, 0), (1, 0), (0, 1), (1, 1))]
    np.testing.assert_allclose(corners, np.array([[0, 1], [0, 0.5], [0.5, 1], [0.5, 0.5]]), atol=1e-12)


@pytest.mark.parametrize("way", ["data", "file", "webp", "ktx2"])
def test_images_are_found_wherever_a_file_may_keep_them(file, mesh_with, tmp_path, way):
    index = file.texture(PIXELS)
    if way == "data":
        file.tree["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(encoded(PIXELS) + b"\0").decode().rstrip("=")}]
    elif way == "file":
        (tmp_path / "my maps").mkdir()
        (tmp_path / "my maps" / "wood.png").write_bytes(encoded(PIXELS))
        file.tree["images"] = [{"uri": "my%20maps\\Wood.png"}]
    elif way == "webp":
        file.tree["textures"][index] = {"extensions": {"EXT_texture_webp": {"source": 1}}}
        file.texture(PIXELS, "WebP")
    else:
        alktx2 = pytest.importorskip("alktx2")
        packed = alktx2.encode_bytes_to_ktx2(encoded(PIXELS.repeat(8, 0).repeat(8, 1)), mime="image/png", codec="uastc")
        image = file.add("images", {"bufferView": file.view(packed)})
        file.tree["textures"][index] = {"source": 99, "extensions": {"KHR_texture_basisu": {"source": image}}}
    pixels = mesh_with(base(baseColorTexture={"index": index})).material.albedo_texture.image.pixels
    step = pixels.shape[0] // 2
    np.testing.assert_allclose(pixels[step // 2 :: step, step // 2 :: step, :3], PIXELS[..., :3], atol=12 if way == "ktx2" else 0)


def projected(camera: Camera, point: tuple[float, float, float]) -> np.ndarray:
    """Return (2,) the projection of a point: -1 to 1 from left to right and from bottom to top of a square picture."""
    clip = camera.clip_from_view(1.0, 1.0, 1e7) @ camera.view_from_world @ [*point, 1.0]
    return clip[:2] / clip[3]


def test_cameras_have_the_name_and_direction_of_their_node(file, show):
    # the node is turned a quarter about z and scaled; its camera has the view direction -z and up -x
    file.node(mesh=file.mesh())
    add_camera = {"type": "perspective", "perspective": {"yfov": math.pi / 2, "aspectRatio": 2, "znear": 0.1}}
    first, second = file.add("cameras", {**add_camera, "name": "own"}), file.add("cameras", add_camera)
    place: dict[str, Any] = {"rotation": [0, 0, HALF, HALF], "translation": [0, 0, 5], "scale": [3, 3, 3]}
    file.node(camera=first, name="node", **place)
    file.node(camera=first)
    file.node(camera=second)
    file.node(camera=second, name="node")
    scene = show()
    assert [camera.name for camera in scene.cameras] == ["node", "own", "camera 3", "node 2"]
    camera = scene.camera("node")
    assert camera is scene.cameras[0] and camera.fov == pytest.approx(90)
    np.testing.assert_allclose(camera.axes, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(projected(camera, (-1, 0, 3)), [0, 0.5], atol=1e-12)


def test_an_orthographic_camera_draws_parallels(file, show):
    """With ymag 2, y = 1 is at half height at any depth."""
    file.node(mesh=file.mesh())
    add_camera = {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 2, "znear": 0.1, "zfar": 10}}
    file.node(camera=file.add("cameras", add_camera), translation=[0, 0, 3])
    for depth in (-1, 0, 1):
        np.testing.assert_allclose(projected(show().cameras[0], (-1, 1, depth)), [-0.5, 0.5], atol=1e-3)


def test_lights_keep_their_units_directions_and_cones(file, show):
    # lux: a surface perpendicular to the light has E = π·diffuse; the node turns -z to -x about y, so light comes from +x
    lights = [
        {"type": "directional", "intensity": math.pi, "color": [1, 0.5, 0]},
        {"type": "point", "intensity": 40, "color": [1, 0.5, 0], "range": 3, "name": "bulb"},
        {"type": "spot", "intensity": 8, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}},
        {"type": "spot"},
    ]
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    file.node(mesh=file.mesh())
    for i in range(len(lights)):
        place = {"rotation": [0, HALF, 0, HALF], "translation": [1, 2, 3]}
        file.node(extensions={"KHR_lights_punctual": {"light": i}}, **place)
    sun, bulb, spot, default = show().lights
    np.testing.assert_allclose(sun.position, [1, 0, 0], atol=1e-12)
    assert sun.directional and sun.color == pytest.approx((1, 0.5, 0))
    assert bulb == Light((1, 2, 3), (40, 20, 0), physical=True, name="bulb")
    np.testing.assert_allclose(spot.spot_target, [0, 2, 3], atol=1e-12)
    assert spot.physical and spot.color == (8, 8, 8)
    assert (spot.spot_inner, spot.spot_cutoff) == pytest.approx((math.degrees(0.1), math.degrees(0.2)))
    assert (default.spot_inner, default.spot_cutoff, default.color) == (0, pytest.approx(45), (1, 1, 1))


def test_photometric_files_have_179_lumen_in_a_watt(file, show):
    """glTF has candela, lux and cd/m². Radiance's 179 lm/W make them watts. Reflectances, and so unlit colours, have no unit."""
    lights = [{"type": "point", "intensity": 500}, {"type": "directional", "intensity": 179 * math.pi}]
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    for i in range(len(lights)):
        file.node(extensions={"KHR_lights_punctual": {"light": i}})
    glow = {"emissiveFactor": [1, 0.5, 0], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 358}}}
    file.node(mesh=file.mesh(glow))
    file.node(mesh=file.mesh(base(baseColorFactor=[0.25, 0.5, 1, 1]) | {"extensions": {"KHR_materials_unlit": {}}}))
    scene = show(photometric=True, sky="179 358 0")
    assert scene.sky == pytest.approx((1, 2, 0))
    assert [light.color for light in scene.lights] == [pytest.approx((500 / 179,) * 3), pytest.approx((1,) * 3)]
    assert [mesh.material.emission for mesh in scene.meshes] == [pytest.approx((2, 1, 0)), (0.25, 0.5, 1)]


def test_a_damaged_material_camera_or_light_costs_only_itself(file, show):
    file.node(mesh=file.mesh())
    paint = file.mesh(base(baseColorFactor=[1, "x", 0, 1]))
    lost = [file.add("textures", {"source": file.add("images", {"uri": name})}) for name in ("gone.png", "lost.png")]
    entry = {"emissiveTexture": {"index": lost[1]}, "emissiveFactor": [0.5, 0.5, 0.5]}
    file.node(mesh=file.mesh({**base(baseColorTexture={"index": lost[0]}), **entry}))
    file.node(mesh=paint, camera=file.add("cameras", {"type": "perspective"}))
    file.node(camera=file.add("cameras", {"type": "perspective", "perspective": {"yfov": 1}}), scale=[0, 0, 0], name="flat")
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": []}}
    file.node(extensions={"KHR_lights_punctual": {"light": 5}})
    scene = show()
    assert [mesh.material.albedo for mesh in scene.meshes] == [(0.5, 0.5, 0.5), (1, 1, 1), (0.5, 0.5, 0.5)]
    assert not scene.emissive, "the texture says where the surface emits"
    for line in (
        "material 0 is left out: its baseColorFactor is damaged",
        "the camera of node 2 is left out: its perspective is damaged",
        "the camera of node 'flat' is left out: the scale of its node is 0",
        "the light of node 4 is left out: there is no light 5",
        "gone.png and 1 more images are missing; surfaces are shown without them",
    ):
        assert any(notice.startswith(f"{scene.path}: {line}") for notice in scene.notices), scene.notices
