"""Every key of the viewer: what it changes, by numbers or by pixels; and the keys that are held to fly."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from irrsplat.app.grammar import parse
from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.picking import on_screen
from irrsplat.app.viewer.editing.scene_edit import ObjectEdit
from irrsplat.app.viewer.input.keys import BUFFER_KEYS, GROUPS, Key
from irrsplat.app.viewer.session import overrides
from irrsplat.app.viewer.show.comparison import flip_is_there
from irrsplat.app.viewer.view_options import COMPARES
from irrsplat.indirect.temporal_filter import PICTURES
from irrsplat.scene import load
from irrsplat.scene.camera_path import load_path
from tests.support.viewing import FAST, LEFT, Cases, Driver, Tracer, push

CASES = Cases("camera", "overlays", "cache", "picture")
case = CASES.case


def test_every_key_has_its_case() -> None:
    CASES.check()
    others = {"buffers", "window", "lights and objects"}  # with tests below, in test_viewer_window.py and in ../editing
    assert set(GROUPS) == {*CASES.groups, *others}


@pytest.mark.parametrize("shown", CASES.keys)
def test_a_key_does_what_it_says(driver: Driver, shown: str) -> None:
    CASES.run(driver, shown, moving=("Home", "P", "R"))


# ---- buffers -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("found", BUFFER_KEYS, ids=[k.shown for k in BUFFER_KEYS])
def test_a_number_shows_its_buffer(driver: Driver, found: Key) -> None:
    """Another picture, with its own legend, and nothing else is drawn again; the title is said once."""
    push(driver, "2" if found.argument == "image" else "1")
    driver.settle()
    canvas, cache = driver.canvas(), driver.session.renderers[0].cache
    state = cache.count, cache.revision
    push(driver, found.shown)
    assert driver.session.options.buffers[0] == found.argument
    assert (driver.canvas() != canvas).any()
    assert driver.session.ms == {} and (cache.count, cache.revision) == state
    assert driver.said == BUFFERS[str(found.argument)].title


def test_the_buffers_are_all_different_pictures(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = Tracer(monkeypatch)
    driver.actions.trace()
    tracer.finish(driver)
    pictures = {}
    for name in BUFFERS:
        driver.actions.show(name)
        driver.frame()
        pictures[name] = driver.canvas()
    # without normal maps the two normals are the same, and where nothing is clear or cut in part opacity is alpha
    same = {"smooth_normal", "normal"}, {"opacity", "alpha"}
    for name, picture in pictures.items():
        alike = {other for other in pictures if other != name and np.array_equal(pictures[other], picture)}
        assert not alike or any({*alike, name} <= pair for pair in same), name


# ---- camera --------------------------------------------------------------------------------------------------------------


def away(driver: Driver) -> None:
    driver.session.free_camera.move(1.0, 0.0, 1.0, 0.2)
    driver.frame()


@case("Home")
def home(driver: Driver, shown: str) -> None:
    first = driver.session.scene.camera()
    away(driver)
    assert driver.session.camera != first
    push(driver, shown)
    assert driver.session.camera == first


@case("End")
def frame_all(driver: Driver, shown: str) -> None:
    """Further back, in the same direction."""
    before = driver.session.camera
    push(driver, shown)
    assert driver.session.camera.eye[2] > before.eye[2] and np.allclose(driver.session.camera.axes, before.axes)
    driver.actions.home()


@case("F")
def frame_selected(driver: Driver, shown: str) -> None:
    """The picked box, as it stands now, just fits into the picture; with nothing picked it is the key End."""
    first, (width, height) = driver.session.camera, driver.session.size
    editor = driver.actions.editor
    editor.set_object(2, ObjectEdit(offset=(-0.3, 0.1, 0.2)))
    editor.pick_mesh(2)
    push(driver, shown)
    camera, corners = driver.session.camera, driver.session.scene.meshes[2].positions.tolist()
    places = np.array([on_screen(camera, (width, height), (x, y, z)) for x, y, z in corners])
    least, most = places.min(0) / (width, height), places.max(0) / (width, height)
    assert np.allclose(camera.axes, first.axes) and (least > 0.0).all() and (most < 1.0).all() and (most - least).max() > 0.9
    editor.pick_mesh(None)
    push(driver, shown)
    alone = driver.session.camera
    push(driver, "End")
    assert driver.session.camera == alone != camera
    driver.actions.home()


@case("H")
def headlamp(driver: Driver, shown: str) -> None:
    """It adds direct light, goes along, and leaves the records as they are."""
    source = driver.session.source(0)
    before, records, revision = driver.canvas(), source.renderer.cache.count, source.renderer.cache.revision
    push(driver, shown)
    driver.settle()
    assert driver.session.headlamp and "headlamp on" in driver.said
    assert not np.array_equal(driver.canvas(), before)
    assert (source.renderer.cache.count, source.renderer.cache.revision) == (records, revision)
    driver.session.split("presets")
    assert driver.session.renderers[1].headlamp == source.renderer.headlamp > 0.0
    driver.session.split("off")
    push(driver, shown)
    driver.settle()
    assert not driver.session.headlamp and np.array_equal(driver.canvas(), before)


@case("C")
def copy_line(driver: Driver, shown: str) -> None:
    """The line stands in a .scene instead of the first camera, and that camera sees the same."""
    push(driver, shown)
    line, there = driver.viewer.desktop.text, Path(driver.actions.source)
    text = there.read_text().splitlines()
    assert text[0].startswith("cam ")
    copy = there.with_name("copy.scene")
    copy.write_text("\n".join([line, *text[1:]]))
    made, camera = load(copy).camera(), driver.session.camera
    assert np.allclose([*made.eye, *made.target, *made.up], [*camera.eye, *camera.target, *camera.up], atol=1e-5)


@case("Ctrl+C")
def copy_flags(driver: Driver, shown: str) -> None:
    push(driver, shown)
    args = parse(["render", "-o", "a.png", *shlex.split(driver.viewer.desktop.text)])
    camera = driver.session.camera
    assert np.allclose([args.eye, args.target, args.up], [camera.eye, camera.target, camera.up], atol=1e-5)
    assert args.fov == pytest.approx(camera.fov, abs=1e-3)


@case("B")
def bookmark(driver: Driver, shown: str) -> None:
    """Each is kept in the user's folder under a name of its own."""
    push(driver, shown)
    push(driver, shown)
    kept = preferences.bookmarks(driver.actions.source)
    assert [b.name for b in kept] == ["bookmark 1", "bookmark 2"] and kept == driver.actions.bookmarks
    assert kept[0].eye == driver.session.camera.eye and kept[0].fov == driver.session.camera.fov


