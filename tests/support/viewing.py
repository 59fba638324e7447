"""Viewer in an off-screen window with simulated keys, mouse and text, and frames in between."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Condition, Event, Thread, current_thread
from typing import Any, Unpack

import numpy as np
import pytest
from imgui_bundle import imgui
from moderngl_window.context.base import KeyModifiers

import irrsplat
from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers import background_reference
from irrsplat.app.viewer.buffers.background_reference import TracedReference
from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Programs, ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.editor import Editor
from irrsplat.app.viewer.input.commands import GROUPS, KEYS
from irrsplat.app.viewer.input.free_camera import PathRecorder
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.view_options import ViewOptions
from irrsplat.app.viewer.viewer import Viewer
from irrsplat.app.viewer.window import open_window
from irrsplat.core.timing import other_process
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Region, Target
from irrsplat.image.frame import Frame
from irrsplat.image.tonemap import exposure_of
from irrsplat.indirect import temporal_filter
from irrsplat.records.cache_file import CacheState
from irrsplat.reference import worker
from irrsplat.reference.truth import Traced
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Light, Scene
from irrsplat.settings import SettingValues, preset
from tests.support.worlds import shared

SIZE = (320, 240)
FAST: SettingValues = {
    "bounces": 1,
    "gather_size": 8,
    "shadow_size": 64,
    "radius_min": 2.0,
    "radius_max": 20.0,
    "exposure": 1.0,
    "viewer_samples": 0,
    "viewer_quality": 0.0,
}
LEFT, RIGHT = 1, 2
SAFETY = 120.0  # seconds: limit of a wait for a thread; no result depends on it
ROOM = """cam 0 0 2.6  0 0 0  0 1 0
cam corner 0.5 0.3 0.6  -0.6 -0.4 -0.6  0 1 0
proj 50 1 0.1 100
light lamp.light
brdf diffuse 0.8 0.7 0.6 1
obj walls.obj
brdf diffuse 0.7 0.1 0.1 1
obj left.obj
brdf diffuse 0.2 0.6 0.8 1
push
trans 0.2 -0.6 -0.2
rotate 20 0 1 0
scale 0.4 0.4 0.4
obj box.obj
pop
"""
LIGHT = "position 0.3 0.6 0.2 1\nintensity 3 3 3\n"
_CORNERS = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))  # 1 + 4·(x>0) + 2·(y>0) + (z>0)
OBJECTS = {
    "walls.obj": _CORNERS + "f 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 5 7 8 6\n",  # floor, ceiling, back, right; open in front
    "left.obj": _CORNERS + "f 1 2 4 3\n",
    "box.obj": _CORNERS + "f 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 5 7 8 6\nf 1 2 4 3\nf 2 6 8 4\n",
}


def write_room(folder: Path) -> Path:
    """Write an open room of 2 m with a light and a box into `folder`; return the .scene."""
    for name, text in {**OBJECTS, "lamp.light": LIGHT, "room.scene": ROOM}.items():
        (folder / name).write_text(text)
    return folder / "room.scene"


@dataclass(frozen=True)
class ShownView(Owner):
    """View of a renderer with the viewer's exposure, and its arrays."""

    source: ViewSource
    frame: Frame
    programs: Programs

    def owned(self) -> tuple[Resource, ...]:
        return (self.renderer, self.programs)

    @property
    def renderer(self) -> Renderer:
        return self.source.renderer

    @property
    def seen(self) -> np.ndarray:
        """Return the mask (H, W) of pixels with a surface."""
        return np.isfinite(self.frame.depth)

    def draw(self, target: Target, name: str, region: Region | None = None) -> np.ndarray:
        """Return the picture (H, W, 3) of a buffer, top row first."""
        BUFFERS[name].draw(Canvas(target, self.programs, region), self.source)
        return target.read()[..., :3]

    def value(self, name: str, x: int, y: int) -> np.ndarray | None:
        """Return the value of a buffer at a pixel."""
        return BUFFERS[name].value(self.source, x, y)


def shown_view(scene: Scene, rounds: int = 2, size: tuple[int, int] = (97, 61), **settings: object) -> ShownView:
    """Return the first camera's view after `rounds` rounds of gathering, in the shared context."""
    quick: dict[str, Any] = {"bounces": 1, "gather_size": 16, "shadow_size": 128} | settings
    renderer = Renderer(scene, size, ctx=shared(), **quick)
    for _ in range(rounds):
        renderer.frame()
    view, _ = renderer.frame(gather=False)
    frame = view.read()
    return ShownView(ViewSource(renderer, view, exposure_of(frame.image)), frame, Programs(renderer.ctx))


