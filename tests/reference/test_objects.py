"""Scenes from NumPy arrays and Mitsuba: what they hold, and that their light is what analysis and Mitsuba say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat

UP = (0.0, 1.0, 0.0)
SQUARE = np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 3, 2]])
QUICK: Any = {"bounces": 1, "gather_size": 16, "shadow_size": 256}


def test_arrays_are_lit_as_analysis_has_it() -> None:
    """A light of I W/sr at height h: I/h² straight below; under a sky of radiance L alone: π·L. No substitute is added."""
    floor = irrsplat.make_mesh(SQUARE, FACES, name="floor")
    point_light = irrsplat.Light((0.0, 2.0, 0.0), (8.0, 4.0, 2.0), physical=True)
    lit = irrsplat.make_scene(floor, [point_light])
    assert not any(lit.sky) and lit.lights == (point_light,) and lit.files == ()
    np.testing.assert_allclose(irrsplat.irradiance(lit, [[0, 0, 0]], UP, **QUICK), [[2.0, 1.0, 0.5]], rtol=1e-4)
    for sky in ((1.0, 2.0, 3.0), np.tile([1.0, 2.0, 3.0], (8, 16, 1))):
        under = irrsplat.make_scene([floor], sky=sky)
        np.testing.assert_allclose(irrsplat.irradiance(under, [[0, 0, 0]], UP, **QUICK), np.pi * np.array([[1, 2, 3]]), rtol=2e-3)


def test_a_scene_of_arrays_far_away_is_as_exact() -> None:
    floor = irrsplat.make_mesh(SQUARE + np.array([2.0**20, 0.0, 0.0]), FACES)
    scene = irrsplat.make_scene(floor, sky=(1.0, 1.0, 1.0))
    assert scene.origin[0] == 2.0**20
    np.testing.assert_allclose(irrsplat.irradiance(scene, [[2.0**20, 0, 0]], UP, **QUICK), np.pi, rtol=2e-3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: irrsplat.make_mesh(SQUARE[:, :2], FACES), r"an array \(N, 3\) of numbers, not of shape \(4, 2\)"),
        (lambda: irrsplat.make_mesh(SQUARE * np.nan, FACES), "finite"),
        (lambda: irrsplat.make_mesh(SQUARE, FACES + 1), "expected 0 to 3"),
        (lambda: irrsplat.make_mesh(SQUARE, FACES.astype(float)), "whole numbers"),
        (lambda: irrsplat.make_mesh(SQUARE, FACES, uvs=np.zeros((3, 2))), r"the uvs of a mesh are an array \(4, 2\)"),
        (lambda: irrsplat.make_mesh(SQUARE, FACES, transform=np.diag([0, 0, 0, 1]), name="a"), "would flatten"),
        (lambda: irrsplat.make_mesh(SQUARE, FACES, crease_angle=-1.0), "crease_angle"),
        (lambda: irrsplat.make_mesh(SQUARE, FACES, "red"), "material of a mesh is a Material"),  # type: ignore[arg-type]
        (lambda: irrsplat.make_scene([]), "nothing is left to show"),
        (lambda: irrsplat.make_scene(irrsplat.make_mesh(SQUARE * 0.0, FACES)), "has an area"),
        (lambda: irrsplat.make_scene(irrsplat.make_mesh(SQUARE, FACES), sky=np.zeros((3, 3))), "a sky is a radiance"),
        (lambda: irrsplat.make_scene(irrsplat.make_mesh(SQUARE, FACES), sky=(1.0, -1.0, 0.0)), "from 0 to"),
        (lambda: irrsplat.make_scene(irrsplat.make_mesh(SQUARE, FACES), up="w"), "up is one of"),  # type: ignore[arg-type]
    ],
)
def test_what_cannot_be_is_told_in_a_line(call: Any, words: str) -> None:
    with pytest.raises(irrsplat.InputError, match=words) as raised:
        call()
    assert "\n" not in str(raised.value)


@pytest.fixture
def mitsuba(mitsuba: Any) -> Any:
    """Mitsuba in a variant that is fast enough."""
    return mitsuba.mi


def _box(mitsuba: Any, **parts: Any) -> dict[str, Any]:
    """Mitsuba's Cornell box; parts: replace its light."""
    box: dict[str, Any] = mitsuba.cornell_box()
    box["sensor"]["film"] |= {"width": 48, "height": 48, "rfilter": {"type": "box"}}
    if parts:
        del box["light"]
    return box | parts


