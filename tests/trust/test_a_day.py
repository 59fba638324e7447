"""A day's use in minutes: random user actions in all bundled scenes, over several laps.

The run has no OpenGL error or message, no hole in a converged view, no record above the limit, and a constant number of
OpenGL objects. Over many laps memory is constant too: after each lap, in an equal state, it is within GROWTH of the maximum
of the first third of the laps, which load all libraries.

IRRSPLAT_LAPS: laps through all scenes; without it, two through a few. IRRSPLAT_ACTIONS: actions per scene of a lap (4).
IRRSPLAT_SEED: their seed (1). With -s, memory is printed.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from irrsplat.app.viewer.input.commands import KEYS
from irrsplat.scene import bundled
from tests.app.editing.test_random_actions import ACTS, QUICK
from tests.app.viewer.test_viewer_leaks import LEFT_OUT, Watch, resident
from tests.renderer.test_no_holes import holes
from tests.support.viewing import Driver, viewing, write_room

LAPS = int(os.environ.get("IRRSPLAT_LAPS", "2"))
SCENES = tuple(bundled()) if "IRRSPLAT_LAPS" in os.environ else ("furnace",)
ACTIONS = int(os.environ.get("IRRSPLAT_ACTIONS", "4"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "1"))
DT = 0.1  # seconds per frame
KEPT = 2500  # limit of records
REST = 20_000  # limit of frames until convergence
GROWTH = 1.05
MANY = 9  # laps, from which memory is checked
OBJECTS = 12  # OpenGL objects that may be added later: programs of overlays at first use, glyphs of the interface
EDITED = 3  # meshes that edits need


def anything(driver: Driver, draw: np.random.Generator, often: np.ndarray) -> str:
    """Perform one random user action; return its name."""
    if draw.random() < 0.25:
        key = KEYS[draw.integers(len(KEYS))]
        if not {key.action, key.argument} & LEFT_OUT:
            driver.press(key.key, key.ctrl, key.shift)
            return key.shown
    if draw.random() < 0.1:
        name = str(draw.choice(["screenshot", "record"]))
        getattr(driver.actions, name)()
        return name
    one, _ = ACTS[draw.choice(len(ACTS), p=often / often.sum())]
    if len(driver.session.scene.meshes) >= EDITED or one.__module__ != ACTS[0][0].__module__:
        one(driver, draw)
    return one.__name__


def check(driver: Driver, done: list[str]) -> None:
    """Assert for the converged view that every surface pixel has a record, unless the limit of records is reached.

    The limit always holds.
    """
    session = driver.session
    session.options.frozen = False
    if session.path_recorder.recording is not None:
        driver.actions.record()  # ends the recording
    for side in range(len(session.active)):  # a key may have selected a preset with minutes of refinement
        session.change(side, viewer_samples=0, viewer_quality=0.0)
    driver.settle(REST, f"after {done}, with {[(r.preset, r.cache.count, r.settings) for r in session.active]}")
    for view, progress, renderer in zip(session.views, session.progress, session.active, strict=True):
        assert renderer.cache.count <= renderer.settings.max_records, f"{renderer.cache.count} records after {done}"
        left = holes(view)
        assert progress.full or (left == 0 and progress.coverage == 1.0), f"{left} holes with {renderer.preset} after {done}"


@pytest.mark.long
def test_random_actions_over_laps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)
    draw, often = np.random.default_rng(SEED), np.array([weight for _, weight in ACTS])
    watch = Watch(monkeypatch)
    room, frames, done = str(write_room(tmp_path)), 0, list[str]()
    memory, objects = list[float](), list[int]()
    with viewing(room, (96, 64), budget=20.0) as driver:
        driver.values |= {**QUICK, "max_records": KEPT}
        for _ in range(LAPS):
            for scene in (*SCENES, room):
                driver.reset()
                driver.session.change(0, **driver.values)
                driver.actions.open(scene)
                done = [scene]
                for _ in range(ACTIONS):
                    done.append(anything(driver, draw, often))
                    more = int(draw.integers(1, 6))
                    driver.frame(more, dt=DT)
                    frames += more
                    assert not driver.actions.messages.errors, f"{driver.said} after {done}"
                check(driver, done)
                assert driver.wnd.ctx.error == "GL_NO_ERROR", f"after {done}"
            driver.reset()
            driver.actions.open(room)
            driver.settle(REST)
            memory.append(resident())
            objects.append(watch.alive().total())
            for file in tmp_path.glob("*-*-*"):
                file.unlink()
    listed = ", ".join(f"{one:.0f}" for one in memory)
    print(f"\n{LAPS * ACTIONS * (len(SCENES) + 1)} actions, {frames} frames; MiB after each lap: {listed}; objects: {objects}")
    first = max(LAPS // 3, 1)
    assert LAPS < MANY or max(memory[first:]) <= GROWTH * max(memory[:first]), f"MiB after each lap: {listed}"
    assert max(objects[first:]) <= max(objects[:first]) + OBJECTS, f"objects of OpenGL after each lap: {objects}"
