"""No holes in a converged view: after any changes, every surface pixel has a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gpu.target import pixels
from irrsplat.image.view import Progress, View
from irrsplat.scene.model import Camera
from tests.renderer.test_move import shift
from tests.renderer.test_renderer import FAST, FRONT, room
from tests.support.worlds import box, point_light, scene


def holes(view: View) -> int:
    """Return the number of surface pixels without a record."""
    seen = pixels(view.gbuffer.position)[..., 3] > 0.0
    return int(np.count_nonzero(seen & (pixels(view.splats.weight)[..., 0] <= 0.0)))


def rest(renderer: Renderer, camera: Camera | None, seconds: float | None, most: int = 4000) -> tuple[View, list[Progress]]:
    """Render frames until no record is gathered."""
    told: list[Progress] = []
    while not (told and told[-1].still):
        assert len(told) < most, f"no rest: {told[-1]}"
        view, progress = renderer.frame(camera, seconds)
        told.append(progress)
    return view, told


def relit(renderer: Renderer) -> None:
    renderer.relight([point_light((-0.8, -0.6, 0.7), 5.0)])


def moved(renderer: Renderer) -> None:
    renderer.move(1, shift(0.5, 0.6, 0.3))


def coarser(renderer: Renderer) -> None:
    renderer.change(replace(renderer.settings, a=0.9, weights="paper"))
    renderer.change(replace(renderer.settings, a=0.4, radius_max=7.0))


@pytest.mark.parametrize("second", [relit, coarser])
def test_no_hole_at_rest_after_changes(second: Callable[[Renderer], None]) -> None:
    """A box moves, and a second change follows before convergence. The fuzzers of tests/trust try many more."""
    with Renderer(room(), (64, 48), **FAST) as renderer:
        rest(renderer, FRONT, 0.02)
        moved(renderer)
        renderer.frame(FRONT, 0.002)
        second(renderer)
        view, told = rest(renderer, FRONT, 0.05)
        assert holes(view) == 0, told[-1]


def test_the_inside_of_a_closed_mesh_requests_records_only_with_a_light_in_it() -> None:
    """Without a light in it, every record there would be black, and would cover its own pixel alone."""
    within = Camera((0.0, 0.0, 0.0), (0.3, 0.2, 1.0), (0.0, 1.0, 0.0), 60.0)
    with Renderer(scene(box((-3, -3, -3), (3, 3, 3), outward=False), box((-1, -1, -1), (1, 1, 1))), (64, 48), **FAST) as renderer:
        renderer.relight([point_light((2.0, 0.0, 0.0), 5.0)])
        view, statistics = renderer.converge(within)
        assert statistics["records"] == 0 and statistics["coverage"] == 1.0
        assert not view.read().irradiance.any()
        renderer.relight([point_light((0.5, 0.0, 0.0), 5.0)])
        view, statistics = renderer.converge(within)
        assert statistics["records"] > 0 and holes(view) == 0
        assert view.read().irradiance.mean() > 0.1