@dataclass(frozen=True)
class Widget:
    """Widget by its imgui kind, and its box without the label next to it.

    box: left, top, right, bottom in window coordinates.
    """

    kind: str
    label: str
    box: tuple[float, float, float, float]

    def at(self, along: float = 0.5) -> tuple[float, float]:
        """Return a point of the widget, `along` 0..1 from left to right."""
        left, top, right, bottom = self.box
        return left + along * (right - left), 0.5 * (top + bottom)


class Driver:
    """Viewer with simulated input. Every frame is checked for OpenGL errors."""

    def __init__(self, viewer: Viewer, values: SettingValues) -> None:
        self.viewer, self.wnd = viewer, viewer.wnd
        self.values, self.source = values, viewer.actions.source  # restored by `reset`
        self.scene = viewer.actions.session.scene  # restored by `reset`
        self.size = self.wnd.size
        self.density = 1.0  # restored by `reset`
        self.records: CacheState | None = None  # of the initial converged view, for `reset`
        self.modifiers = KeyModifiers()
        self.widgets: list[Widget] = []  # of the last frame

    @property
    def actions(self) -> Actions:
        return self.viewer.actions

    @property
    def session(self) -> Session:
        return self.viewer.actions.session

    @property
    def display(self) -> Display:
        return self.viewer.display

    @property
    def said(self) -> str:
        """Return all visible messages."""
        return "\n".join(m.text for m in self.actions.messages.lines)

    # ---- time and pictures ---------------------------------------------------------------------------------------

    def frame(self, count: int = 1, dt: float = 0.05) -> None:
        for _ in range(count):
            self.widgets.clear()
            self.viewer.frame(dt)
            error = self.viewer.ctx.error
            assert error == "GL_NO_ERROR", error

    def settle(self, most: int = 400, when: str = "") -> None:
        """Render frames until no work is left, and one more to show the result. when: text for the error at the limit."""
        for _ in range(most):
            self.frame()
            if self.session.at_rest:
                return self.frame()
        pytest.fail(f"not converged after {most} frames {when}: {self.session.progress}")

    def window(self) -> np.ndarray:
        """Return the window's pixels, (H, W, 3) uint8, top row first."""
        width, height = self.wnd.buffer_size
        pixels = self.wnd.fbo.read((0, 0, width, height), components=3, alignment=1)
        return np.frombuffer(pixels, "u1").reshape(height, width, 3)[::-1].copy()

    def canvas(self, target: Target | None = None) -> np.ndarray:
        """Return the pixels below the interface, or of another target, (H, W, 3) uint8, top row first."""
        texture = (target or self.viewer.canvas).textures[0]
        return np.frombuffer(texture.read(), "u1").reshape(texture.height, texture.width, 4)[::-1, :, :3].copy()

    def resize(self, size: tuple[int, int], density: float = 1.0) -> None:
        """Resize the window; (0, 0) minimises it.

        density: pixels per window unit. Low values save time, with unchanged widget positions.
        """
        if all(size) and size != self.wnd.size:
            self.viewer.ctx.detect_framebuffer(0).use()  # the window frees its bound framebuffer
            self.wnd.size = size
            self.wnd.use()
        pixels = [round(density * n) for n in size]  # the off-screen window does not store it
        self.wnd._buffer_width, self.wnd._buffer_height = pixels

    def seen(self, point: tuple[float, float, float]) -> tuple[float, float]:
        """Return the window coordinates of a point of the scene."""
        found = self.viewer.interface.layout.seen(self.session.camera, point)
        assert found is not None
        return found

    # ---- keys ----------------------------------------------------------------------------------------------------

    def down(self, name: str) -> None:
        """Press a key; as on X11, a modifier's own event has the modifiers before it."""
        self.viewer.controls.key(self._number(name), self.wnd.keys.ACTION_PRESS, self.modifiers)
        self._modify(name, True)

    def up(self, name: str) -> None:
        """Release a key."""
        self.viewer.controls.key(self._number(name), self.wnd.keys.ACTION_RELEASE, self.modifiers)
        self._modify(name, False)

    def _number(self, name: str) -> int:
        """Return the number of a key; moderngl-window has no name for Alt."""
        return 342 if name == "LEFT_ALT" else int(getattr(self.wnd.keys, name))

    def _modify(self, name: str, on: bool) -> None:
        if name.endswith("_SHIFT"):
            self.modifiers.shift = on
        if name.endswith("_CTRL"):
            self.modifiers.ctrl = on
        if name.endswith("_ALT"):
            self.modifiers.alt = on

    def press(self, name: str, ctrl: bool = False, shift: bool = False) -> None:
        """Press and release a key, and render a frame."""
        held = ("LEFT_CTRL",) * ctrl + ("LEFT_SHIFT",) * shift
        for modifier in held:
            self.down(modifier)
        self.down(name)
        self.up(name)
        for modifier in held:
            self.up(modifier)
        self.frame()

    def type(self, text: str) -> None:
        """Type text."""
        for char in text:
            self.viewer.backend.io.add_input_characters_utf8(char)
        self.frame(2)

    # ---- mouse ---------------------------------------------------------------------------------------------------

    def move(self, x: float, y: float, dx: float = 0.0, dy: float = 0.0) -> None:
        """Move the mouse to (x, y), or, captured, by (dx, dy)."""
        was = self.viewer.controls.mouse
        if not (dx or dy):
            dx, dy = x - was[0], y - was[1]
        self.viewer.controls.mouse_moved(x, y, dx, dy)

    def button(self, down: bool, button: int = LEFT) -> None:
        x, y = self.viewer.controls.mouse
        act = self.viewer.controls.mouse_pressed if down else self.viewer.controls.mouse_released
        act(x, y, button)

    def click(self, x: float, y: float, button: int = LEFT) -> None:
        """Click at a point, slowly enough for the interface."""
        self.drag((x, y), (x, y), button)

    def drag(self, start: tuple[float, float], end: tuple[float, float], button: int = LEFT) -> None:
        """Press at `start`, move to `end` in four steps, release."""
        self.move(*start)
        self.frame(2)
        self.button(True, button)
        self.frame()
        for i in range(1, 5) if end != start else ():
            self.move(*(a + (b - a) * i / 4 for a, b in zip(start, end, strict=True)))
            self.frame()
        self.button(False, button)
        self.frame(2)

    # ---- the interface -------------------------------------------------------------------------------------------

    def find(self, label: str, beside: str = "", header: bool = False) -> Widget:
        """Return the last frame's widget with this label.

        beside: label of another widget in the same line, for ambiguous labels. header: True for a collapsible header.
        """
        found = [w for w in self.widgets if w.label.split("##")[0] == label and header == (w.kind == "collapsing_header")]
        if beside:
            line = self.find(beside).at()[1]
            found = [w for w in found if abs(w.at()[1] - line) < 4.0]
        assert found, f"no {label!r} among {[w.label for w in self.widgets]}"
        return found[0]

    def choose(self, *labels: str) -> None:
        """Click on one label after the other, through menus, lists and buttons."""
        for label in labels:
            self.click(*self.find(label).at())

    def enter(self, widget: Widget, text: str) -> None:
        """Type a value into a slider: Ctrl+click, replace all, Enter."""
        self.down("LEFT_CTRL")
        self.click(*widget.at())
        self.press("A")
        self.up("LEFT_CTRL")
        self.type(text)
        self.press("ENTER")
        self.frame(2)

    def split_presets(self) -> None:
        """Show two presets side by side, the right one (paper) with settings for a fast picture; wait for convergence."""
        self.session.split(True)
        self.quicken()
        self.settle()

    def quicken(self) -> None:
        """Apply settings for a fast picture on the right side."""
        self.session.change(1, warmup=20, a=0.8, gather_size=8, shadow_size=64, viewer_samples=0)

    def reset(self) -> None:
        """Restore the initial state: options, panels, camera, settings, lights; no widget under the mouse, a converged view."""
        actions, session = self.actions, self.session
        self.resize(self.size, self.density)
        self.viewer.controls.focus_changed(True)
        self.modifiers = KeyModifiers()
        self.viewer.controls.mouse_released(0, 0, LEFT)
        self.viewer.controls.mouse_released(0, 0, RIGHT)
        session.split(False)
        for renderer in session.renderers[1:]:
            renderer.release()
        session.renderers[1:] = []
        actions.prompt, actions.editor.saved = None, actions.editor.scene  # no prompt for unsaved changes
        if actions.source != self.source:
            actions.open(self.source)
            self.scene = session.scene
        actions.screenshot_wanted = False
        actions.messages.lines.clear()
        actions.saved_as = ""
        session.options, session.path_recorder = ViewOptions(controls=False), PathRecorder()
        session.tracing.release()
        actions.quitting = False
        speed = session.scene.diagonal / 6.0
        session.free_camera.speed = speed
        session.free_camera.home()
        for renderer in session.renderers:
            renderer.change(preset("default", **self.values), "default")
        session.pose(self.scene)
        actions.editor = Editor(session)
        self.move(self.wnd.width - 20.0, self.wnd.height - 20.0)
        renderer = session.renderers[0]
        if self.records is None:
            self.settle()
            self.records = renderer.scheduler.state()
        else:  # an equal state needs no gathering
            renderer.forget()
            renderer.scheduler.apply(renderer.settings, renderer.scene, renderer.shadows)
            renderer.scheduler.restore(self.records)
            self.settle()
            self.frame(8)  # the interface drops its click state


