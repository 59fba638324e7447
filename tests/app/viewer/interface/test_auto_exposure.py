"""Automatic exposure is steady during gathering and correct for the converged view."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any, cast

import pytest

import irrsplat
from irrsplat.app.viewer.session import Session
from irrsplat.gpu import context


@pytest.mark.few_sites
def test_a_filling_dark_scene_keeps_its_exposure_until_all_light_is_there() -> None:
    """With 2⁻¹³ of the light, the exposure rises by 13 stops, by less than 0.05 per tick; blend and black views keep it."""
    scene = irrsplat.load("cornell")
    dark = [replace(light, color=cast(Any, tuple(2.0**-13 * c for c in light.color))) for light in scene.lights]
    values: Any = {"gather_size": 8, "viewer_samples": 0, "viewer_quality": 0.0}
    with context.shared():
        session = Session(context.shared(), replace(scene, lights=tuple(dark)), (32, 32), values=values)
        stops, filling = list[float](), list[bool]()
        while not session.at_rest and len(stops) < 600:
            session.tick(0.03, 0.03)
            stops.append(session.auto_exposure.stops)
            filling.append(not session.progress[0].done)
        assert session.at_rest
        assert max((abs(b - a) for (a, b), now in zip(pairwise(stops), filling[1:], strict=True) if now), default=0.0) < 0.05
        view = session.views[0]
        needed = session.renderers[0].automatic_stops(view)
        assert stops[-1] == pytest.approx(needed, abs=0.011)
        darker = [replace(light, color=cast(Any, tuple(2.0**-20 * c for c in light.color))) for light in dark]
        for change in (
            lambda: session.change(0, blend=1.0),  # without direct light the picture is darker, and is exposed as before
            lambda: session.pose(replace(session.scene, lights=tuple(darker))),  # black also with 20 stops
        ):
            change()
            session.tick(0.03, 0.03)
            while not session.at_rest:
                session.tick(0.03, 0.03)
            assert session.auto_exposure.stops == pytest.approx(stops[-1], abs=0.011), "it was within 0.01 of its goal"
        session.release()
    bright = irrsplat.render(scene, (32, 32), gather_size=8)
    assert stops[-1] == pytest.approx(bright.exposure + 13.0, abs=0.1)
