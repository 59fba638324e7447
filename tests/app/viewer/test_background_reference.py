"""The path-traced reference in the viewer: its buffers, its validity, and the end of tracing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irrsplat.app.viewer import actions
from irrsplat.app.viewer.buffers.background_reference import Estimate, TracedReference
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.input.commands import COMMANDS, EXTRAS
from irrsplat.app.work.verify import signed_error
from irrsplat.image.tonemap import show
from irrsplat.image.view import read
from irrsplat.scene.camera_path import Path
from tests.support.viewing import SIZE, Driver, Tracer, brighter, push


@pytest.fixture
def tracer(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> Tracer:
    return Tracer(monkeypatch)


def traced_truth(driver: Driver, tracer: Tracer) -> TracedReference:
    if driver.session.tracing.traced is None:
        push(driver, "Y")
    tracer.finish(driver)
    found = here(driver)
    assert found is not None
    return found


def here(driver: Driver) -> TracedReference | None:
    """Return the reference of the visible view, or None."""
    return driver.session.tracing.of(driver.session.subject)


def test_both_buffers_show_the_truth(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """The buffers show the reference as irradiance and the error in the colours of `verify`; the cursor reads equal values."""
    tracer, session = Tracer(monkeypatch, early=1), driver.session
    push(driver, "Y")
    tracer.wait(driver)
    found = Tracer.traced(SIZE)
    pictures = {
        "reference": show("irradiance", found.irradiance, session.auto_exposure.stops, found.seen),
        "error": signed_error(read(session.views[0], session.renderers[0].cache.read(), {}).irradiance, found),
    }
    for name, expected in pictures.items():
        driver.actions.show(name)
        driver.frame()
        assert np.abs(driver.canvas() / 255.0 - expected).max() < 1.01 / 255.0, name
    for px, py in ((0, 0), (17, 100), (SIZE[0] - 1, SIZE[1] - 1), (160, 7), (161, 120)):
        value, at = BUFFERS["reference"].value(session.source(0), px, py), (py, px)
        assert (value is not None and np.allclose(value, found.irradiance[at], rtol=1e-5)) if found.seen[at] else value is None


def test_no_frame_waits_for_a_truth(driver: Driver, tracer: Tracer) -> None:
    """The viewer renders frames during tracing, with an empty picture and a text of the progress."""
    driver.actions.show("reference")
    push(driver, "Y")
    tracer.begin(driver)
    source, before = driver.session.source(0), driver.canvas()
    assert driver.session.tracing.traced == 0.25 and driver.session.tracing.progress == "reference: the first samples"
    assert "no reference of this view" in BUFFERS["error"].legend(source).text
    assert (before == before[0, 0]).all()
    tracer.finish(driver)
    assert "16 samples, noise about" in BUFFERS["error"].legend(driver.session.source(0)).text
    assert (driver.canvas() != before).any(-1).mean() > 0.5, "it is on show as soon as it is there"


def test_a_truth_holds_for_one_view_and_lighting(driver: Driver, tracer: Tracer) -> None:
    """The reference is valid for one camera, size, lighting and number of bounces, and becomes valid again after an undo."""
    session, editor, fly = driver.session, driver.actions.editor, driver.session.free_camera
    truth, home, bounces = traced_truth(driver, tracer), session.camera, session.renderers[0].settings.bounces
    point_light = editor.scene.lights[0]
    for change, undo in (
        (lambda: setattr(fly, "camera", replace(home, fov=home.fov + 1.0)), lambda: setattr(fly, "camera", home)),
        (lambda: editor.set_light(0, brighter(point_light)), lambda: editor.set_light(0, point_light)),
        (lambda: driver.resize((200, 240)), lambda: driver.resize(SIZE)),
    ):
        change()
        driver.frame()
        assert here(driver) is None
        undo()
        driver.frame()
        assert here(driver) is truth
    session.change(0, bounces=0)
    driver.frame()
    assert "0 bounces" in traced_truth(driver, tracer).about
    session.change(0, bounces=bounces)
    driver.frame()
    assert here(driver) is None, "one reference is kept"


def test_a_move_ends_the_tracing_and_its_samples_stay(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a return to the first view, the viewer shows its 8 samples again."""
    tracer, home = Tracer(monkeypatch, early=1), driver.session.camera
    push(driver, "Y")
    first = tracer.wait(driver)
    driver.session.free_camera.camera = driver.session.scene.camera("corner")
    driver.frame(2)
    assert driver.session.tracing.traced is None and "the view is another one" in driver.said and here(driver) is None
    driver.session.free_camera.camera = home
    driver.frame()
    assert here(driver) is first and first.estimate.samples == 8
    tracer.early = 0  # else the samples of the restarted tracing replace the first ones whenever its thread is quick
    for tracing in (True, False):  # a second press stops it
        push(driver, "Y")
        assert (driver.session.tracing.traced is not None) == tracing and here(driver) is first


@pytest.mark.parametrize("extra", EXTRAS)
def test_an_action_without_its_extra_is_grey_and_says_what_to_install(
    driver: Driver, monkeypatch: pytest.MonkeyPatch, extra: str
) -> None:
    """Without its packages an action is disabled, and its message names the extra."""
    monkeypatch.setattr(actions, "find_spec", lambda name: None)
    driver.session.path_recorder.path = Path((driver.session.camera,) * 2, 2)
    (command,) = (one for one in COMMANDS if one.extra == extra)
    driver.actions.press(command)
    (said,) = [m.text for m in driver.actions.messages.lines if not m.error]
    assert EXTRAS[extra][1] in said and not driver.actions.can(command)
    monkeypatch.setattr(actions, "find_spec", lambda name: name)
    assert driver.actions.can(command)


def test_passes_count_by_their_samples() -> None:
    """The estimate is the mean of 8, 8 and 32 samples, weighted by number, for each half separately."""
    passes, seen = np.random.default_rng(2).uniform(0.0, 2.0, (3, 2, 4, 5, 3)).astype("f4"), np.ones((4, 5), bool)
    made = Estimate(passes[0], seen, seen, 8).and_pass(8, passes[1]).and_pass(32, passes[2])
    assert made.samples == 48
    assert made.halves == pytest.approx(np.average(passes, axis=0, weights=(8, 8, 32)), rel=1e-5)