_WIDGETS = (
    *("slider_float", "checkbox", "combo", "begin_combo", "small_button", "button", "radio_button", "menu_item", "begin_menu"),
    *("selectable", "collapsing_header", "drag_int", "drag_float", "drag_float3", "color_edit3", "input_text"),
)
_NAMED = ("slider_float", "combo", "begin_combo", "drag_int", "drag_float", "drag_float3", "color_edit3")  # label on the right


@contextmanager
def watched(driver: Driver) -> Iterator[None]:
    """Record the widgets' boxes of the driver's viewer in this context."""
    plain = {name: getattr(imgui, name) for name in _WIDGETS}

    def watch(name: str, make: Callable[..., Any]) -> Callable[..., Any]:
        def widget(label: str, *args: Any, **options: Any) -> Any:
            result = make(label, *args, **options)
            if name in ("begin_menu", "begin_combo") and result:  # an open menu's last item belongs to another window
                return result
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            right, seen = high.x, label.split("##")[0]
            if seen and name in _NAMED:
                right -= imgui.calc_text_size(seen).x + imgui.get_style().item_inner_spacing.x
            driver.widgets.append(Widget(name, label, (low.x, low.y, right, high.y)))
            return result

        return widget

    for name, make in plain.items():
        setattr(imgui, name, watch(name, make))
    try:
        yield
    finally:
        for name, make in plain.items():
            setattr(imgui, name, make)


