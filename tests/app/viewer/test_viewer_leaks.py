"""A minute of anything that a user may do: no OpenGL error, and neither objects nor memory that stay behind."""

from __future__ import annotations

import ctypes
import gc
import random
import weakref
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import moderngl
import pytest

from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.input.keys import KEYS
from irrsplat.app.viewer.view_options import SPLITS
from irrsplat.settings import SettingValues
from tests.support.viewing import LEFT, RIGHT, Driver, viewing, write_room

SECONDS, DT = 12.0, 1.0 / 10.0
CREATORS = ("texture", "depth_texture", "buffer", "framebuffer", "program", "vertex_array")
SIZES = ((96, 72), (64, 96), (128, 64), (96, 72))
LEFT_OUT = {
    "quit",
    "fullscreen",
    "reload",
    "screenshot",
    "screenshot_bare",
    "record",
    "bookmark",
    "open_dialog",
    "snapshot",
}  # see `rare`
LEFT_OUT |= {"trace"}  # takes minutes: test_background_truth.py


class Watch:
    """All OpenGL objects that are made while it lasts, by kind, but for those that are gone."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[tuple[str, Any]] = []
        for name in CREATORS:
            monkeypatch.setattr(moderngl.Context, name, self._watched(name, getattr(moderngl.Context, name)))

    def _watched(self, name: str, create: Callable[..., Any]) -> Callable[..., Any]:
        def make(*args: Any, **options: Any) -> Any:
            thing = create(*args, **options)
            self.made.append((name, thing))
            return thing

        return make

    def alive(self) -> Counter[str]:
        self.made = [one for one in self.made if not isinstance(one[1].mglo, moderngl.InvalidObject)]
        return Counter(name for name, _ in self.made)


def resident() -> float:
    """MiB of memory that this process has now, with what it has freed given back to the system where that can be asked for."""
    gc.collect()
    if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):
        trim(0)
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    raise AssertionError("no VmRSS")


def anything(driver: Driver, chance: random.Random) -> None:
    """One thing that a user may do between two frames."""
    session, actions = driver.session, driver.actions
    width, height = driver.wnd.size
    place = chance.uniform(0, width), chance.uniform(30, height)  # below the menus, which might open another scene
    what = chance.choice(
        ("fly", "fly", "look", "drag", "wheel", "key", "buffer", "set", "light", "split", "size", "camera", "menu")
    )
    if what == "fly":
        for name in chance.sample("WASDEQ", 2):
            chance.choice((driver.down, driver.up))(name)
    elif what in ("look", "drag"):
        driver.move(*place)
        button = RIGHT if what == "look" else LEFT
        driver.button(True, button)
        for _ in range(3):
            driver.move(*place, chance.uniform(-20, 20), chance.uniform(-10, 10))
        driver.button(False, button)
    elif what == "wheel":
        driver.move(*place)
        driver.viewer.controls.wheel(0.0, chance.choice((-1.0, 1.0)))
    elif what == "key":
        key = chance.choice([k for k in KEYS if k.action not in LEFT_OUT])
        if key.ctrl:
            driver.down("LEFT_CTRL")
        driver.down(key.name)
        driver.up(key.name)
        driver.up("LEFT_CTRL")
    elif what == "buffer":
        actions.show(chance.choice(list(BUFFERS)))
    elif what == "set":
        name, values = chance.choice(
            (("a", (0.5, 1.0)), ("smooth", (True, False)), ("gradients", (True, False)), ("gather", ("raster", "plane")),
             ("gather_size", (8, 12)), ("shadow_size", (32, 64)), ("bounces", (0, 1, 1, 1)), ("blend", (0.3, 0.5)),
             ("exposure", ("auto", 1.0)), ("kernel", ("cut", "smooth")), ("radius_max", (20.0, 60.0)))
        )  # fmt: skip
        session.change(chance.choice((0, 1)), **cast(SettingValues, {name: chance.choice(values)}))
    elif what == "light":
        lamp = actions.editor.lamps[0].moved((chance.uniform(-0.9, 0.9), chance.uniform(-0.9, 0.9), 0.3))
        actions.editor.set_lamp(0, replace(lamp, on=chance.random() < 0.8, stops=chance.uniform(-2.0, 2.0)))
    elif what == "split":
        session.split(chance.choice([way for way in SPLITS if way != "snapshot" or session.snapshots]))
        if session.options.split == "presets":
            driver.quicken()
    elif what == "size":
        driver.resize(chance.choice(SIZES))
    elif what == "camera":
        actions.go(session.scene.camera(chance.choice((None, "corner"))))
    else:
        actions.panels.settings, actions.panels.lights, actions.panels.hud = (chance.random() < 0.5 for _ in range(3))


def rare(driver: Driver, second: int) -> None:
    """Now and then: scene and shaders again, a flight recorded and played, a screenshot, a snapshot; and the cache begins anew.

    The records' textures double where they are full: thus they come to the same size in each of these spans.
    """
    actions, session = driver.actions, driver.session

    def snapshot() -> None:
        session.forget_snapshot(session.keep_snapshot(0))

    {
        0: actions.reload,
        2: actions.screenshot,
        3: snapshot,
        4: actions.record,
        6: actions.record,
        7: actions.play,
        9: actions.clear,
    }.get(second % 10, lambda: None)()


@pytest.mark.long
def test_a_quarter_of_a_minute_of_anything_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The objects that live are those that the present state needs: brought into the same state, their number is the same.

    That is measured after each third, after a reload at rest. Programs that the viewer's overlays make on first use, and the
    interface's textures, which grow with the letters seen, may come once: 12 objects, and 16 MiB, after the first third.
    """
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)
    watch, chance = Watch(monkeypatch), random.Random(7)
    counts: list[int] = []
    memory: list[float] = []
    frames = round(SECONDS / DT)
    with viewing(write_room(tmp_path), SIZES[0], radius_min=4.0, radius_max=40.0, budget=4.0) as driver:
        for number in range(1, frames + 1):
            if chance.random() < 0.4:
                anything(driver, chance)
            driver.frame(dt=DT)
            if number % round(1 / DT) == 0:
                rare(driver, number * round(DT * 1e6) // 1_000_000)
            assert not [m for m in driver.actions.messages.lines if m.error], driver.said
            if number % (frames // 3) == 0:
                driver.reset()
                driver.actions.reload()
                driver.settle()
                counts.append(watch.alive().total())
                memory.append(resident())
                for file in tmp_path.glob("*-room-*"):
                    file.unlink()
        assert driver.session.scene.lights and number == frames
    assert max(counts[1:]) <= counts[0] + 12, f"objects after each third: {counts}"
    assert max(memory[1:]) <= memory[0] + 16.0, f"MiB after each third: {memory}"
    watch.alive()
    fbo = driver.wnd.fbo
    own = [fbo, *fbo.color_attachments, fbo.depth_attachment]
    assert [one for _, one in watch.made if all(one is not other for other in own)] == [], (
        "after closing, but for the window's own"
    )


def test_nothing_of_the_scene_before_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once another scene is open, nothing holds a renderer or a scene of before: a large one is gigabytes."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    with viewing(write_room(tmp_path), (320, 240), radius_min=4.0, radius_max=40.0, budget=20.0) as driver:
        session, actions = driver.session, driver.actions
        driver.reset()
        options = session.options
        driver.move(120.0, 120.0)
        driver.frame(2)
        options.inspect = True
        driver.frame(2)
        assert driver.viewer.inspected is not None
        options.points = options.discs = options.sites = options.wire = True
        before: list[weakref.ref[object]] = []
        for name in [name for name in BUFFERS if not BUFFERS[name].needs_truth]:
            actions.show(name)
            driver.frame(2)
            before += [weakref.ref(view) for view in session.views]
        actions.show("image")
        for way in (*(way for way in SPLITS if way != "snapshot"), "off"):
            session.split(way)
            if way == "presets":
                driver.quicken()
            driver.frame(3)
            for options.compare in ("difference", "FLIP", "divided"):
                driver.frame(3)
                before += [weakref.ref(view) for view in session.views]
        actions.editor.mesh = 0
        driver.frame(2)
        before += [weakref.ref(thing) for thing in (session.renderers[0].world.geometry, *session.renderers[0].scene.meshes)]
        session.forget_snapshot(session.keep_snapshot(0))
        lamp = actions.editor.lamps[0]
        actions.editor.set_lamp(0, lamp.moved((0.2, 0.5, 0.1)))
        driver.frame(3)
        options.inspect = options.points = options.discs = options.sites = options.wire = False
        actions.show("image")
        driver.frame(2)
        before += [weakref.ref(thing) for renderer in session.renderers for thing in (renderer, renderer.world, renderer.scene)]
        actions.open("furnace")
        driver.settle()
        gc.collect()
        assert [one() for one in before if one() is not None] == []