@case("R")
def record(driver: Driver, shown: str) -> None:
    """The file's path, 30 frames a second, is where the flight was."""
    begin = driver.session.camera
    push(driver, shown)
    for _ in range(20):
        driver.session.free_camera.move(0.0, 0.0, 1.0, 0.05)
        driver.frame()
    end = driver.session.camera
    driver.frame(10)
    assert driver.session.path_recorder.recording is not None and not driver.session.at_rest
    push(driver, shown)
    (file,) = Path().glob("flight-room-*.path")
    path = load_path(file, begin.fov)
    assert path.frames == 1 + 30 * 1.4, "1.55 s are recorded, a key every 0.2 s"
    assert path.camera(0) == begin and np.allclose(path.camera(path.frames).eye, end.eye)
    speed = driver.session.free_camera.speed
    assert begin.eye[2] - path.camera(24).eye[2] == pytest.approx(0.8 * speed, abs=0.06 * speed), "where it was after 0.8 s"


@case("P")
def play(driver: Driver, shown: str) -> None:
    push(driver, shown)
    assert "no path yet" in driver.said
    driver.actions.record()
    for _ in range(20):
        driver.session.free_camera.move(0.0, 0.0, 1.0, 0.05)
        driver.frame()
    driver.actions.record()
    path, tape = driver.session.path_recorder.path, driver.session.path_recorder
    assert path is not None
    push(driver, "Home")
    push(driver, shown)
    assert tape.playing is not None and not driver.session.at_rest
    driver.frame(4)
    assert driver.session.views[0].camera == path.camera(5 * 0.05 * 30)
    push(driver, shown)
    assert tape.playing is None and np.allclose(driver.session.camera.eye, path.camera(6 * 0.05 * 30).eye, atol=0.05)
    push(driver, shown)
    driver.frame(30)
    assert tape.playing is None and driver.session.camera == path.camera(path.frames), "it stays where the path ends"


# ---- overlays, cache -----------------------------------------------------------------------------------------------------


def changed(driver: Driver, shown: str) -> float:
    """The share of the picture's pixels that the key changes; nothing below is drawn again, and the next press undoes it."""
    before = driver.canvas()
    push(driver, shown)
    after = driver.canvas()
    assert driver.session.ms == {}
    push(driver, shown)
    assert np.array_equal(driver.canvas(), before)
    return float((after != before).any(-1).mean())


@case("Z", "X", "V", "T")
def overlay(driver: Driver, shown: str) -> None:
    """Part of the pixels change, whatever lies below."""
    for name in ("image", "normal"):
        driver.actions.show(name)
        driver.frame()
        assert 0.002 < changed(driver, shown) < 0.7
    driver.actions.show("atlas")
    driver.frame(3)  # until its tiles stand clear of the legend
    assert changed(driver, shown) == 0.0, "there the records are nowhere"


