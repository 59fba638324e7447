"""Figure 1: the record that it shows is a true one, its sphere and quad are the shader's, and it can be drawn in every scene."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.image.figures import cutaway, figure1
from irrsplat.image.frame import Frame
from irrsplat.image.tonemap import tonemap
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

SIZE = (200, 180)


@cache
def rendered(name: str) -> tuple[Frame, Camera, Settings]:
    scene = irrsplat.load(name)
    with irrsplat.Renderer(scene, size=SIZE, bounces=1, gather_size=8, shadow_size=128) as renderer:
        return renderer.render(), scene.camera(), renderer.settings


def plain(frame: Frame) -> np.ndarray:
    return tonemap(frame.image, frame.exposure)


@pytest.mark.parametrize("name", ["cornell", "furnace", "door"])
def test_a_diagram_of_the_picture_s_size(name: str) -> None:
    frame, eye, settings = rendered(name)
    drawn = figure1.diagram(frame, eye, settings)
    assert drawn.shape == frame.image.shape and drawn.dtype == np.float32
    assert drawn.min() >= 0.0 and drawn.max() <= 1.0
    assert np.abs(drawn - plain(frame)).mean() > 0.05
    assert np.array_equal(drawn, figure1.diagram(frame, eye, settings)), "it is the same every time"


@pytest.mark.parametrize("name", ["cornell", "furnace", "door"])
def test_the_record_is_one_that_the_eye_sees(name: str) -> None:
    frame, eye, settings = rendered(name)
    record = figure1.choose_record(frame, eye, settings)
    assert record is not None
    assert (record.position == frame.records_position).all(axis=1).any()
    nearest = np.linalg.norm(frame.position - record.position, axis=-1).min()
    assert nearest < 0.02 * record.d, "some pixel lies beside it"


def test_the_radius_is_the_shader_s() -> None:
    """shaders/indirect/splat.vert: r = a·R, at least and at most so many percent of the image height at distance d."""
    frame, eye, settings = rendered("cornell")
    for low, high in ((0.0, 0.0), (0.0, 5.0), (20.0, 0.0)):
        limits = replace(settings, radius_min=low, radius_max=high)
        record = figure1.choose_record(frame, eye, limits)
        assert record is not None
        percent = 0.02 * np.tan(np.radians(eye.fov) / 2.0) * record.d
        r = max(settings.a * record.radius, low * percent)
        assert record.r == pytest.approx(min(r, high * percent) if high else r)


def test_the_quad_bounds_the_silhouette_and_touches_it() -> None:
    """The lines of sight that touch the sphere make a cone of half angle α, sin α = r/d, around the eye vector; in the plane
    through p_k that faces the eye they form a circle of radius d·tan α. The quad's sides must touch that circle."""
    frame, eye, settings = rendered("cornell")
    record = figure1.choose_record(frame, eye, settings)
    assert record is not None
    circle = record.d * np.tan(np.arcsin(record.r / record.d))
    axis = (record.eye - record.position) / record.d
    corners = record.quad - record.position
    assert np.allclose(corners @ axis, 0.0, atol=1e-9), "the quad faces the eye"
    assert np.allclose(np.abs(corners @ np.stack([record.u, record.v]).T), circle)
    assert np.allclose(np.stack([record.u, record.v, axis]) @ np.stack([record.u, record.v, axis]).T, np.eye(3))


def test_an_eye_inside_the_sphere() -> None:
    """There is no silhouette then; the quad is the whole screen, and the figure says so."""
    frame, eye, settings = rendered("furnace")
    huge = replace(settings, a=2.0, radius_max=0.0)
    frame = replace(frame, records_radius=np.full_like(frame.records_radius, 10.0))
    record = figure1.choose_record(frame, eye, huge)
    assert record is not None and record.inside
    assert "whole screen" in " ".join(words for _, words in figure1._legend(record, huge))
    assert np.abs(figure1.diagram(frame, eye, huge) - plain(frame)).mean() > 0.05


def test_the_plain_picture_where_there_is_nothing_to_show() -> None:
    frame, eye, settings = rendered("cornell")
    none = {f"records_{name}": getattr(frame, f"records_{name}")[:0] for name in ("position", "normal", "irradiance", "radius")}
    assert np.array_equal(figure1.diagram(replace(frame, **none), eye, settings), plain(frame))
    sky = replace(frame, depth=np.full_like(frame.depth, np.inf))
    assert np.array_equal(figure1.diagram(sky, eye, settings), plain(frame))
    away = replace(eye, target=tuple(2.0 * np.array(eye.eye) - eye.target))
    assert np.array_equal(figure1.diagram(frame, away, settings), plain(frame)), "every record is behind the eye"


@pytest.mark.parametrize(
    ("size", "camera", "settings"),
    [
        ((1, 1), {}, {}),
        ((40, 300), {}, {}),
        ((200, 200), {"eye": (0.0, 3.0001, 0.0), "target": (0.0, 4.0, 0.001)}, {}),  # above the ceiling, looking away
        ((200, 200), {"eye": (0.0, 2.9, 0.0), "target": (0.0, 0.0, 0.001)}, {}),  # straight down
        ((200, 200), {}, {"bounces": 0}),
        ((300, 170), {"fov": 150.0}, {"radius_max": 0.0}),
    ],
)
def test_every_view_has_a_figure(size: tuple[int, int], camera: dict, settings: dict) -> None:
    scene = irrsplat.load("furnace")
    with irrsplat.Renderer(scene, size=size, **{"bounces": 1, "gather_size": 8, "shadow_size": 64, **settings}) as renderer:
        frame = renderer.render(replace(scene.camera(), **camera), figures=True)
    assert frame.figures["quad"].shape == (size[1], size[0], 3)
    assert np.isfinite(frame.figures["quad"]).all()


def test_no_geometry_has_a_figure(tmp_path: Path) -> None:
    (tmp_path / "empty.scene").write_text("cam 0 0 5 0 0 0 0 1 0\nproj 40 1 0.1 100\nsky 1 1 1\n")
    with irrsplat.Renderer(irrsplat.load(tmp_path / "empty.scene"), size=(170, 170)) as renderer:
        assert np.isfinite(renderer.render(figures=True).figures["quad"]).all()


def test_paint_shows_the_nearest_and_leaves_out_what_turns_its_back() -> None:
    """A red square before a green one, and a blue one before both that faces away: red, with green around it."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], float)
    corners = np.stack([0.5 * square + (0, 0, 1), square, 0.5 * square + (0, 0, 2)])
    colours = np.repeat(np.eye(3)[:, None], 4, axis=1)
    towards = np.array([[0, 0, 1], [0, 0, 1], [0, 0, -1]], float)
    canvas = np.zeros((40, 40, 3))
    view = cutaway.Parallel(np.eye(3), np.zeros(3), np.array([20.0, 20.0]), 10.0)
    cutaway.paint(canvas, view, cutaway.Surface(corners, colours, towards))
    expected = np.zeros((40, 40, 3))
    expected[10:30, 10:30] = (0, 1, 0)
    expected[15:25, 15:25] = (1, 0, 0)
    assert np.array_equal(canvas, expected)
