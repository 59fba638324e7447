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
from irrsplat.app.viewer.buffers.background_truth import COARSE, KEPT, SIDES, Estimate, Lattice, Subject, Truth
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.buffers.truth import NO_TRUTH
from irrsplat.image.tonemap import show
from irrsplat.reference import worker
from irrsplat.reference.truth import Traced, in_words, vertices
from irrsplat.scene.model import Camera, Scene
from tests.support.viewing import SIZE, Driver, Tracer, push

TRUTHS = [name for name, buffer in BUFFERS.items() if buffer.needs_truth]


@pytest.fixture
def tracer(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> Tracer:
    """Stands in for the path tracer."""
    return Tracer(monkeypatch)


def traced_truth(driver: Driver, tracer: Tracer) -> Truth:
    if not driver.session.truths.on:
        push(driver, "Y")
    tracer.finish(driver)
    found = here(driver)
    assert found is not None
    return found


def here(driver: Driver) -> Truth | None:
    """The truth of the view on show."""
    on = driver.session
    return on.truth(on.camera, on.settings(0)[1])


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


@pytest.mark.parametrize("rows", COARSE)
@pytest.mark.parametrize("size", [(320, 200), (800, 600), (1280, 720), (1921, 1081), (640, 201), (97, 1400), (7, 5)])
def test_the_rays_traced_are_those_of_the_view_s_own_pixels(size: tuple[int, int], rows: int) -> None:
    """A pixel centre's ray has the slopes (x + ½ − W/2)·s/H and (y + ½ − H/2)·s/H with s the screen's height at distance 1.

    So of a coarser camera, with its own W, H and s: both must agree in the middle of every square. And every pixel of the view
    lies in a square, the one whose middle is less than half a stride away.
    """
    lattice, camera = Lattice.of(size, rows), Camera((1, 2, 3), (0, 0, 0), fov=70.0)
    coarse = lattice.camera(camera, size)
    assert lattice.stride % 2 == 1 and lattice.count[1] <= rows + 1
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


@pytest.mark.parametrize("passes", [4, 2])
def test_both_buffers_show_every_square_s_truth(driver: Driver, monkeypatch: pytest.MonkeyPatch, passes: int) -> None:
    """The truth as irradiance is shown, the error in the colours of `verify`: in every pixel that of its square's middle.

    At last, every pixel is its own square; with 50 of 240 rows, 5 x 5 pixels are one. The cursor finds the same numbers.
    """
    tracer = Tracer(monkeypatch, early=passes)
    push(driver, "Y")
    truth = tracer.wait(driver)
    lattice, session = truth.lattice, driver.session
    assert lattice.stride == (1 if passes == 4 else 5)
    found = Tracer.traced(lattice.count)
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
    flat = replace(Tracer.traced((64, 1)), halves=np.ones((2, 1, 64, 3), "f4"), seen=np.ones((1, 64), bool))
    E = 1.0 + FULL * np.linspace(-1.0, 1.0, 64)[None, :, None].repeat(3, axis=2)
    assert made.colours is not None and np.allclose(made.colours, signed_error(E, flat)[0], atol=1e-6)
    assert np.allclose(error_colours(np.array([-7.0, 0.0, 7.0])), [made.colours[0], [1.0, 1.0, 1.0], made.colours[-1]])
    for name in TRUTHS:
        text = BUFFERS[name].legend(source).text
        assert f"{in_words(source.settings.bounces)}, 16 samples, noise about" in text
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
    """Frames go on while the tracer is held, and show what there is; interface and legend say how far it has come."""
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
    assert said.count("truth: the first samples (25 % done, Y stops it)") == 2 and NO_TRUTH in said
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


def test_tracing_follows_the_view_and_goes_on_where_it_was(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another camera ends it; where that rests, it begins there. Back at the first, the passes that were made are not made again,
    and those that follow are other ones."""
    tracer, truths, home = Tracer(monkeypatch, early=3), driver.session.truths, driver.session.camera
    given: list[list[int]] = []
    real = tracer.refine

    def refine(scene: Scene, passes: list[worker.Pass], *rest: Any) -> None:
        given.append([one.number for one in passes])
        real(scene, passes, *rest)

    monkeypatch.setattr(worker, "refine", refine)
    push(driver, "Y")
    first = tracer.wait(driver)
    corner = driver.session.scene.camera("corner")
    for fov in (50.0, 51.0, 52.0):
        driver.actions.go(replace(corner, fov=fov))
        driver.frame()
        assert truths.traced is None, "the view moves"
    assert "waits until the view rests" in truths.progress
    second = tracer.wait(driver)
    assert second.subject.camera.fov == 52.0 and here(driver) is second
    driver.actions.go(home)
    driver.frame()
    assert here(driver) is first and first.estimate.samples == 8 and not first.complete
    tracer.early = 0
    driver.frame(2)
    tracer.finish(driver)
    last = here(driver)
    assert last is not None and last.complete and last.estimate.samples == 16
    assert given == [[0, 1, 2, 3], [0, 1, 2, 3], [3]]


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
    assert not thread.is_alive() and thread.latest is None and thread.error is None


@pytest.mark.parametrize("way", ["the key", "closing"])
def test_stopping_ends_the_path_tracers_process(
    driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    """Within two seconds, though it has not yet said a word, and would not for an hour."""
    script = "import os, sys, time; sys.stdin.buffer.read(); open('pid', 'w').write(str(os.getpid())); time.sleep(3600)"
    monkeypatch.setattr(worker, "_REFINE", script)
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


@pytest.fixture(scope="module")
def stages(tmp_path_factory: pytest.TempPathFactory) -> tuple[Subject, list[Estimate], Traced]:
    """What is known of a small view of cornell after each pass that Mitsuba makes, and a truth by other samples."""
    pytest.importorskip("mitsuba")
    scene = irrsplat.load("cornell")
    subject, made = Subject(scene, scene.camera(), (63, 57), 3), list[Estimate]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "COARSE", (12, 20))
        patch.setattr(module, "SIDES", (2, 2, 4, 8))
        plan = subject.plan()
        left = iter(plan)

        def take(found: dict[str, np.ndarray]) -> None:
            made.append(Estimate.after(made[-1] if made else None, *next(left), found))

        worker.refine(scene, [one for _, one in plan], 3, take, lambda share: None)
    return subject, made, Traced(**worker.trace(scene, subject.camera, subject.size, 24, 3))


def test_every_pass_has_the_right_mean(stages: tuple[Subject, list[Estimate], Traced]) -> None:
    """In the middles of its squares, each agrees with the fresh truth within the noise of both, in both halves of the picture;
    read at the wrong pixels, the last would not. Noise falls with the samples as its legend says."""
    subject, made, truth = stages
    assert [(one.lattice.stride, one.samples) for one in made] == [(5, 8), (3, 8), (1, 8), (1, 16), (1, 48), (1, 176)]
    for one in made:
        rows, columns = np.nonzero(one.valid)
        at = np.array([one.lattice.middle((int(c), int(r)), subject.size) for r, c in zip(rows, columns, strict=True)])
        E, E_ref = one.irradiance[rows, columns].astype(float), truth.irradiance[at[:, 1], at[:, 0]].astype(float)
        inside = truth.valid[at[:, 1], at[:, 0]]
        off, mean = (E - E_ref)[inside], E_ref[inside].mean()
        assert one.noise is not None
        spread = np.abs(one.halves[1] - one.halves[0])[rows, columns].mean(-1)[inside].std() / 2.0
        for some in (at[inside, 1] < subject.size[1] // 2, at[inside, 1] >= subject.size[1] // 2):
            # three channels go together; the error of the mean of N pixels, four times
            assert abs(off[some].mean()) < 4.0 * one.noise * mean / np.sqrt(some.sum()) + 0.002 * mean, (one.samples, spread)
        if one.lattice.stride == 1:
            assert np.sqrt(np.mean(off**2)) / mean == pytest.approx(one.noise, rel=0.5)
    wrong = np.roll(made[-1].irradiance, 4, axis=1) - truth.irradiance
    right = made[-1].irradiance - truth.irradiance
    assert np.abs(wrong[truth.valid]).mean() > 2.0 * np.abs(right[truth.valid]).mean()


def test_the_plan_ends_with_all_pixels() -> None:
    """Coarse passes first, as many as the window's height leaves; then every pixel by 2048 samples, with numbers of their own."""
    scene = irrsplat.load("cornell")
    for size, strides in (((1280, 720), [15, 5]), ((320, 180), [5]), ((40, 30), [])):
        plan = Subject(scene, scene.camera(), size, 1).plan()
        assert [lattice.stride for lattice, _ in plan] == strides + [1] * len(SIDES)
        assert [one.number for _, one in plan] == list(range(len(plan)))
        assert sum(one.samples for lattice, one in plan if lattice.stride == 1) == 2048
        assert all(one.size == size for lattice, one in plan if lattice.stride == 1)