def brighter(light: Light) -> Light:
    """Return the light with twice its output."""
    red, green, blue = light.color
    return replace(light, color=(2.0 * red, 2.0 * green, 2.0 * blue))


@contextmanager
def viewing(
    source: str | Path, size: tuple[int, int] = SIZE, preferences: Preferences | None = None, **settings: Unpack[SettingValues]
) -> Iterator[Driver]:
    """Open a viewer of the scene at `source` with settings for fast pictures; close it without saving preferences."""
    wnd = open_window(size, headless=True)
    viewer = Viewer(wnd, irrsplat.load(source), str(source), preferences or Preferences(), values={**FAST, **settings})
    viewer.session.options.controls = False
    driver = Driver(viewer, {**FAST, **settings})
    with watched(driver):
        yield driver
    with wnd.ctx:
        viewer.release()
        assert wnd.ctx.error == "GL_NO_ERROR"
    wnd.ctx.release()


def fresh(driver: Driver, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """Provide the driver in its initial converged state, its context current; the viewer writes to `folder`."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(folder / "config"))
    monkeypatch.setenv("IRRSPLAT_CACHE", str(folder / "cache"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
    monkeypatch.setenv("XDG_PICTURES_DIR", str(folder / "pictures"))
    monkeypatch.setenv("XDG_VIDEOS_DIR", str(folder / "videos"))
    monkeypatch.chdir(folder)
    monkeypatch.setattr(temporal_filter, "PICTURES", 1)  # for faster convergence of a changed view
    with driver.wnd.ctx:
        driver.reset()
        yield driver


class Tracer:
    """Stand-in for the path tracer: busy until `go` is set, then done with a synthetic irradiance.

    early: passes before that. calls: the requested cameras, sizes and bounces, in order. The plan has two passes.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, early: int = 0) -> None:
        self.go, self.early = Event(), early
        self.calls: list[tuple[Camera, tuple[int, int], int]] = []
        self._waiting: set[Thread] = set()  # threads that made their early passes
        self._change = Condition()
        monkeypatch.setattr(other_process, "call", self.call)
        monkeypatch.setattr(worker, "require", lambda: None)
        monkeypatch.setattr(Actions, "missing", lambda self, command: "")
        monkeypatch.setattr(background_reference, "SIDES", (2, 2))

    def call(
        self,
        code: str,
        arguments: tuple[Scene, Camera, tuple[int, int], tuple[int, ...], int],
        progress: Callable[[float], object],
        take: Callable[[dict[str, np.ndarray]], object],
        failure: str,
    ) -> None:
        _, camera, size, sides, bounces = arguments
        self.calls.append((camera, size, bounces))
        for _ in sides[: self.early]:
            take(self.make(size))
        progress(0.25)
        with self._change:
            self._waiting.add(current_thread())
            self._change.notify_all()
        while not self.go.wait(0.05):
            progress(0.25)
        for _ in sides[self.early :]:
            take(self.make(size))

    @staticmethod
    def make(size: tuple[int, int]) -> dict[str, np.ndarray]:
        """Return a different irradiance for every pixel, up to 2 W/m²; every fifth is background."""
        chance = np.random.default_rng(5)
        shape = size[1], size[0]
        seen = chance.random(shape) < 0.8
        halves = (chance.uniform(0.0, 2.0, (2, *shape, 3)) * seen[..., None]).astype("f4")
        return {"halves": halves, "seen": seen, "valid": seen}

    @classmethod
    def traced(cls, size: tuple[int, int]) -> Traced:
        """Return the irradiance with the other channels of a reference, in grey."""
        found = cls.make(size)
        grey = np.full((*found["seen"].shape, 3), 0.5, "f4")
        kinds = dict.fromkeys(("direct", "emission", "albedo", "normal", "tint", "glow"), grey)
        return Traced(**found, **kinds, opacity=grey[..., 0], clear=found["seen"])

    def begin(self, driver: Driver) -> None:
        """Render frames until a thread traces the view on show, and wait for its early passes."""
        for _ in range(20):
            driver.frame()
            if (thread := driver.session.tracing._tracing) is not None:
                with self._change:
                    assert self._change.wait_for(lambda: thread.calling in self._waiting, SAFETY)
                return driver.frame()
        pytest.fail("no tracing after 20 frames")

    def wait(self, driver: Driver) -> TracedReference:
        """Wait until the viewer shows the reference of the early passes; return this reference."""
        self.begin(driver)
        driver.frame()
        found = driver.session.source(0).reference
        assert found is not None and found.estimate.samples == 8 * self.early
        return found

    def finish(self, driver: Driver) -> None:
        """Let the tracer end, and render frames until the viewer has its reference."""
        self.go.set()
        for _ in range(20):
            driver.frame()
            if (thread := driver.session.tracing._tracing) is not None:
                thread.calling.join(SAFETY)
            found = driver.session.source(0).reference
            if found is not None and found.estimate.samples == 16 and driver.session.tracing.traced is None:
                return driver.frame()
        pytest.fail("no reference after 20 frames")


