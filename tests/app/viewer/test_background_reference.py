"""The path-traced truth in the viewer: its pixels, its pictures, when it holds, and its end."""

from __future__ import annotations

import os
import select
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.app.verify.error_image import signed_error
from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers import background_reference as module
from irrsplat.app.viewer.buffers.background_reference import Estimate, Subject, TracedReference
from irrsplat.app.viewer.buffers.reference import NO_REFERENCE
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.image.tonemap import show
from irrsplat.reference import worker
from irrsplat.reference.truth import Traced
from tests.support.viewing import SAFETY, SIZE, Driver, Tracer, push


@pytest.fixture
def tracer(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> Tracer:
    return Tracer(monkeypatch)


def traced_truth(driver: Driver, tracer: Tracer) -> TracedReference:
    if not driver.session.references.on:
        push(driver, "Y")
    tracer.finish(driver)
    found = here(driver)
    assert found is not None
    return found


def here(driver: Driver) -> TracedReference | None:
    """Return the truth of the view on show."""
    on = driver.session
    return on.reference(on.camera, on.settings(0)[1])


@pytest.mark.parametrize("passes", [4, 2])
def test_both_buffers_show_every_square_s_truth(driver: Driver, monkeypatch: pytest.MonkeyPatch, passes: int) -> None:
    """The truth as irradiance is shown, the error in the colours of `verify`: in every pixel that of its square's middle.

    At last, every pixel is its own square; with 50 of 240 rows, 5 x 5 pixels are one. The cursor finds the same numbers.
    """
    tracer = Tracer(monkeypatch, early=passes)
    push(driver, "Y")
    lattice, session = tracer.wait(driver).lattice, driver.session
    assert lattice.stride == (1 if passes == 4 else 5)
    found = Tracer.traced(lattice.count)
    y, x = np.indices((SIZE[1], SIZE[0]))
    column, row = ((p + m) // lattice.stride for p, m in zip((x, y), lattice.margin, strict=True))
    E = session.frame().irradiance
    half = lattice.stride // 2
    middle_y, middle_x = (
        np.clip(np.arange(n) * lattice.stride + half - m, 0, most - 1)
        for n, m, most in zip(lattice.count[::-1], lattice.margin[::-1], E.shape, strict=False)
    )
    middles = E[np.ix_(middle_y, middle_x)]
    pictures = {
        "reference": show("irradiance", found.irradiance, session.exposure, found.seen)[row, column],
        "error": signed_error(middles, found)[row, column],
    }
    for name, expected in pictures.items():
        driver.actions.show(name)
        driver.frame()
        assert np.abs(driver.canvas() / 255.0 - expected).max() < 1.01 / 255.0, name
    for px, py in ((0, 0), (17, 100), (SIZE[0] - 1, SIZE[1] - 1), (160, 7), (161, 120)):
        value, at = driver.display.buffer_view.value("reference", session.source(0), px, py), (row[py, px], column[py, px])
        assert (value is not None and np.allclose(value, found.irradiance[at], rtol=1e-5)) if found.seen[at] else value is None


def test_no_frame_waits_for_a_truth(driver: Driver, tracer: Tracer) -> None:
    """Frames go on while the tracer is held, over a dim grey picture; the progress is in words."""
    driver.actions.show("reference")
    push(driver, "Y")
    tracer.begin(driver)
    source, before = driver.session.source(0), driver.canvas()
    assert driver.session.references.traced == 0.25 and driver.session.references.progress == "reference: the first samples"
    assert NO_REFERENCE in BUFFERS["error"].legend(source).text
    assert (np.ptp(before, axis=-1) == 0).all() and 0 < before.max() < 128 and before.std() > 1.0
    tracer.finish(driver)
    assert "16 samples, noise about" in BUFFERS["error"].legend(driver.session.source(0)).text
    assert (driver.canvas() != before).any(-1).mean() > 0.5, "it is on show as soon as it is there"


def test_a_truth_holds_for_one_view_and_lighting(driver: Driver, tracer: Tracer) -> None:
    """Views of one eye, size, lighting and number of bounces have one truth. Any other view has none, or its own."""
    session, editor = driver.session, driver.actions.editor
    truth, home, bounces = traced_truth(driver, tracer), session.camera, session.settings(0)[1].bounces
    lamp = editor.lights[0]
    for change, undo in (
        (lambda: session.free_camera.go(replace(home, fov=home.fov + 1.0)), lambda: session.free_camera.go(home)),
        (lambda: editor.set_light(0, replace(lamp, stops=1.0)), lambda: editor.set_light(0, lamp)),
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
    other = traced_truth(driver, tracer)
    assert other is not truth and "0 bounces" in other.about
    session.change(0, bounces=bounces)
    driver.frame()
    assert here(driver) is truth


def test_tracing_follows_the_view_and_goes_on_where_it_was(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """A move of the camera ends the tracing, and a rest begins it. At the first view again, its 8 samples are continued."""
    tracer, references, home = Tracer(monkeypatch, early=3), driver.session.references, driver.session.camera
    push(driver, "Y")
    first = tracer.wait(driver)
    corner = driver.session.scene.camera("corner")
    for fov in (50.0, 51.0, 52.0):
        driver.actions.go(replace(corner, fov=fov))
        driver.frame()
        assert references.traced is None, "the view moves"
    assert "begins when the view is at rest" in references.progress
    second = tracer.wait(driver)
    assert second.subject.camera.fov == 52.0 and here(driver) is second
    driver.actions.go(home)
    driver.frame()
    assert here(driver) is first and first.estimate.samples == 8 and not first.complete
    tracer.early = 0
    tracer.begin(driver)
    tracer.finish(driver)
    last = here(driver)
    assert last is not None and last.complete and last.estimate.samples == 16


def test_a_missing_path_tracer_is_told_with_its_remedy(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Actions, "reference_possible", False)
    push(driver, "Y")
    (said,) = [m.text for m in driver.actions.messages.lines]
    assert worker.INSTALL in said and "\n" not in said and driver.session.references.traced is None


def test_stopping_ends_the_path_tracers_process(driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process ends though it has sent nothing yet, and would send nothing for an hour."""
    script = "import os, sys, time; sys.stdin.buffer.read(); open('pid', 'w').write(str(os.getpid())); time.sleep(3600)"
    monkeypatch.setattr(worker, "_REFINE", script)
    monkeypatch.setattr(worker, "require", lambda: None)
    monkeypatch.setattr(Actions, "reference_possible", True)
    os.mkfifo(tmp_path / "pid")
    begun = os.open(tmp_path / "pid", os.O_RDONLY | os.O_NONBLOCK)
    push(driver, "Y")
    select.select([begun], [], [], SAFETY)
    pid = int(os.read(begun, 20))
    os.close(begun)
    os.kill(pid, 0)
    (thread,) = driver.session.references._threads
    push(driver, "Y")
    thread.join(SAFETY)
    assert not thread.is_alive() and thread.error is None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    driver.frame(2)
    assert driver.session.references.traced is None and not [m for m in driver.actions.messages.lines if m.error]


@pytest.mark.long
def test_every_pass_has_the_right_mean() -> None:
    """In the middles of its squares, each agrees with a fresh truth within the noise of both, in both halves of the picture.
    Noise falls with the samples as its legend states."""
    pytest.importorskip("mitsuba")
    scene = irrsplat.load("cornell")
    subject, made = Subject(scene, scene.camera(), (63, 57), 3), list[Estimate]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "COARSE", (12, 20))
        patch.setattr(module, "SIDES", (2, 2, 4, 8))
        plan = subject.plan()

    def take(found: dict[str, np.ndarray]) -> None:
        made.append(Estimate.after(made[-1] if made else None, *plan[len(made)], found))

    worker.refine(scene, [one for _, one in plan], 3, take, lambda share: None)
    truth = Traced(**worker.trace(scene, subject.camera, subject.size, 24, 3))
    assert [(one.lattice.stride, one.samples) for one in made] == [(5, 8), (3, 8), (1, 8), (1, 16), (1, 48), (1, 176)]
    for one in made:
        rows, columns = np.nonzero(one.valid)
        at = np.array([one.lattice.middle((int(c), int(r)), subject.size) for r, c in zip(rows, columns, strict=True)])
        inside = truth.valid[at[:, 1], at[:, 0]]
        E, E_ref = one.irradiance[rows, columns].astype(float), truth.irradiance[at[:, 1], at[:, 0]].astype(float)
        off, mean = (E - E_ref)[inside], E_ref[inside].mean()
        assert one.noise is not None
        for some in (at[inside, 1] < subject.size[1] // 2, at[inside, 1] >= subject.size[1] // 2):
            # three channels go together; the error of the mean of N pixels, four times
            assert abs(off[some].mean()) < 4.0 * one.noise * mean / np.sqrt(some.sum()) + 0.002 * mean, one.samples
        if one.lattice.stride == 1:
            assert np.sqrt(np.mean(off**2)) / mean == pytest.approx(one.noise, rel=0.5)