@case("L")
def sites(driver: Driver, shown: str) -> None:
    """Dots where the surface cache has its sites; for a single bounce there are none, also after more, whose cache stays."""
    for bounces in (1, 2, 1):
        driver.session.change(0, bounces=bounces)
        driver.settle()
        assert (0.1 < changed(driver, shown) < 1.0) if bounces > 1 else changed(driver, shown) == 0.0


@case("G")
def by_age(driver: Driver, shown: str) -> None:
    """Other colours of the same dots."""
    assert changed(driver, shown) == 0.0
    bare = driver.canvas()
    push(driver, "Z")
    dots = driver.canvas()
    push(driver, shown)
    aged = driver.canvas()
    assert (aged != dots).any() and np.array_equal((aged != bare).any(-1), (dots != bare).any(-1))


@case("Ctrl+L")
def profile(driver: Driver, shown: str) -> None:
    """A drag draws a line instead of turning the view, and the plot's window tells how; again: it turns the view."""
    home = driver.session.camera
    for on in (True, False):
        push(driver, shown)
        driver.move(160, 100)
        driver.frame()
        driver.button(True, LEFT)
        driver.move(180, 110, 20, 10)
        driver.button(False, LEFT)
        assert driver.session.options.profile == on and (driver.session.camera == home) == on
    assert driver.session.line.ends is not None
    driver.actions.go(home)


@case("I")
def inspect(driver: Driver, shown: str) -> None:
    """The pixels that the record under the cursor serves are tinted, as many as it says."""
    driver.move(120, 120)
    driver.frame(2)
    before = driver.canvas()
    push(driver, shown)
    found = driver.viewer.inspected
    assert found is not None and found.lines[0][1].startswith(f"{found.number} of ")
    assert (driver.canvas() != before).any(-1).sum() == found.served > 10
    renderer, source = driver.session.renderers[0], driver.session.source(0)
    here, record = (
        driver.display.buffer_view.value("position", source, 120, 120),
        renderer.cache.read()["position"][found.number],
    )
    assert here is not None and np.linalg.norm(here - record) < 2.0 * renderer.settings.a * renderer.scene.diagonal
    driver.session.held = 0, found.number
    push(driver, shown)
    assert driver.viewer.inspected is None and driver.session.held is None
    assert np.array_equal(driver.canvas(), before)


@case("Shift+F")
def freeze(driver: Driver, shown: str) -> None:
    """From elsewhere, the cache stays as it is until it thaws."""
    count = driver.session.renderers[0].cache.count
    push(driver, shown)
    driver.session.free_camera.go(driver.session.scene.camera("corner"))
    driver.frame(PICTURES + 5)  # while the picture fades over
    assert driver.session.renderers[0].cache.count == count and driver.session.progress[0].coverage < 1.0
    assert driver.session.at_rest
    push(driver, shown)
    driver.settle()
    assert driver.session.renderers[0].cache.count > count and driver.session.progress[0].coverage == 1.0
    driver.session.free_camera.home()


@case("N")
def step(driver: Driver, shown: str) -> None:
    """Frozen, each press gathers one whole round, in however many ticks that takes."""
    driver.session.clear()
    driver.session.options.frozen = True
    driver.frame(2)
    counts = [driver.session.renderers[0].cache.count]
    for turn in (1, 2):
        push(driver, shown)
        driver.frame(10)
        assert driver.session.options.frozen and driver.session.progress[0].round == turn
        counts.append(driver.session.renderers[0].cache.count)
    assert counts[0] == 0 < counts[1] < counts[2]


@case("Delete")
def clear(driver: Driver, shown: str) -> None:
    """No record is left, and the view is covered anew by about as many, for 8² noisy texels as much as 60 % apart; the
    shadow maps stay."""
    cache, shadows = driver.session.renderers[0].cache, driver.session.renderers[0].shadows
    count = cache.count
    driver.session.options.frozen = True
    push(driver, shown)
    assert cache.count == 0
    driver.session.options.frozen = False
    driver.settle()
    assert driver.session.progress[0].coverage == 1.0 and 0.5 * count < cache.count < 2.0 * count
    assert driver.session.renderers[0].shadows is shadows


# ---- picture -------------------------------------------------------------------------------------------------------------


@case("[", "]")
def expose(driver: Driver, shown: str) -> None:
    """Half a stop: the picture is darker, or brighter, in every pixel that shows something; buffers of numbers stay."""
    before = driver.canvas().astype(int)
    push(driver, shown)
    way = 1 if shown == "]" else -1
    assert driver.session.settings(0)[1].exposure == 1.0 + 0.5 * way == driver.session.exposure
    after = driver.canvas().astype(int)
    assert (way * (after - before) >= 0).all() and (after != before).mean() > 0.5
    assert driver.session.ms == {}
    driver.actions.show("normal")
    driver.frame()
    assert changed(driver, "[") == 0.0 if shown == "]" else True


