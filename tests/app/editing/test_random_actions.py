"""Random user actions: no action leaves a hole, an OpenGL error or an exception, and all edits can be undone.

IRRSPLAT_EDITS: the number of actions (8). IRRSPLAT_SEED: their random numbers.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.editor import Editor
from irrsplat.app.viewer.editing.objects import heated
from irrsplat.app.viewer.view_options import Point
from irrsplat.app.viewer.window import Desktop
from irrsplat.scene.motion import transformed
from irrsplat.settings import SettingValues
from tests.renderer.test_no_holes import holes
from tests.support.viewing import Driver, brighter, push

EDITS = int(os.environ.get("IRRSPLAT_EDITS", "8"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "7"))
CHECKED = 8  # actions between two checks of the converged view
SIZES = (96, 64), (128, 72), (64, 96), (80, 60)
BOX = 2
QUICK: SettingValues = {"warmup": 20, "a": 0.8, "gather_size": 8, "shadow_size": 64, "exposure": 1.0}
QUICK |= {"viewer_samples": 0, "viewer_quality": 0.0}
KEYS = (*("Home", "Home", "End", "Delete", "Shift+F", "Esc", "F1", "F2", "F3", "F4"), *"XI")

Draw = np.random.Generator
Act = Callable[[Driver, Draw], None]


def editor(driver: Driver) -> Editor:
    return driver.actions.editor


def triple(draw: Draw, high: float, low: float | None = None) -> Point:
    return cast(Point, tuple(draw.uniform(-high if low is None else low, high, 3).tolist()))


def set_object(driver: Driver, draw: Draw) -> None:
    """Move the box, or change albedo, emission or visibility of any object."""
    made, number, way = editor(driver), int(draw.integers(3)), np.eye(4)
    way[:3, 3] = triple(draw, 0.1)
    mesh = made.scene.meshes[number]
    match draw.integers(4):
        case 0:
            made.set_mesh(BOX, transformed(made.scene.meshes[BOX], way))
        case 1:
            made.set_mesh(number, replace(mesh, material=replace(mesh.material, albedo=triple(draw, 0.9, 0.0))))
        case 2:
            emission = triple(draw, float(draw.choice([0.0, 3.0])), 0.0)
            made.set_mesh(number, replace(mesh, material=replace(mesh.material, emission=emission)))
        case _:
            made.hide(number)


def set_lights(driver: Driver, draw: Draw) -> None:
    """Delete a light, or change its position, colour temperature and intensity."""
    made = editor(driver)
    if not made.scene.lights:
        return
    number = int(draw.integers(len(made.scene.lights)))
    if draw.random() < 0.25:
        made.set_light(number)
    else:
        light = heated(replace(made.scene.lights[number], position=triple(draw, 0.9)), float(draw.uniform(1700.0, 12_000.0)))
        made.set_light(number, brighter(light) if draw.random() < 0.8 else replace(light, color=(0.0, 0.0, 0.0)))


def move_camera(driver: Driver, draw: Draw) -> None:
    """Fly by keys, then orbit or click."""
    key = str(draw.choice(list("WASDEQ")))
    driver.down(key)
    driver.frame(int(draw.integers(1, 5)), dt=0.1)
    driver.up(key)
    start, by = draw.uniform((0.0, 24.0), 60.0).tolist(), float(draw.choice([0.0, 12.0]))
    driver.move(*start)
    driver.frame(2)
    if not driver.viewer.backend.io.want_capture_mouse:  # a click on a panel may have any effect
        driver.drag((start[0], start[1]), (start[0] + by, start[1] + 0.4 * by))


def press(driver: Driver, draw: Draw) -> None:
    """Press a random key of cameras, overlays, panels or the cache, or select another preset."""
    if draw.random() < 0.3:
        driver.actions.session.use_preset(str(draw.choice(("paper", "default"))))
        driver.session.change(driver.session.options.side, **QUICK)
    else:
        push(driver, str(draw.choice(KEYS)))


def show(driver: Driver, draw: Draw) -> None:
    """Show another buffer in another window size, with or without split, or one side of the split."""
    driver.actions.show(str(draw.choice([name for name in BUFFERS if name not in ("reference", "error")])))
    driver.resize(SIZES[draw.integers(len(SIZES))])
    driver.frame()
    session = driver.session
    on = bool(draw.random() < 0.5)
    session.split(on)
    if on:
        session.change(1, **QUICK)
    if on and draw.random() < 0.5:
        driver.actions.compare(alone=True)


# actions and their weights
ACTS: list[tuple[Act, float]] = [(set_object, 5.0), (set_lights, 4.0), (move_camera, 4.0), (press, 4.5), (show, 4.5)]


def check(driver: Driver, done: list[str]) -> None:
    """Assert that in the converged view each pixel with a surface has a record, on both sides."""
    session = driver.session
    session.options.frozen = False
    driver.settle(3000)
    for view, progress, renderer in zip(session.views, session.progress, session.active, strict=True):
        left = holes(view)
        assert left == 0 and progress.coverage == 1.0, f"{left} holes with {renderer.preset} after {done}"


@pytest.mark.long
def test_random_actions_leave_no_hole_and_can_be_undone(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """After undo and redo, the scene is the tracked one of a list; after undoing all edits, the scene is the loaded one."""
    driver.resize(SIZES[0])
    monkeypatch.setattr(Desktop, "scale", 0.75)
    driver.session.change(0, **QUICK)
    draw, states, at, edits, done = np.random.default_rng(SEED), [editor(driver).loaded], 0, 0, list[str]()
    often = np.array([weight for _, weight in ACTS])
    for step in range(EDITS):
        if draw.random() < 0.2:
            back = bool(draw.random() < 0.6)
            done.append("undo" if back else "redo")
            (driver.actions.editor.undo if back else driver.actions.editor.redo)()
            at = max(at - 1, 0) if back else min(at + 1, len(states) - 1)
        else:
            one, _ = ACTS[draw.choice(len(ACTS), p=often / often.sum())]
            done.append(one.__name__)
            one(driver, draw)
            if editor(driver).scene is not states[at]:
                states, at, edits = [*states[: at + 1], editor(driver).scene], at + 1, edits + 1
        driver.frame(int(draw.integers(2, 5)))
        assert not driver.actions.messages.errors, f"{driver.said} after {done}"
        assert editor(driver).scene is states[at] is editor(driver).present, f"another scene than expected after {done}"
        if step % CHECKED == CHECKED - 1 or step == EDITS - 1:
            check(driver, done)
    assert edits > EDITS // 8
    while editor(driver).undo():
        driver.frame()
    assert editor(driver).scene is states[0]
    check(driver, [*done, "all undone"])
