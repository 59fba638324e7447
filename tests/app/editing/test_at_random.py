"""A user who does anything at all: no action leaves a hole, an OpenGL error or an exception, and all edits can be undone.

IRRSPLAT_EDITS: how many actions are tried (8). IRRSPLAT_SEED: which ones.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.editor import KINDS, Editor
from irrsplat.app.viewer.editing.lamps import Vector
from irrsplat.app.viewer.editing.picking import on_screen
from irrsplat.app.viewer.editing.scene_edit import SceneEdit, middle
from irrsplat.app.viewer.editing.sun_sky import SunSky
from irrsplat.app.viewer.view_options import COMPARES
from irrsplat.settings import SettingValues
from tests.renderer.test_no_holes import holes
from tests.support.viewing import LEFT, RIGHT, Driver, push

EDITS = int(os.environ.get("IRRSPLAT_EDITS", "8"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "7"))
CHECKED = 8  # actions after which the view comes to rest and is looked at
MOST = 4000  # records, above which they are forgotten, so that it stays quick
SIZES = (96, 64), (128, 72), (64, 96), (80, 60)
BOX = 2
QUICK: SettingValues = {
    "warmup": 20, "a": 0.8, "gather_size": 8, "shadow_size": 64, "viewer_samples": 0, "viewer_quality": 0.0, "exposure": 1.0,
    "borrow": 0,
}  # fmt: skip

Draw = np.random.Generator
Act = Callable[[Driver, Draw], None]
ACTS: list[tuple[Act, float]] = []  # and how often each is drawn


def act(often: float) -> Callable[[Act], Act]:
    """One of the things that a user may do."""

    def add(one: Act) -> Act:
        ACTS.append((one, often))
        return one

    return add


def editor(driver: Driver) -> Editor:
    return driver.actions.editor


def free(driver: Driver, place: tuple[float, float]) -> bool:
    """Whether a place is the picture's, not a panel's, where a click might do anything."""
    driver.move(*place)
    driver.frame(2)
    return not driver.viewer.backend.wants_mouse


def vector(values: np.ndarray) -> Vector:
    return cast(Vector, tuple(values.tolist()))


# ---- edits -----------------------------------------------------------------------------------------------------------------


@act(1.0)
def move(driver: Driver, draw: Draw) -> None:
    made = editor(driver)
    made.set_object(BOX, replace(made.object(BOX), offset=vector(draw.uniform(-0.3, 0.3, 3))))


@act(1.0)
def turn(driver: Driver, draw: Draw) -> None:
    made = editor(driver)
    made.set_object(BOX, replace(made.object(BOX), turn=vector(draw.uniform(-90.0, 90.0, 3))))


@act(1.0)
def paint(driver: Driver, draw: Draw) -> None:
    made, number = editor(driver), int(draw.integers(3))
    made.set_object(number, replace(made.object(number), albedo=vector(draw.uniform(0.0, 0.9, 3))))


@act(1.0)
def glow(driver: Driver, draw: Draw) -> None:
    made, number = editor(driver), int(draw.integers(3))
    emission = vector(draw.choice([0.0, 1.0]) * draw.uniform(0.0, 3.0, 3))
    made.set_object(number, replace(made.object(number), emission=emission))


@act(1.0)
def hide(driver: Driver, draw: Draw) -> None:
    """By its key, where one is picked."""
    made, number = editor(driver), int(draw.integers(3))
    if draw.random() < 0.5 and not made.object(number).hidden:
        made.pick_mesh(number)
        push(driver, "Backspace")
    else:
        made.hide(number, not made.object(number).hidden)


@act(2.0)
def set_lamp(driver: Driver, draw: Draw) -> None:
    """Move, heat, dim and switch one."""
    made = editor(driver)
    if not made.lamps:
        return
    number = int(draw.integers(len(made.lamps)))
    lamp = made.lamps[number].moved(vector(draw.uniform(-0.9, 0.9, 3))).heated(float(draw.uniform(1500.0, 12_000.0)))
    made.set_lamp(number, replace(lamp, on=bool(draw.random() < 0.8), stops=float(draw.uniform(-2.0, 2.0))))


@act(1.0)
def add_lamp(driver: Driver, draw: Draw) -> None:
    if len(editor(driver).lamps) < 4:
        driver.actions.add_light(KINDS[draw.integers(3)])


@act(1.0)
def delete_lamp(driver: Driver, draw: Draw) -> None:
    made = editor(driver)
    if made.lamps:
        made.delete_light(int(draw.integers(len(made.lamps))))


@act(0.7)
def set_sky(driver: Driver, draw: Draw) -> None:
    """At any time of the day, and by night."""
    before = editor(driver).sky or SunSky()
    editor(driver).set_sky(replace(before, minute=int(draw.integers(24 * 60)), day=int(draw.integers(1, 366))))


@act(3.0)
def drag_handles(driver: Driver, draw: Draw) -> None:
    """Of the box, or of a light; somewhere near their middle, so that some drags orbit instead."""
    made, (width, height) = editor(driver), driver.session.size
    point = driver.session.scene.bounds.mean(0)
    driver.actions.panels.lights = bool(draw.random() < 0.5)
    if driver.actions.panels.lights and made.lamps:
        made.pick_light(int(draw.integers(len(made.lamps))))
        light = made.lamps[made.light or 0].light
        point = point if light.directional else np.asarray(light.position)
        made.aiming = bool(draw.random() < 0.3)
    elif not made.object(BOX).hidden:
        made.pick_mesh(BOX)
        made.turning = bool(draw.random() < 0.5)
        point = middle(driver.session.scene.meshes[BOX])
    driver.frame(2)
    at = on_screen(driver.session.camera, (width, height), vector(np.asarray(point, float)))
    if at is not None and 0.0 <= at[0] < width and 0.0 <= at[1] < height:
        start = at[0] + float(draw.integers(-8, 9)) * float(draw.random() < 0.5), at[1]
        end = start[0] + float(draw.uniform(-15.0, 15.0)), start[1] + float(draw.uniform(-15.0, 15.0))
        if free(driver, start):
            driver.drag(start, end)


# ---- the rest --------------------------------------------------------------------------------------------------------------


@act(2.0)
def fly(driver: Driver, draw: Draw) -> None:
    keys = [str(k) for k in draw.choice(list("WASDEQ"), 2, replace=False)]
    for key in keys:
        driver.down(key)
    driver.frame(int(draw.integers(1, 5)), dt=0.1)
    for key in keys:
        driver.up(key)


@act(1.0)
def look(driver: Driver, draw: Draw) -> None:
    driver.move(40.0, 50.0)
    driver.button(True, RIGHT)
    driver.move(40.0, 50.0, 1.0, 1.0)
    driver.move(40.0, 50.0, float(draw.uniform(-40.0, 40.0)), float(draw.uniform(-20.0, 20.0)))
    driver.frame()
    driver.button(False, RIGHT)


@act(1.0)
def click_or_orbit(driver: Driver, draw: Draw) -> None:
    start = float(draw.uniform(0.0, 60.0)), float(draw.uniform(24.0, 60.0))
    if not free(driver, start):
        return
    if draw.random() < 0.5:
        driver.click(*start, LEFT)
    else:
        driver.drag(start, (start[0] + 12.0, start[1] + 5.0))


@act(2.0)
def jump(driver: Driver, draw: Draw) -> None:
    push(driver, str(draw.choice(["Home", "Home", "End", "F"])))


@act(1.5)
def preset(driver: Driver, draw: Draw) -> None:
    push(driver, "M")
    driver.session.change(driver.actions.side, **QUICK)


@act(2.0)
def show(driver: Driver, draw: Draw) -> None:
    names = [name for name in BUFFERS if not BUFFERS[name].needs_truth]
    driver.actions.show(str(draw.choice([*names, "image", "light"])))


@act(1.0)
def toggle(driver: Driver, draw: Draw) -> None:
    """Overlays, panels and the cache's state."""
    push(
        driver,
        str(draw.choice(["Z", "X", "V", "G", "L", "T", "I", "F1", "F2", "F3", "F4", "F6", "Shift+F", "N", "H", "O", "Esc"])),
    )


