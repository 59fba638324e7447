"""Figure 1 of the paper: its quad bounds a record's sphere, and every view has one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.core.errors import InputError
from irrsplat.image.figures import figure1
from irrsplat.image.tonemap import tonemap

FAST: Any = {"bounces": 1, "gather_size": 8, "shadow_size": 64}


def test_the_quad_bounds_the_silhouette_and_touches_it() -> None:
    """The lines of sight that touch the sphere make a cone of half angle α, sin α = r/d, around the eye vector; in the plane
    through p_k that faces the eye they form a circle of radius d·tan α. The quad's sides must touch that circle."""
    with irrsplat.Renderer(irrsplat.load("cornell"), (200, 180), **FAST) as renderer:
        frame, eye, settings = renderer.render(figures=True), renderer.scene.camera(), renderer.settings
    assert np.abs(frame.figures["quad"] - tonemap(frame.image, frame.exposure)).mean() > 0.05, "a diagram"
    record = figure1.choose_record(frame, eye, settings)
    assert record is not None and (record.position == frame.records_position).all(axis=1).any()
    circle = record.d * np.tan(np.arcsin(record.r / record.d))
    axis = (record.eye - record.position) / record.d
    corners = record.quad - record.position
    assert np.allclose(corners @ axis, 0.0, atol=1e-9), "the quad faces the eye"
    assert np.allclose(np.abs(corners @ np.stack([record.u, record.v]).T), circle)
    assert np.allclose(np.stack([record.u, record.v, axis]) @ np.stack([record.u, record.v, axis]).T, np.eye(3))


@pytest.mark.parametrize(
    ("size", "camera", "settings"),
    [
        ((1, 1), {}, {}),
        ((170, 170), {"eye": (0.0, 3.0001, 0.0), "target": (0.0, 4.0, 0.001)}, {}),  # above the ceiling, looking away
        ((240, 165), {"fov": 150.0}, {"radius_max": 0.0}),
    ],
)
def test_every_view_has_a_figure(size: tuple[int, int], camera: dict[str, Any], settings: dict[str, Any]) -> None:
    scene = irrsplat.load("furnace")
    with irrsplat.Renderer(scene, size=size, **FAST | settings) as renderer:
        frame = renderer.render(replace(scene.camera(), **camera), figures=True)
    drawn = frame.figures["quad"]
    assert drawn.shape == (size[1], size[0], 3) and 0.0 <= drawn.min() <= drawn.max() <= 1.0


def test_the_figure_where_there_is_no_usual_one() -> None:
    """An eye within the sphere has the whole screen for a quad. Where no record is seen, the plain picture stands."""
    with irrsplat.Renderer(irrsplat.load("furnace"), (170, 170), **FAST) as renderer:
        frame, eye, settings = renderer.render(), renderer.scene.camera(), renderer.settings
    plain = tonemap(frame.image, frame.exposure)
    huge, large = replace(settings, a=2.0, radius_max=0.0), np.full_like(frame.records_radius, 10.0)
    inside = replace(frame, records_radius=large)
    record = figure1.choose_record(inside, eye, huge)
    assert record is not None and record.inside
    drawn = figure1.diagram(inside, eye, huge)
    assert np.abs(drawn - plain).mean() > 0.05 and not np.array_equal(drawn, figure1.diagram(frame, eye, settings))
    away = replace(eye, target=tuple(2.0 * np.array(eye.eye) - eye.target))
    for one, camera in ((replace(frame, depth=np.full_like(frame.depth, np.inf)), eye), (frame, away)):
        assert figure1.choose_record(one, camera, settings) is None
        assert np.array_equal(figure1.diagram(one, camera, settings), plain)


def test_a_render_with_figures_tells_of_its_rounds() -> None:
    told: list[int] = []
    with irrsplat.Renderer(irrsplat.load("furnace"), (32, 24), **FAST) as renderer:
        frame = renderer.render(figures=True, progress=lambda now: told.append(now.records))
        with pytest.raises(InputError, match="figures and a quality need records of their own"):
            renderer.render(figures=True, gather=False)
    assert told[-1] == frame.stats["records"] > 0