@case("\\")
def auto_exposure(driver: Driver, shown: str) -> None:
    """It comes to the exposure that brings the mean to mid grey, by and by."""
    push(driver, shown)
    renderer, view = driver.session.renderers[0], driver.session.views[0]
    goal = renderer.composite_pass.exposure(view.image)
    between = driver.session.exposure
    driver.settle()
    assert renderer.settings.exposure == "auto"
    assert driver.session.exposure == pytest.approx(goal, abs=0.02) and abs(between - goal) > 0.1


@case("Tab")
def split(driver: Driver, shown: str) -> None:
    """Off, two buffers, two presets, off; the left half stays what it was, up to the white line between."""
    before, middle = driver.canvas(), driver.wnd.width // 2
    for way in ("buffers", "presets"):
        driver.session.options.frozen = True  # the paper's own settings take a while
        push(driver, shown)
        if way == "presets":
            driver.quicken()
        driver.session.options.frozen = False
        driver.settle()
        picture = driver.canvas()
        assert driver.session.options.split == way and (picture[:, middle - 1 : middle + 1] == 255).all()
        assert np.array_equal(picture[:, : middle - 1], before[:, : middle - 1])
        assert (picture[:, middle + 1 :] != before[:, middle + 1 :]).any(-1).mean() > 0.2
    assert [r.preset for r in driver.session.active] == ["default", "paper"]
    push(driver, shown)
    assert driver.session.options.split == "off" and np.array_equal(driver.canvas(), before)


@case("M")
def swap_preset(driver: Driver, shown: str) -> None:
    """To the paper's settings, budget and exposure apart, and back to ours as they were left: the picture and its records are
    there at once, nothing is gathered."""
    ours, picture = driver.session.renderers[0], driver.canvas()
    settings, records, revision = ours.settings, ours.cache.count, ours.cache.revision
    driver.session.options.frozen = True  # the paper's own settings take a while
    push(driver, shown)
    preset, paper = driver.session.settings(0)
    assert preset == "paper"
    assert overrides("paper", paper).keys() <= {"exposure", "budget"} and paper.exposure == FAST["exposure"]
    assert not np.array_equal(driver.canvas(), picture)
    driver.session.options.frozen = False
    push(driver, shown)
    assert driver.session.renderers == [ours] and driver.session.settings(0) == ("default", settings)
    assert np.array_equal(driver.canvas(), picture)
    assert (ours.cache.count, ours.cache.revision) == (records, revision) and driver.session.progress[0].still


@case("J")
def compare(driver: Driver, shown: str) -> None:
    """Two presets, where there is one picture; one after the other, the difference, FLIP, and side by side again."""
    driver.session.options.frozen = True
    ways = ["flip", "difference", *(["FLIP"] if flip_is_there() else []), "divided"]
    for way in ways:
        push(driver, shown)
        assert (driver.session.options.split, driver.session.options.compare) == ("presets", way)
        assert COMPARES[driver.session.options.compare] in driver.said


@case("Space")
def flip(driver: Driver, shown: str) -> None:
    """To the right side, and back; it stays there, and is the one that keys change."""
    left = driver.canvas()
    driver.session.split("buffers")
    for side in (1, 0, 1):
        push(driver, shown)
        driver.frame(30, dt=0.1)
        assert driver.session.side_at(0) == driver.actions.side == side
        assert np.array_equal(driver.canvas(), left) == (side == 0)
    push(driver, "7")
    assert driver.session.options.buffers == ["image", "normal"]


@case("K")
def snapshot(driver: Driver, shown: str) -> None:
    """It is kept, and Tab comes to it."""
    push(driver, shown)
    assert [s.name for s in driver.session.snapshots] == ["snapshot 1"] and "snapshot 1 is kept" in driver.said
    driver.session.options.frozen = True
    ways = []
    for _ in range(4):
        push(driver, "Tab")
        ways.append(driver.session.options.split)
    assert ways == ["buffers", "presets", "snapshot", "off"]


@case("Y")
def trace(driver: Driver, shown: str) -> None:
    """Again: it stops. Else, a while later, the truth of this view is there, and is not traced again."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        tracer, truths = Tracer(monkeypatch), driver.session.truths
        push(driver, shown)
        assert truths.traced is not None
        push(driver, shown)
        assert truths.traced is None and "stopped" in driver.said
        push(driver, shown)
        tracer.finish(driver)
        (truth,) = truths.kept
        assert truth.subject.camera == driver.session.camera and truth.size == driver.wnd.buffer_size
        count = len(tracer.calls)
        push(driver, shown)
        push(driver, shown)
        assert truths.traced is None and len(tracer.calls) == count and truths.kept == [truth] and "already" in driver.said
