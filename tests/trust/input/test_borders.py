"""Validation of the library's arguments at construction, with messages in the caller's terms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat import Camera, InputError, Light, Material, Mesh, Scene, Settings

NAN, HUGE = float("nan"), 1e300
POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
MESH = Mesh(POSITIONS, np.tile(np.array([0, 0, 1], np.float32), (3, 1)), np.array([[0, 1, 2]], np.int32), name="tri")
LIGHT = Light((0, 0, 2), (1, 1, 1), name="bulb")
CAMERA = Camera((0, 0, 3), (0, 0, 0))
SCENE = Scene((MESH,), (LIGHT,), (CAMERA,))
ODD_TRIPLES = [(NAN, 0, 0), (HUGE, 0, 0), (1, 2), "abc", None, 3, (1, 2, "x"), [[1, 2, 3]], (10**400, 0, 0)]


TRIPLES = [(LIGHT, "position color attenuation"), (CAMERA, "eye up"), (SCENE, "sky up"), (MESH.material, "albedo emission")]


@pytest.mark.parametrize(("thing", "fields"), TRIPLES)
def test_triples_are_three_finite_numbers(thing: Any, fields: str) -> None:
    for field in fields.split():
        for value in ODD_TRIPLES:
            with pytest.raises(InputError, match=f"{field}.* takes 3 finite numbers"):
                replace(thing, **{field: value})


@pytest.mark.parametrize(
    ("thing", "field", "value", "message"),
    [
        (LIGHT, "color", (-1, 0, 0), "the color of light 'bulb'"),
        (LIGHT, "attenuation", (0, 0, 0), "division by zero"),
        (LIGHT, "spot_cutoff", -4, "spot_cutoff"),
        (replace(LIGHT, directional=True), "position", (0, 0, 0), "direction towards it"),
        (LIGHT, "spot_exponent", NAN, "spot_exponent"),
        (LIGHT, "photometry", 3, "Photometry"),
        (CAMERA, "fov", "x", "field of view"),
        (MESH.material, "albedo", (2, 0, 0), "albedo"),
        (MESH.material, "alpha_mode", "cut", "alpha_mode is one of"),
        (MESH.material, "opacity", 2, "opacity"),
        (MESH.material, "albedo_texture", "p.png", "Texture"),
        (MESH, "positions", POSITIONS.tolist(), "the positions of mesh 'tri'"),
        (MESH, "positions", POSITIONS * NAN, "finite"),
        (MESH, "positions", POSITIONS * np.float32(1e30), "at most 1e+15"),
        (MESH, "faces", MESH.faces + 1, "expected 0 to 2"),
        (MESH, "faces", MESH.faces.astype(float), "whole numbers"),
        (MESH, "colors", np.ones((2, 3), "f4"), "the colors"),
        (MESH, "material", None, "Material"),
        (SCENE, "meshes", None, "sequence of Mesh"),
        (SCENE, "environment", 3, "Environment"),
        (SCENE, "up", (0, 0, 0), "0 0 0"),
    ],
    ids=str,
)  # fmt: skip
def test_invalid_values_are_refused_at_construction(thing, field, value, message):
    with pytest.raises(InputError) as caught:
        replace(thing, **{field: value})
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_arrays_and_lists_give_equal_values():
    light = Light(np.array([0, 0, 2]), [1, np.float32(1), 1.0])  # type: ignore[arg-type]
    assert light.key == replace(LIGHT, name="").key and light == replace(LIGHT, name="")
    assert Scene([MESH], [LIGHT], [CAMERA]).meshes == (MESH,)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda r: r.relight([3]), "is a Light, not int"),
        (lambda r: r.repaint(0, None), "is a Material"),
        (lambda r: r.change({"a": 1}), "is a Settings"),
        (lambda r: r.pose(None), "is a Scene"),
        (lambda r: r.refine(None, NAN), "target"),
        (lambda r: r.frame(seconds="x"), "seconds is a number"),
        (lambda r: r.render(5), "a camera is a Camera"),
        (lambda r: r.resize("ab"), "two whole numbers"),
        (lambda r: r.save_cache(None), "a path is a text"),
        (lambda r: r.load_cache("a\0b"), "no file can be called"),
    ],
)
def test_a_refused_call_leaves_a_renderer_unchanged(renderer, act, message):
    before = renderer.scene, renderer.settings, renderer.size
    with pytest.raises(InputError, match=message):
        act(renderer)
    assert (renderer.scene, renderer.settings, renderer.size) == before


@pytest.fixture(scope="module")
def renderer():
    with irrsplat.Renderer(SCENE, (8, 8)) as made:
        yield made


def test_module_functions_refuse_invalid_arguments():
    odd: Any = 3
    for wrong in (
        lambda: irrsplat.render(odd),
        lambda: irrsplat.irradiance(odd, [[0, 0, 1]], [0, 0, -1]),
        lambda: irrsplat.preset(odd),
    ):
        with pytest.raises(InputError):
            wrong()
    with pytest.raises(InputError, match="at most 1e"):
        irrsplat.irradiance(SCENE, [[0, 0, HUGE]], [0, 0, -1])
    with pytest.raises(InputError, match="no camera"):
        irrsplat.render(replace(SCENE, cameras=()), (8, 8))
    with pytest.raises(InputError):
        Settings(a=NAN)
    assert Material().albedo == (0.5, 0.5, 0.5)


def test_a_camera_in_a_corner_needs_few_records() -> None:
    room = irrsplat.load("cornell")
    corner = tuple(room.bounds[1] * [0.0, 0.0, 1.0])
    with irrsplat.Renderer(room, (32, 32), bounces=1, gather_size=8) as r:
        frame = r.render(Camera(corner, tuple(room.bounds.mean(0))))
    assert frame.stats["converged"] and frame.stats["records"] < 600
    assert frame.depth.min() > 1e-3
