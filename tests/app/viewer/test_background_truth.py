"""The truth in the viewer: what is traced and shown of it, when it counts, and that nothing waits for it or outlives it."""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imgui_bundle import imgui

import irrsplat
from irrsplat.app.common.error_colours import FULL, error_colours
from irrsplat.app.verify.error_image import signed_error
from irrsplat.app.viewer.buffers import background_truth as module
from irrsplat.app.viewer.buffers.background_truth import HEIGHT, KEPT, Lattice, Truth
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.buffers.truth import NO_TRUTH
from irrsplat.app.viewer.session import Session
from irrsplat.gpu import context
from irrsplat.image.frame import Frame
from irrsplat.image.tonemap import show
from irrsplat.reference import worker
from irrsplat.reference.truth import Traced, errors, in_words, vertices
from irrsplat.scene.model import Camera
from tests.support.viewing import SIZE, Driver, Tracer, push

TRUTHS = [name for name, buffer in BUFFERS.items() if buffer.needs_truth]


@pytest.fixture
def tracer(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> Tracer:
    """Stands in for the path tracer."""
    return Tracer(monkeypatch)


def traced_truth(driver: Driver, tracer: Tracer) -> Truth:
    push(driver, "Y")
    tracer.finish(driver)
    found = here(driver)
    assert found is not None
    return found


def here(driver: Driver) -> Truth | None:
    """The truth of the view on show."""
    on = driver.session
    return on.truths.of(on.scene, on.camera, on.size, on.settings(0)[1].bounces)


def heard(write: Callable[..., None], place: int, said: list[str]) -> Callable[..., None]:
    """`write`, which also adds its argument at `place` to what was said."""

    def listen(*args: Any) -> None:
        said.append(args[place])
        write(*args)

    return listen


def words(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> str:
    """All text that the interface writes in a frame."""
    said: list[str] = []
    with monkeypatch.context() as patch:
        for name, place in (("text", 0), ("text_wrapped", 0), ("text_colored", 1)):
            patch.setattr(imgui, name, heard(getattr(imgui, name), place, said))
        driver.frame()
    return "\n".join(said)


# ---- which pixels --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(320, 200), (800, 600), (1280, 720), (1921, 1081), (640, 201), (97, 1400), (7, 5)])
def test_the_rays_traced_are_those_of_the_view_s_own_pixels(size: tuple[int, int]) -> None:
    """A pixel centre's ray has the slopes (x + ½ − W/2)·s/H and (y + ½ − H/2)·s/H with s the screen's height at distance 1.

    So of a coarser camera, with its own W, H and s: both must agree in the middle of every square. And every pixel of the view
    lies in a square, the one whose middle is less than half a stride away.
    """
    lattice, camera = Lattice.of(size), Camera((1, 2, 3), (0, 0, 0), fov=70.0)
    coarse = lattice.camera(camera, size)
    assert lattice.stride % 2 == 1 and lattice.count[1] <= HEIGHT + 1
    for axis in (0, 1):
        cell = np.arange(lattice.count[axis])
        slope = (cell + 0.5 - lattice.count[axis] / 2) * coarse.screen / lattice.count[1]
        middle = cell * lattice.stride + lattice.stride // 2 - lattice.margin[axis]
        assert np.allclose(slope, (middle + 0.5 - size[axis] / 2) * camera.screen / size[1], atol=1e-12)
        for pixel in range(size[axis]):
            place = [0, 0]
            place[axis] = pixel
            found = lattice.cell(*place)[axis]
            assert abs(middle[found] - pixel) <= lattice.stride // 2
            assert lattice.middle(lattice.cell(*place), size)[axis] == min(max(middle[found], 0), size[axis] - 1)
    assert replace(coarse, fov=camera.fov) == camera and (lattice.stride > 1 or coarse is camera)


# ---- what is shown -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [SIZE[1], 50])
def test_both_buffers_show_every_square_s_truth(
    driver: Driver, tracer: Tracer, monkeypatch: pytest.MonkeyPatch, height: int
) -> None:
    """The truth as irradiance is shown, the error in the colours of `verify`: in every pixel that of its square's middle.

    At full size, every pixel is its own square; with 50 of 240 rows, 5 x 5 pixels are one. The cursor finds the same numbers.
    """
    monkeypatch.setattr(module, "HEIGHT", height)
    truth = traced_truth(driver, tracer)
    lattice, session = truth.lattice, driver.session
    assert lattice.stride == (1 if height == SIZE[1] else 5)
    found = Traced(**Tracer.make(lattice.count))
    assert truth.full == pytest.approx(FULL * found.irradiance[found.valid].mean(), rel=1e-5)
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
    values = {"reference": found.irradiance, "error": (middles - found.irradiance).mean(-1, keepdims=True)}
    for name, expected in pictures.items():
        driver.actions.show(name)
        driver.frame()
        assert np.abs(driver.canvas() / 255.0 - expected).max() < 1.01 / 255.0, name
        view, source = driver.display.buffer_view, session.source(0)
        for px, py in ((0, 0), (17, 100), (SIZE[0] - 1, SIZE[1] - 1), (160, 7), (161, 120)):
            at = row[py, px], column[py, px]
            value = view.value(name, source, px, py)
            if found.seen[at]:
                assert value is not None and np.allclose(value, values[name][at], rtol=1e-5, atol=1e-6)
            else:
                assert value is None
        assert view.value(name, source, SIZE[0], 0) is None
        assert view.value(name, replace(source, truth=None), 17, 100) is None


def test_the_legend_s_scale_is_that_of_verify(driver: Driver, tracer: Tracer) -> None:
    """Its 64 colours stand for errors from −full to full, W/m², and it says how the truth was traced."""
    session, truth = driver.session, traced_truth(driver, tracer)
    source = session.source(0)
    assert source.truth is truth
    made = BUFFERS["error"].legend(source)
    assert (float(made.low), float(made.high)) == pytest.approx((-truth.full, truth.full), rel=0.01) and made.unit == "W/m²"
    flat = Tracer.make((64, 1)) | {"halves": np.ones((2, 1, 64, 3), "f4"), "seen": np.ones((1, 64), bool)}
    E = 1.0 + FULL * np.linspace(-1.0, 1.0, 64)[None, :, None].repeat(3, axis=2)
    assert made.colours is not None and np.allclose(made.colours, signed_error(E, Traced(**flat))[0], atol=1e-6)
    assert np.allclose(error_colours(np.array([-7.0, 0.0, 7.0])), [made.colours[0], [1.0, 1.0, 1.0], made.colours[-1]])
    for name in TRUTHS:
        text = BUFFERS[name].legend(source).text
        assert f"{in_words(source.settings.bounces)}, 512 samples" in text and "noise" in text
    assert "+1.5 stops" in BUFFERS["reference"].legend(replace(source, exposure=1.5)).text


@pytest.mark.parametrize("name", TRUTHS)
def test_without_a_truth_the_picture_is_dim_and_the_legend_says_why(
    driver: Driver, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    driver.actions.show(name)
    driver.frame(2)
    picture = driver.canvas()
    assert (np.ptp(picture, axis=-1) == 0).all() and 0 < picture.max() < 128 and picture.std() > 1.0
    assert NO_TRUTH in words(driver, monkeypatch)


# ---- when it counts ------------------------------------------------------------------------------------------------------


def test_no_frame_waits_for_a_truth(driver: Driver, tracer: Tracer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames go on while the tracer is held; interface and legend say how far it has come."""
    driver.actions.panels.hud = True
    driver.actions.show("reference")
    push(driver, "Y")
    for _ in range(400):  # until its first word
        driver.frame()
        if driver.session.truths.traced:
            break
        time.sleep(0.005)
    assert driver.session.truths.traced == 0.25 and here(driver) is None
    said = words(driver, monkeypatch)
    assert said.count("tracing, 25 % (Y stops it)") == 2 and NO_TRUTH in said
    before = driver.canvas()
    tracer.finish(driver)
    said = words(driver, monkeypatch)
    assert "%" in said and "(Y stops it)" not in said and NO_TRUTH not in said
    assert (driver.canvas() != before).any(-1).mean() > 0.5, "it is on show as soon as it is there"


def test_a_truth_holds_for_one_camera_size_and_lighting(driver: Driver, tracer: Tracer) -> None:
    """Of one camera, by whatever name, one size, one lighting; and of them again."""
    session, actions = driver.session, driver.actions
    truth = traced_truth(driver, tracer)
    home = session.camera
    actions.go(session.scene.camera("corner"))
    driver.frame()
    assert here(driver) is None
    actions.go(replace(home, name="another"))
    driver.frame()
    assert here(driver) is truth
    actions.go(replace(home, fov=home.fov + 1.0))
    assert here(driver) is None
    actions.go(home)
    actions.editor.set_lamp(0, replace(actions.editor.lamps[0], stops=1.0))
    assert here(driver) is None
    actions.editor.set_lamp(0, replace(actions.editor.lamps[0], stops=0.0))
    assert here(driver) is truth
    driver.resize((200, 240))
    driver.frame()
    assert here(driver) is None
    driver.resize(SIZE)
    driver.frame()
    assert here(driver) is truth and len(tracer.calls) == 1
    actions.reload()
    driver.frame()
    assert session.truths.kept == [], "the scene may be another one"


def test_a_truth_holds_for_one_number_of_bounces(driver: Driver, tracer: Tracer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the picture: with another number of them it is stale, and Y traces another; both are kept."""
    first = driver.session.settings(0)[1].bounces
    truth = traced_truth(driver, tracer)
    driver.session.change(0, bounces=0)
    driver.actions.show("reference")
    driver.frame()
    assert here(driver) is None and NO_TRUTH in words(driver, monkeypatch)
    other = traced_truth(driver, tracer)
    assert other is not truth and "0 bounces" in other.about
    driver.session.change(0, bounces=first)
    driver.frame()
    assert here(driver) is truth and [call[2] for call in tracer.calls] == [vertices(first), 0]


def test_a_truth_is_of_the_view_where_tracing_began(driver: Driver, tracer: Tracer) -> None:
    """The truth is that of the view where the key was pressed."""
    home = driver.session.camera
    push(driver, "Y")
    driver.actions.go(driver.session.scene.camera("corner"))
    tracer.finish(driver)
    assert here(driver) is None
    driver.actions.go(home)
    assert here(driver) is not None and [call[0] for call in tracer.calls] == [home]


def test_the_last_few_are_kept_and_the_others_freed(driver: Driver, tracer: Tracer) -> None:
    home, made = driver.session.camera, []
    for i in range(KEPT + 2):
        driver.actions.go(replace(home, fov=40.0 + i))
        made.append(traced_truth(driver, tracer))
    assert driver.session.truths.kept == made[-KEPT:]
    gone = [type(truth.values.mglo).__name__ == "InvalidObject" for truth in made]
    assert gone == [True] * 2 + [False] * KEPT
    driver.session.truths.release()
    assert all(type(truth.values.mglo).__name__ == "InvalidObject" for truth in made)


# ---- what goes wrong, and how it ends ------------------------------------------------------------------------------------


def test_a_missing_path_tracer_is_told_with_its_remedy(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    push(driver, "Y")
    for _ in range(400):
        driver.frame()
        if driver.session.truths.traced is None:
            break
        time.sleep(0.005)
    (said,) = [m.text for m in driver.actions.messages.lines if m.error]
    assert worker.INSTALL in said and "\n" not in said


def test_another_scene_ends_the_tracing_of_this_one(driver: Driver, tracer: Tracer) -> None:
    push(driver, "Y")
    (thread,) = driver.session.truths._threads
    driver.actions.reload()
    driver.frame()
    assert driver.session.truths.traced is None
    thread.join(2.0)
    assert not thread.is_alive() and thread.found is None and thread.error is None


@pytest.mark.parametrize("way", ["the key", "closing"])
def test_stopping_ends_the_path_tracers_process(
    driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    """Within two seconds, though it has not yet said a word, and would not for an hour."""
    script = "import os, sys, time; sys.stdin.buffer.read(); open('pid', 'w').write(str(os.getpid())); time.sleep(3600)"
    monkeypatch.setattr(worker, "_MAIN", script)
    monkeypatch.setattr(worker, "require", lambda: None)
    push(driver, "Y")
    pid, begin = tmp_path / "pid", time.monotonic()
    while not (pid.exists() and pid.read_text()):
        assert time.monotonic() < begin + 60.0
        driver.frame()
    os.kill(int(pid.read_text()), 0)
    (thread,) = driver.session.truths._threads
    if way == "closing":
        driver.session.truths.release()  # as Session.release does
    else:
        push(driver, "Y")
        thread.join(2.0)
    assert not thread.is_alive() and thread.error is None
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)
    driver.frame(2)
    assert driver.session.truths.traced is None and not [m for m in driver.actions.messages.lines if m.error]


# ---- the path tracer itself ----------------------------------------------------------------------------------------------


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed")
def test_the_traced_truth_of_cornell_agrees_with_the_render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture of 3 x 3 times as many pixels as are traced: in their middles, its irradiance is off by less than 10 %.

    Read at the wrong pixels, one to the side, it would not be: that is tried as well.
    """
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path))
    monkeypatch.setattr(module, "HEIGHT", 40)
    with context.shared():
        session = Session(context.shared(), irrsplat.load("cornell"), (121, 117))
        while not session.at_rest:
            session.tick(0.1, 1.0)
        bounces = session.settings(0)[1].bounces
        session.truths.toggle(session.scene, session.camera, session.size, bounces)
        (thread,) = session.truths._threads
        thread.join(120.0)
        session.truths.collect(session.scene, print)
        truth = session.truths.of(session.scene, session.camera, session.size, bounces)
        assert truth is not None and thread.found is not None and truth.lattice.stride == 3
        off = [_rmse(session.frame(), truth, thread.found, shift) for shift in (0, 4)]
        session.release()
    assert off[0] < 0.1 and off[0] < off[1], off


def _rmse(frame: Frame, truth: Truth, found: Traced, shift: int) -> float:
    size = truth.size
    rows, columns = np.nonzero(found.valid)
    at = np.array([truth.lattice.middle((int(c), int(r)), size) for r, c in zip(rows, columns, strict=True)])
    E = frame.irradiance[at[:, 1], np.minimum(at[:, 0] + shift, size[0] - 1)]
    rmse = errors(E, found.irradiance[rows, columns])["rmse"]
    assert rmse is not None
    return rmse