def _rgb(*values: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def _lights(mitsuba: Any) -> dict[str, Any]:
    """The box with two lights in place of its panel."""
    above = mitsuba.ScalarTransform4f().look_at([0.5, 0.9, 0.5], [-0.2, -1, -0.2], [1, 0, 0])
    spot = {"type": "spot", "to_world": above, "intensity": _rgb(4, 6, 9), "cutoff_angle": 40, "beam_width": 20}
    return _box(mitsuba, point={"type": "point", "position": [0.3, 0.5, 0.2], "intensity": _rgb(3, 2, 1)}, spot=spot)


@pytest.mark.long
@pytest.mark.parametrize(("make", "bias", "median"), [(_box, 0.006, 0.03), (_lights, 0.006, 0.04)])
def test_light_agrees_with_mitsubas_path_tracer(mitsuba: Any, make: Any, bias: float, median: float) -> None:
    """Radiance, of which Mitsuba renders its own scene: the mean of each colour, and the median of pixels' differences."""
    theirs = mitsuba.load_dict(make(mitsuba))
    integrator = mitsuba.load_dict({"type": "path", "max_depth": 16})
    truth = np.array(mitsuba.render(theirs, spp=1024, integrator=integrator))
    scene = irrsplat.from_mitsuba(theirs)
    assert scene.notices == ()
    image = irrsplat.render(scene, (48, 48), samples=16, backdrop="sky").image
    np.testing.assert_allclose(image.mean((0, 1)), truth.mean((0, 1)), rtol=bias)
    assert np.median(np.abs(image - truth) / np.maximum(truth, 0.01)) < median


def test_a_file_of_mitsuba_loads_alike_each_time(mitsuba: Any, tmp_path: Any) -> None:
    """Mitsuba has shapes without a name in another order at each load: records would lie elsewhere, and truths be lost."""
    shape = '<shape type="rectangle"><transform name="to_world"><translate x="{}" /></transform></shape>'
    path = tmp_path / "row.xml"
    path.write_text(f'<scene version="3.0.0">{"".join(shape.format(3 * i) for i in range(40))}</scene>')
    rows = [[float(mesh.positions[:, 0].mean()) for mesh in irrsplat.from_mitsuba(path).meshes] for _ in range(2)]
    assert rows[0] == rows[1]
    assert sorted(round(x) for x in rows[0]) == list(range(0, 120, 3))


def test_what_mitsuba_has_beyond_it_is_told(mitsuba: Any) -> None:
    parts = {
        "glossy": {"type": "sphere", "bsdf": {"type": "roughplastic", "diffuse_reflectance": _rgb(0.1, 0.2, 0.3)}},
        "metal": {"type": "disk", "bsdf": {"type": "conductor"}},
        "glass": {"type": "disk", "bsdf": {"type": "dielectric"}},
        "group": {"type": "shapegroup", "inner": {"type": "sphere"}},
        "many": {"type": "instance", "of": {"type": "ref", "id": "group"}},
        "slide": {"type": "projector", "irradiance": 1.0},
    }
    scene = irrsplat.from_mitsuba(_box(mitsuba, **parts))
    said = "\n".join(scene.notices)
    for words in ("RoughPlastic", "SmoothConductor", "clear glass", "Instance", "Projector"):
        assert words in said
    assert scene.meshes[[mesh.name for mesh in scene.meshes].index("glossy")].material.albedo == pytest.approx((0.1, 0.2, 0.3))


def test_bitmaps_of_files_keep_their_colours_and_masks(mitsuba: Any, tmp_path: Any) -> None:
    """Grey of 128 in sRGB stays 128; raw, it is a reflectance of 128/255, which sRGB writes as 188. The mask has a hole below."""
    grey = Image.new("RGB", (4, 4), (128, 128, 128))
    grey.save(tmp_path / "a.png")
    grey.save(tmp_path / "a.jpg", quality=100)
    Image.fromarray(np.repeat(np.array([255, 0], np.uint8), 32).reshape(8, 8)).save(tmp_path / "hole.png")

    def bitmap(name: str, **more: Any) -> dict[str, Any]:
        return {"type": "bitmap", "filename": str(tmp_path / name), **more}

    def seen(bsdf: dict[str, Any]) -> tuple[str, np.ndarray]:
        point_light = {"type": "constant"}
        (mesh,) = irrsplat.from_mitsuba({"type": "scene", "a": {"type": "rectangle", "bsdf": bsdf}, "lamp": point_light}).meshes
        assert mesh.material.albedo_texture is not None
        return mesh.material.alpha_mode, mesh.material.albedo_texture.image.pixels

    for picture, value in ((bitmap("a.png"), 128), (bitmap("a.jpg"), 128), (bitmap("a.png", raw=True), 188)):
        diffuse = {"type": "diffuse", "reflectance": picture}
        assert np.abs(seen(diffuse)[1][..., :3].astype(int) - value).max() <= 1
        mode, pixels = seen({"type": "mask", "opacity": bitmap("hole.png"), "inner": {"type": "twosided", "inner": diffuse}})
        assert mode == "mask" and np.abs(pixels[..., :3].astype(int) - value).max() <= 1
        assert pixels[..., 3].tolist() == [[255] * 8] * 4 + [[0] * 8] * 4


def test_a_lamp_of_mitsuba_is_dark_behind(mitsuba: Any) -> None:
    """No light above a disk that emits downward; below it, at height h under a radius r, π·L·r²/(r² + h²)."""
    down = mitsuba.ScalarTransform4f().translate([0, 1, 0]).rotate([1, 0, 0], 90)
    point_light = {"type": "disk", "to_world": down, "emitter": {"type": "area", "radiance": _rgb(1, 2, 3)}}
    scene = irrsplat.from_mitsuba({"type": "scene", "lamp": point_light})
    E = irrsplat.irradiance(scene, [[0, 0, 0], [0, 2, 0]], [[0, 1, 0], [0, -1, 0]], bounces=1, light_samples=4096)
    np.testing.assert_allclose(E[0], 0.5 * np.pi * np.array([1, 2, 3]), rtol=0.01)
    assert not E[1].any()


def test_mitsubas_errors_are_one_line(mitsuba: Any, tmp_path: Any) -> None:
    (tmp_path / "bad.xml").write_text("<scene version='3.0.0'><shape type='nonsense'/></scene>")
    mitsuba.set_variant("llvm_ad_mono")
    grey = mitsuba.load_dict({"type": "scene"})
    sources: tuple[Any, ...] = (tmp_path / "bad.xml", tmp_path / "missing.xml", {"type": "sphere"}, {"type": "furz"}, 3, grey)
    for source in sources:
        with pytest.raises(irrsplat.InputError) as raised:
            irrsplat.from_mitsuba(source)
        assert "\n" not in str(raised.value)
    assert mitsuba.variant() == "llvm_ad_mono"
