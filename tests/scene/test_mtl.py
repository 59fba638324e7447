"""The material library of an .obj: colours, textures with their options, opacity, and oddities."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from irrsplat.scene import load
from irrsplat.scene.model import Material, Scene

pytestmark = pytest.mark.usefixtures("without_stand_ins")

OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0 0\nvt 1 1\nvt 0\nusemtl a\nf 1/1 2/2 3/3 4/4\n"
RED = np.full((2, 2, 3), (255, 0, 0), np.uint8)


@pytest.fixture
def mtl(tmp_path: Path) -> Callable[..., Scene]:
    """Load a square of the material `a` in the library `text`; images are saved in its folder by name."""

    def mtl(text: str | bytes, **images: np.ndarray) -> Scene:
        for name, pixels in images.items():
            Image.fromarray(pixels).save(tmp_path / f"{name}.png")
        (tmp_path / "a.obj").write_text(OBJ)
        (tmp_path / "a.mtl").write_bytes(text.encode() if isinstance(text, str) else text)
        return load(tmp_path / "a.obj")

    return mtl


def material(scene: Scene) -> Material:
    return scene.meshes[0].material


def not_none(value: Any) -> Any:
    """Return `value`, which is not None."""
    assert value is not None
    return value


def alpha(values: np.ndarray | list[list[int]], rgb: int = 200) -> np.ndarray:
    """Return (H, W, 4) grey with these alphas."""
    a = np.asarray(values, np.uint8)
    return np.dstack([np.full((*a.shape, 3), rgb, np.uint8), a])


LEAF = np.array([[255] * 5 + [0] * 5] * 10, np.uint8)
GLASS = np.array([[255] * 5 + [90] * 5] * 10, np.uint8)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("Kd 1.5 -1 0.5 0.1 # note", {"albedo": (1, 0, 0.5)}),
        ("kd 0.25", {"albedo": (0.25, 0.25, 0.25)}),
        ("", {"albedo": (0.5, 0.5, 0.5), "opacity": 1, "alpha_mode": "opaque", "double_sided": True}),
        ("Ke 3 2 -1", {"emission": (3, 2, 0)}),
        ("d -halo 0.25", {"opacity": 0.25, "alpha_mode": "blend"}),
        ("Tr 0.75", {"opacity": 0.25, "alpha_mode": "blend"}),
        ("Tr 0.9\nd 1", {"opacity": 1, "alpha_mode": "opaque"}),
        ("d 0", {"opacity": 1, "alpha_mode": "opaque"}),
        ("Kd 0 0 0\nmap_Kd red.png", {"albedo": (1, 1, 1)}),
        ("Kd 0.5 1 1\nmap_Kd red.png", {"albedo": (0.5, 1, 1), "alpha_mode": "opaque"}),
        ("Ke 0 0 0\nmap_Ke red.png", {"emission": (1, 1, 1)}),
        ("Kd 0 0 0\nillum 7\nTf 0.9 1 0.9", {"albedo": (0.9, 1, 0.9), "transmission": 1}),
        ("Kd 0 0 0\nillum 5\nKs 0.9 0.8 0.7", {"albedo": (0.9, 0.8, 0.7), "transmission": 0}),
        ("norm -bm 0.3 red.png", {"normal_scale": 0.3}),
        ("norm -bm x red.png", {"normal_scale": 1}),
        ("Kd 0 0 0\nmap_Kd gone.png", {"albedo": (0.5, 0.5, 0.5)}),
        ("Kd 0 0 0\nillum 2\nKs 1 1 1", {"albedo": (0, 0, 0)}),
    ],
)
def test_values(mtl, lines, expected):
    found = material(mtl(f"newmtl a\n{lines}\n", red=RED))
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value) if name != "alpha_mode" else found.alpha_mode == value


def test_every_texture_has_its_place(mtl):
    images = {"red": RED, "green": RED[..., [1, 0, 2]], "blue": RED[..., [1, 2, 0]]}
    scene = mtl("newmtl a\nmap_Kd red.png # the first\nmap_Ke green.png\nmap_Kn blue.png\n", **images)
    found = material(scene)
    textures = found.albedo_texture, found.emission_texture, found.normal_texture
    assert [not_none(texture).image.pixels[0, 0, :3].tolist() for texture in textures] == np.diag([255] * 3).tolist()
    assert len(scene.files) == 5
    mesh = scene.meshes[0]  # v upward becomes v downward; a missing v is 0
    uvs = {tuple(p[:2]): uv[:2] for p, uv in zip(mesh.positions.tolist(), not_none(mesh.uvs).tolist(), strict=True)}
    assert uvs == {(0, 0): [0, 1], (1, 0): [1, 1], (1, 1): [1, 0], (0, 1): [0, 1]}


@pytest.mark.parametrize(
    ("options", "name", "s", "o", "wrap"),
    [
        ("", "1.png", (1, 1), (0, 0), "repeat"),
        ("-s 2 3 1 -o .25 .5 0 -clamp on -bm 0.3", "red.png", (2, 3), (0.25, 0.5), "clamp"),
        ("-blendu on -o 0.5 -mm 0 1 -texres 512 -clamp off -s 2", "my red.png", (2, 1), (0.5, 0), "repeat"),
        ("-imfchan r -type sphere -colorspace sRGB -t 1 1 1 -s 1 -2 1", "1.png", (1, -2), (0, 0), "repeat"),
    ],
)
def test_options_stand_before_the_file(mtl, tmp_path, options, name, s, o, wrap):
    # a point (u, v), v upward, shows the image's (s u + o, …): so the model's, downward, shows 1 - (s (1 - v) + o)
    Image.fromarray(RED).save(tmp_path / name)
    texture = not_none(material(mtl(f"newmtl a\nmap_Kd {options} {name}\n")).albedo_texture)
    a, b, c, d, e, f = texture.transform
    for u, v in ((0, 0), (1, 0), (0.3, 0.8)):
        assert (a * u + b * v + c, d * u + e * v + f) == pytest.approx((s[0] * u + o[0], 1 - (s[1] * (1 - v) + o[1])))
    assert texture.wrap == (wrap, wrap)


@pytest.mark.parametrize(
    ("lines", "mode", "means"),
    [
        ("map_Kd leaf.png", "mask", (255, 0)),
        ("map_Kd glass.png", "blend", (255, 90)),
        ("map_Kd none.png", "opaque", None),
        ("map_Kd gloss.png", "opaque", None),
        ("map_Kd full.png\nmap_d shape.png", "mask", (255, 0)),
        ("map_Kd full.png\nmap_d -imfchan r shape.png", "mask", (255, 0)),
        ("map_Kd leaf.png\nd 0.5", "blend", (255, 0)),
        ("map_Kd full.png\nmap_d leaf.png", "mask", (255, 0)),  # by its alpha
        ("map_Kd full.png\nmap_d -imfchan m shape.png", "opaque", None),
    ],
)
def test_an_alpha_channel_implies_its_mode(mtl, lines, mode, means):
    # only 0 and 255: a mask; much between: blended; all 0 or a picture under it: no opacity at all
    picture = alpha(LEAF)
    picture[..., :3] = np.random.default_rng(0).integers(0, 255, (10, 10, 3))
    shape = np.repeat(np.repeat(np.dstack([LEAF] * 3), 2, 0), 2, 1)  # black and white, twice the size
    images = {"leaf": alpha(LEAF), "glass": alpha(GLASS), "full": alpha(LEAF | 255), "none": alpha(LEAF & 0), "gloss": picture}
    found = material(mtl(f"newmtl a\n{lines}\n", shape=shape, **images))
    assert found.alpha_mode == mode
    if means:
        pixels = not_none(found.albedo_texture).image.pixels
        assert (pixels[0, 0, 3], pixels[0, -1, 3]) == means and len(pixels) == (20 if "shape" in lines else 10)
        assert found.albedo == (0.5, 0.5, 0.5) if "map_Kd" not in lines else found.albedo == (1, 1, 1)
        assert pixels[0, 0, 0] == (200 if "map_Kd" in lines else 255)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("Kd 1 x 0", "a.mtl:2: Kd: 'x' is not a number; the line is left out"),
        ("Kd\nKd xyz 1 2 3\nKe 1 2", "a.mtl:2: Kd: 0 values; expected 3; 3 such lines are left out"),
        ("map_Kd", "a.mtl:2: map_Kd: no file is named"),
        ("map_Kd gone.png\nmap_Ke lost.png", "there is no image 'gone.png' and 1 more"),
        ("map_Kd a.obj", "cannot read the image 'a.obj'"),
        ("bump -bm 2 b.png\nmap_bump c.png", "a.mtl: 2 height maps (bump, disp) not shown"),
        ("d 0", "every material is fully transparent"),
    ],
)
def test_a_strange_line_costs_itself_and_a_notice(mtl, lines, message):
    scene = mtl(f"newmtl a\n{lines}\nKe 1 2 3\n")
    assert sum(message in notice for notice in scene.notices) == 1, scene.notices
    assert material(scene).emission == (1, 2, 3) and material(scene).albedo == (0.5, 0.5, 0.5)