@act(1.0)
def compare(driver: Driver, draw: Draw) -> None:
    """Another split, and another way to show both sides."""
    session = driver.session
    way = str(draw.choice(["off", "off", "buffers", "presets", "snapshot"]))
    if way == "snapshot" and not session.snapshots:
        if not session.views:  # there is no picture to keep before the first one
            driver.settle()
        session.keep_snapshot(0)
    session.split(way)  # type: ignore[arg-type]
    if way == "presets":
        session.change(1, **QUICK)
    driver.actions.compare_by(draw.choice([c for c in COMPARES if c != "FLIP"]))


@act(1.5)
def resize(driver: Driver, draw: Draw) -> None:
    driver.resize(SIZES[draw.integers(len(SIZES))])
    driver.frame()


@act(0.5)
def clear(driver: Driver, draw: Draw) -> None:
    push(driver, "Delete")


# ---- what holds ------------------------------------------------------------------------------------------------------------


def check(driver: Driver, done: list[str]) -> None:
    """At rest, each pixel that sees anything has a record, on both sides."""
    session = driver.session
    session.options.frozen = False
    if max(r.cache.count for r in session.renderers) > MOST:
        session.clear()
    driver.settle(3000)
    for view, progress, renderer in zip(session.views, session.progress, session.active, strict=True):
        left = holes(view)
        assert left == 0 and progress.coverage == 1.0, f"{left} holes with {renderer.preset} after {done}"


@pytest.mark.slow
def test_whatever_a_user_does_leaves_no_hole_and_can_be_undone(driver: Driver) -> None:
    """After every few actions the view is looked at, at rest; edits, undone and done again, are those of a list kept beside; and
    all undone, the scene is the one that was loaded."""
    driver.resize(SIZES[0])
    driver.actions.appearance.scale = 0.75
    driver.session.change(0, **QUICK)
    draw, states, at, edits, done = np.random.default_rng(SEED), [SceneEdit.of(editor(driver).loaded)], 0, 0, list[str]()
    often = np.array([weight for _, weight in ACTS])
    for step in range(EDITS):
        if draw.random() < 0.2:
            back = bool(draw.random() < 0.6)
            done.append("undo" if back else "redo")
            (driver.actions.undo if back else driver.actions.redo)()
            at = max(at - 1, 0) if back else min(at + 1, len(states) - 1)
        else:
            one, _ = ACTS[draw.choice(len(ACTS), p=often / often.sum())]
            done.append(one.__name__)
            one(driver, draw)
            driver.frame(2)
            if editor(driver).edit != states[at]:
                states, at, edits = [*states[: at + 1], editor(driver).edit], at + 1, edits + 1
        driver.frame(int(draw.integers(1, 4)))
        assert not driver.actions.messages.errors, f"{driver.said} after {done}"
        assert editor(driver).edit == states[at] == editor(driver).history.present, f"another edit than expected after {done}"
        if step % CHECKED == CHECKED - 1 or step == EDITS - 1:
            check(driver, done)
            done = done[-2 * CHECKED :]
    assert edits > EDITS // 8
    while editor(driver).undo():
        driver.frame()
    assert editor(driver).edit == states[0] and driver.session.scene.meshes is editor(driver).loaded.meshes
    check(driver, [*done, "all undone"])
