"""Scenes from NumPy arrays: what they hold, and that their light is what analysis has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

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
