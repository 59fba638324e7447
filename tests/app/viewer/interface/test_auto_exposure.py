"""Automatic exposure is correct for the converged view, and held while lights or the blend change or the view is black."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest

import irrsplat
from irrsplat.app.viewer.session import Session
from tests.support.worlds import shared


@pytest.mark.few_sites
def test_a_dark_scene_is_exposed_as_a_bright_one() -> None:
    """With 2⁻¹³ of the light, the exposure rises by 13 stops, not during gathering, and not by direct light alone."""
    scene = irrsplat.load("cornell")
    dark = [replace(light, color=cast(Any, tuple(2.0**-13 * c for c in light.color))) for light in scene.lights]
    values: Any = {"gather_size": 8, "viewer_samples": 0, "viewer_quality": 0.0}
    with shared():
        session = Session(shared(), replace(scene, lights=tuple(dark)), (32, 32), values=values)
        filling = list[float]()
        session.tick(0.0, 0.0)  # the picture has direct light alone
        while not session.at_rest:
            session.tick(0.03, 0.03)
            filling += [session.auto_exposure.stops] * (not session.progress[0].done)
        assert len(filling) > 1 and max(filling) - min(filling) < 0.05
        for exposure in (0.0, "auto"):  # the exposure that was set does not stay
            session.change(0, exposure=cast(Any, exposure))
            session.tick(0.03, 0.03)
            while not session.at_rest:
                session.tick(0.03, 0.03)
        stops = session.auto_exposure.stops
        assert stops == pytest.approx(session.renderers[0].stops(session.views[0]), abs=0.011)
        dimmed = [replace(light, color=cast(Any, tuple(0.1 * c for c in light.color))) for light in dark]
        darker = [replace(light, color=cast(Any, tuple(2.0**-20 * c for c in light.color))) for light in dark]
        for change in (
            lambda: session.pose(replace(session.scene, lights=tuple(dimmed))),  # a dimmed light makes the picture darker
            lambda: session.change(0, blend=1.0),  # without direct light the picture is darker, and is exposed as before
            lambda: session.pose(replace(session.scene, lights=tuple(darker))),  # black also with 20 stops
        ):
            change()
            session.tick(0.03, 0.03)
            while not session.at_rest:
                session.tick(0.03, 0.03)
            assert session.auto_exposure.stops == pytest.approx(stops, abs=0.011), "it was within 0.01 of its goal"
        for change in (lambda: session.pose(replace(session.scene, lights=tuple(dimmed))), lambda: session.change(0, blend=0.0)):
            session.open(scene)  # now the change comes before the view is complete
            while not session.progress or session.renderers[0].scheduler.gatherer.awaits_light:
                session.tick(0.0, 0.0)
            early = session.auto_exposure.stops
            change()
            session.tick(0.03, 0.03)
            while not session.at_rest:
                session.tick(0.03, 0.03)
            assert session.auto_exposure.stops == early
        session.release()
    assert stops == pytest.approx(irrsplat.render(scene, (32, 32), gather_size=8).exposure + 13.0, abs=0.1)
