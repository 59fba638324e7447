"""Measured light in the viewer: on a horizontal plane, and at one point by source."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.show.light.why_dark import light_at
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.plane import horizontal
from irrsplat.scene.model import Light
from tests.support import worlds
from tests.support.viewing import Driver, push


def test_the_plane_has_the_values_of_a_light_meter(driver: Driver) -> None:
    """The viewer's process measures the values of a LightMeter; the plane is drawn between its front and back edges."""
    session = driver.session
    push(driver, "Ctrl+M")
    while session.plane.share is not None:
        driver.frame()
    driver.frame(2)
    measured, plane = session.plane.measured, horizontal(session.scene, 0.75)
    assert measured is not None and measured.plane == plane
    grid = plane.grid(plane.usual_spacing())
    with LightMeter(session.scene, ctx=session.ctx) as meter:
        expected = meter.measure(grid.points, grid.normals)
    assert measured.readings.total == pytest.approx(expected.total) and not measured.readings.counts.all(), "the box is cut"
    shown = driver.canvas()
    push(driver, "Ctrl+M")
    driver.frame(2)
    rows = np.flatnonzero((driver.canvas() != shown).any((1, 2)))
    away = session.camera.eye[2] - np.array([-1.0, 1.0])  # of the edges at the back and in front; they are 0.25 m below the eye
    assert rows[[0, -1]] == pytest.approx(len(shown) * (0.5 + 0.25 / (away * session.camera.screen)), abs=1.5)


def test_a_new_measurement_moves_no_widget(driver: Driver) -> None:
    """A click during a measurement hits the widget that the user sees: the lights below the plane keep their place."""
    session = driver.session
    session.options.frozen = True  # for fast frames
    driver.resize((760, 900), density=0.25)
    push(driver, "Ctrl+M")
    driver.actions.toggle("lights")
    while session.plane.share is not None:
        driver.frame()
    driver.frame(2)
    before = driver.find("candela").at()
    driver.enter(driver.find("candela"), "2")
    assert driver.find("candela").at() == before


def test_sources_add_up_to_what_a_light_meter_reads(ctx: moderngl.Context) -> None:
    """Black surfaces reflect nothing: lights, emitters and the sky add up to the light meter's direct and indirect values."""
    black, glowing, aim = worlds.material(0.0), worlds.material(0.0, 5.0), (0.3, 0.0, 0.0)
    shelf = replace(worlds.quad((-2.0, 1.0, -1.0), (1.5, 0, 0), (0, 0, 2.0), black), name="shelf")
    panel = replace(worlds.quad((0.5, 1.5, -0.5), (1.0, 0, 0), (0, 0, 1.0), glowing), name="panel")
    hidden = replace(worlds.quad((-1.6, 1.5, -0.2), (0.4, 0, 0), (0, 0, 0.4), glowing), name="hidden")
    lights = (
        worlds.point_light((-1.5, 2.0, 0.0), 9.0, name="over the shelf"),
        worlds.point_light(
            (0.0, 2.0, 1.0), 5.0, name="spot", spot_target=aim, spot_cutoff=30.0, spot_inner=2.0, spot_exponent=2.0
        ),
        Light((1.0, 2.0, 3.0), (1.0, 0.8, 0.5), directional=True, name="sun"),
        Light((0.5, 1.0, 0.5), (1.0, 1.0, 1.0), attenuation=(1.0, 0.5, 0.2), name="falls off"),
        worlds.point_light((0.0, -1.0, 0.0), name="below"),
    )
    scene = worlds.scene(worlds.floor(paint=black), shelf, panel, hidden, lights=lights, sky=0.5)
    with LightMeter(scene, ctx=ctx) as meter:
        readings = meter.measure([(0.0, 0.0, 0.0)], (0.0, 1.0, 0.0)).values("lux")
        found = light_at(scene, meter.world.caster, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    lux = {source.name: source.lux for source in found.sources}
    assert sum(lux[light.name] for light in lights) == pytest.approx(readings["direct"][0], rel=1e-3)
    assert lux["panel"] + found.sky_lux == pytest.approx(readings["indirect"][0], rel=0.02)
    reasons = {source.name: source.reason for source in found.sources if source.reason}
    assert reasons == {"over the shelf": "blocked by shelf", "hidden": "blocked by shelf", "below": "behind the surface"}


def test_a_click_explains_the_light_of_a_point(driver: Driver) -> None:
    """The box hides the light from the floor behind it: the light there is indirect, and the picture's value is positive."""
    push(driver, "Ctrl+D")
    session = driver.session
    driver.settle()
    driver.click(*driver.seen((-0.45, -1.0, -0.4)))
    driver.frame(2)
    assert session.options.surface is not None and session.options.surface[1] == (0.0, 1.0, 0.0)
    assert session.options.surface[0] == pytest.approx((-0.45, -1.0, -0.4), abs=0.02)
    renderer = session.renderers[0]
    (point_light,) = light_at(renderer.scene, renderer.world.caster, *session.options.surface).sources
    assert point_light.reason == "blocked by box" and (driver.display.light_at(session.options.surface[0]) or 0.0) > 0.0