# ---- keys and their cases ------------------------------------------------------------------------------------------------


def push(driver: Driver, shown: str) -> None:
    """Press the key with the display name `shown`."""
    found = next(k for k in KEYS if k.shown == shown)
    driver.press(found.key, found.ctrl, found.shift)


Case = Callable[[Driver, str], None]


class Cases:
    """One check for every key of these groups, called with the driver and the key's display name.

    elsewhere: keys with checks in other tests, or in another key's check.
    """

    def __init__(self, *groups: str, elsewhere: Sequence[str] = ()) -> None:
        self.keys = [k.shown for group in groups for k in GROUPS[group] if k.shown not in elsewhere]
        self.made: dict[str, Case] = {}

    def case(self, *keys: str) -> Callable[[Case], Case]:
        """Register a function as the check of each of `keys`."""

        def add(check: Case) -> Case:
            self.made.update(dict.fromkeys(keys, check))
            return check

        return add

    def run(self, driver: Driver, shown: str, moving: tuple[str, ...] = ()) -> None:
        """Check a key: the camera stays, except for keys in `moving`, no error occurs, and the viewer does not quit."""
        before = driver.session.camera
        self.made[shown](driver, shown)
        assert shown in moving or driver.session.camera == before
        assert not driver.actions.quitting and not driver.actions.messages.errors

    def check(self) -> None:
        """Assert that every key has a check, and that key names are unique."""
        assert sorted(self.made) == sorted(self.keys)
        assert len({k.shown for k in KEYS}) == len({(k.key, k.ctrl, k.shift) for k in KEYS}) == len(KEYS)
