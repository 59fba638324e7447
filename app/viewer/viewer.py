"""`irrsplat view`: the window; its events become flying, keys and menus, and each frame a tick of the session within its time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import moderngl_window
import numpy as np
from imgui_bundle import imgui
from moderngl_window.context.base import BaseWindow
from moderngl_window.timers import Timer

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.cache_file import CacheFile
from irrsplat.app.viewer.input.controls import Controls
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.show.screen import Screen
from irrsplat.app.viewer.ui.hud import Hud
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.app.viewer.ui.menu import Menu
from irrsplat.app.viewer.ui.panel import Panel
from irrsplat.app.viewer.window import TITLE, Desktop, open_window
from irrsplat.gpu.program import Program
from irrsplat.gpu.target import Target
from irrsplat.scene.model import Camera, Scene

SIZE = (1280, 720)
_REST = 0.05  # seconds that the window sleeps when nothing changes
_LEAST = 0.2  # of the budget is the core's, however slow the rest is
_FOLLOW = 0.3  # of the way goes the estimate of what the rest takes, each frame


class Viewer(Controls, moderngl_window.WindowConfig):
    """The program in its window. source: what `scene` was loaded from. preferences: how it was left last time."""

    def __init__(
        self, wnd: BaseWindow, scene: Scene, source: str, preferences: Preferences, camera: Camera | None = None
    ) -> None:
        moderngl_window.WindowConfig.__init__(self, ctx=wnd.ctx, wnd=wnd, timer=Timer())
        Controls.__init__(self)
        self.desktop = Desktop(wnd)
        self.actions = Actions(wnd.ctx, scene, source, wnd.buffer_size, preferences, camera, self.desktop.copy)
        self.backend = ImguiBackend(wnd.ctx, self.desktop.scale / wnd.pixel_ratio)
        self.panel, self.menu, self.hud = Panel(self.actions), Menu(self.actions), Hud(self.actions, self.backend)
        self.copy = Program(wnd.ctx, "viewer/buffers/copy", "lib/fullscreen")
        self.canvas = self._canvas(wnd.buffer_size)
        self.inspected: InspectedRecord | None = None
        self.cache_file: CacheFile | None = None  # of the records, where there is a file for them
        self._drawn: tuple[Any, ...] = ()  # what the canvas shows, by value
        self._shown: list[Any] = []  # and by identity: the same texture may hold something new
        self._rest = 0.0  # seconds that all but the core's tick takes
        self.actions.others = (self.copy, self.backend.program)
        self.desktop.listen(self.on_drop, self.on_focus, self.on_scale)
        for notice in scene.notices:
            self.actions.say(notice)

    def _canvas(self, size: tuple[int, int]) -> Target:
        return Target(self.ctx, size, textures=[self.ctx.texture(size, 4)])

    # ---- a frame ---------------------------------------------------------------------------------------------------

    def on_render(self, time: float, frame_time: float) -> None:
        """One frame: move, tick, draw what has changed, and the interface over it."""
        self.frame(frame_time)

    def frame(self, dt: float) -> None:
        """A frame, `dt` seconds after the last."""
        start = time.perf_counter()
        actions, session = self.actions, self.actions.session
        if actions.wants_fullscreen != self.wnd.fullscreen:
            self.wnd.fullscreen = actions.wants_fullscreen
        size = self.wnd.buffer_size
        if not all(size):  # minimised
            return
        if size != session.size:
            actions.trying(lambda: session.resize(size))
            self.canvas.textures[0].release()
            self.canvas.release()
            self.canvas = self._canvas(size)
        actions.look_after_files()
        actions.look_after_truth()
        self._fly(dt)
        before = time.perf_counter()
        budget = session.renderers[0].settings.budget / 1e3
        session.tick(dt, max(budget - self._rest, _LEAST * budget))
        core = time.perf_counter() - before
        cursor = self.pointer
        self._paint(cursor)
        self._present(dt, cursor)
        self.hud.frames.append(1e3 * dt)
        self.hud.ticks.append(1e3 * (time.perf_counter() - start))
        self._rest += _FOLLOW * (time.perf_counter() - start - core - self._rest)
        if actions.quitting:
            self.wnd.is_closing = True

    def _timed(self, name: str, start: float) -> None:
        """Note the milliseconds since `start` under `name`, on a software renderer with all drawing done."""
        if self.actions.session.renderers[0].about["software"]:
            self.ctx.finish()
        self.hud.extra[name] = 1e3 * (time.perf_counter() - start)

    def _paint(self, cursor: tuple[int, int] | None) -> None:
        """Draw the picture, where it is not what was drawn last."""
        session, start = self.actions.session, time.perf_counter()
        options = session.options
        handles = [*session.views, *(thing for r in session.active for thing in (r.shadows, r.scheduler.gatherer.atlas))]
        handles += [r.scheduler.gatherer.surface.result for r in session.active if r.scheduler.gatherer.surface is not None]
        handles += [session.truths.of(session.scene, session.camera, session.size, r.settings.bounces) for r in session.active]
        about = [(r.settings, r.cache.count, r.cache.revision) for r in session.active]
        state = about, asdict(options), session.exposure, session.held, options.inspect and cursor, self.canvas
        same = len(handles) == len(self._shown) and all(a is b for a, b in zip(handles, self._shown, strict=True))
        if state != self._drawn or not same:
            self._drawn, self._shown = state, handles
            self.inspected = session.draw(self.canvas, cursor)
        self._timed("display", start)

    def _present(self, dt: float, cursor: tuple[int, int] | None) -> None:
        """Put picture and interface into the window, and into a file where one is asked for."""
        actions, size, start = self.actions, self.wnd.buffer_size, time.perf_counter()
        shot, actions.shot = actions.shot, ""
        if shot == "bare":
            actions.save_shot(self._pixels(self.canvas))
        window = Screen(self.wnd.fbo, size)
        target = self._canvas(size) if shot == "whole" else window
        self.copy(target, picture=self.canvas.textures[0])
        self.backend.begin(self.wnd.size, size, dt)
        self._interface(cursor)
        self.backend.draw(target.gl)
        if target is not window:
            self.copy(window, picture=target.textures[0])
            actions.save_shot(self._pixels(target))
            target.textures[0].release()
            target.release()
        self._timed("interface", start)

    def _interface(self, cursor: tuple[int, int] | None) -> None:
        scale, actions = self.desktop.scale / self.wnd.pixel_ratio, self.actions
        if not actions.panels.hidden:
            self.hud.lamps()
            self.menu.bar()
            self.panel.floor = self.hud.legend_height
            self.panel.settings(scale)
            self.panel.lights(scale)
            self.hud.numbers(scale, actions.session.renderers[0].timers.clock)
            self.hud.legends(scale, cursor)
            self.hud.record(self.inspected, scale)
            self.menu.sheet()
            self.menu.dialog()
        if not actions.panels.hidden or any(m.error for m in actions.messages):
            self.hud.messages(scale)
        if not self.looking:
            imgui.set_mouse_cursor(imgui.MouseCursor_.arrow)

    @staticmethod
    def _pixels(target: Target) -> np.ndarray:
        """An RGBA8 target as display values 0..1 (H, W, 3), top row first."""
        width, height = target.size
        return np.frombuffer(target.textures[0].read(), "u1").reshape(height, width, 4)[::-1, :, :3] / np.float32(255.0)

    # ---- from begin to end -----------------------------------------------------------------------------------------

    def loop(self) -> None:
        """Frames until the window closes."""
        self.timer.start()
        while not self.wnd.is_closing:
            _, dt = self.timer.next_frame()
            self.wnd.title = f"{self.actions.session.scene.name} – {TITLE}"
            self.wnd.render(self.timer.time, dt)
            if not self.wnd.is_closing:
                self.wnd.swap_buffers()
                still = self.actions.session.at_rest and not self.held and not self.looking
                if still or not all(self.wnd.buffer_size):
                    self.desktop.wait(_REST)

    def close(self, remember: bool = True) -> str | None:
        """Keep what is to be remembered, and free everything but the window; None, or why it could not be kept."""
        said = None
        if remember:
            said = self.actions.remember(None if self.wnd.fullscreen else self.wnd.size, self.wnd.fullscreen)
            said = (self.cache_file.save() if self.cache_file is not None else None) or said
        self.actions.session.release()
        self.canvas.textures[0].release()
        for thing in (self.canvas, self.copy, self.backend):
            thing.release()
        return said


def run(
    scene: Scene,
    source: str,
    size: tuple[int, int] | None,
    preferences: Preferences,
    camera: Camera | None = None,
    notices: Sequence[str] = (),
    cache: str | None = None,
) -> str | None:
    """Open the window on `scene` and stay until it closes; None, or what could not be remembered.

    notices: lines to show at first. cache: the file that its records are kept in. Raises GLError where no window can be had,
    and InputError where there is such a file, but not of this scene and these settings.
    """
    wnd = open_window(size or preferences.size or SIZE)
    try:
        viewer = Viewer(wnd, scene, source, preferences, camera)
        for notice in notices:
            viewer.actions.say(notice)
        try:
            viewer.cache_file = None if cache is None else CacheFile(cache, viewer.actions)
            viewer.loop()
        finally:
            said = viewer.close()
        return said
    finally:
        wnd.destroy()
