"""`irrsplat view`: the window. Each frame moves the camera, gives the session a tick of time, and draws picture and interface."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable, Sequence
from functools import partial

import moderngl
from imgui_bundle import imgui
from moderngl_window.context.base import BaseWindow
from moderngl_window.timers import Timer

from irrsplat.app.common.kept_cache import KeptCache
from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.shown_buffer import Identity, Picture
from irrsplat.app.viewer.input.controls import Controls
from irrsplat.app.viewer.preferences import Preferences, save
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.app.viewer.ui.interface import Interface
from irrsplat.app.viewer.window import TITLE, Desktop, open_window, return_large_arrays, signals
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.load_options import LoadOptions
from irrsplat.core.timing.clock import now
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Screen
from irrsplat.image.backdrop import GREY
from irrsplat.records import cache_file
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import SettingValues

SIZE = (1280, 720)
_SLEEP = 0.05  # seconds: the longest wait for an event after a frame that equals the previous one
_QUICK = 3  # the most frames in a row that are drawn for events alone, without a tick
_PASSES, _INSTANT = 2, 1e-4  # passes of the interface directly after an event, and the seconds between two passes
_AWAKE = 1.0  # seconds after an event in which frames continue: tooltips come late, and a window's size a frame late
_LOOK = 0.5  # seconds between two checks for changes without an event, such as a traced reference
_LEAST = 0.2  # the least share of the frame budget for the core, however slow all other work is
_DARK = 2.0  # seconds: the longest wait for the indirect light of a new scene, since direct light alone may be almost black
_LARGE = 2.5e6  # pixels of a first picture that is announced: a software renderer takes a second for it
_WORK = "work"  # the topic of announcements
_SMOOTHING = 0.3  # weight of the last frame in the running mean of the time of all other work


class Viewer(Owner):
    """The program in its window.

    source: the path or name of `scene`. preferences: the choices of the last run. values: settings on top of the preset. loading:
    the options by which `scene` was read.
    """

    def __init__(
        self,
        wnd: BaseWindow,
        scene: Scene,
        source: str,
        preferences: Preferences,
        camera: Camera | None = None,
        preset: str = "default",
        values: SettingValues | None = None,
        loading: LoadOptions = LoadOptions(),  # noqa: B008  # frozen, so safe as a default
    ) -> None:
        self.wnd, self.ctx, self.desktop = wnd, wnd.ctx, Desktop(wnd)
        self.session = self.own(Session(wnd.ctx, scene, wnd.buffer_size, preset, values, camera))
        self.display = self.own(Display(self.session))
        self.actions = Actions(self.session, source, preferences, loading, native=not wnd.headless)
        self.own(self.actions.film)
        self.backend = self.own(ImguiBackend())
        self.interface = Interface(self.actions, self.display)
        self.controls = Controls(wnd, self.actions, self.display, self.backend, lambda: self._place)
        self._pictures = self.own(Workshop())
        self._kept: tuple[KeptCache, Scene] | None = None  # the file of records, and the scene to which they belong
        self._awake_until = 0.0  # by the clock in use, seconds
        self._shown: object = None  # the last state of all parts that change without an event
        self._quick = 0  # frames since the last tick
        self._unspent = 0.0  # seconds since the last tick
        self._cut = False  # True if input ended the last tick
        self._overhead = 0.0  # seconds per frame of all work without the core's tick, a running mean
        self._work: Callable[[], object] | None = None  # work that takes seconds, and waits until its announcement is drawn
        self._announced = False  # True if the last frame has this announcement
        if not wnd.headless:
            self.actions.announce = self.announce
        self.desktop.listen(self.controls.files_dropped, self.controls.focus_changed)
        self.wake()
        self.pass_interface()  # so that the first picture has the size of the area without panels
        self._fit()
        for notice in self.session.notices:
            self.actions.say(notice)

    @property
    def canvas(self) -> Picture:
        """The picture. A smaller view of a moving camera has a smaller one, which the window enlarges, unless marks are on it."""
        session, options = self.session, self.session.options
        marked = options.discs or options.plane or options.inspect
        if session.whole or marked or not self.display.shows_scene:
            return self._pictures.get("whole", session.size, lambda: Picture(self.ctx, session.size))
        size = session.views[0].image.size
        return self._pictures.get("moving", size, lambda: Picture(self.ctx, size, moderngl.LINEAR))

    # ---- a frame ---------------------------------------------------------------------------------------------------

    def frame(self, dt: float) -> None:
        """Draw a frame, `dt` seconds after the last one: move, tick, draw all changes, and the interface over them."""
        if self._announced or self._minimised:  # a minimised window shows no announcement
            self.do_work()
        start = now()
        actions, session = self.actions, self.session
        answers = self._take_events()
        if self._minimised:
            return
        actions.collect()
        before, self._unspent = now(), self._unspent + dt
        interface = self.backend.io.want_capture_mouse or self.backend.io.want_capture_keyboard
        if answers and not self.controls.flies and self._quick < _QUICK and session.shows_now(any_camera=interface):
            self._quick += 1
        else:
            self._tick(hurried=answers and self.controls.flies)
        if self._minimised:
            return
        core, cursor = now() - before, self.controls.pointer
        self.display.update(self.canvas, cursor)
        self._present(dt, cursor)
        if session.renderers[0].about["software"]:
            self.ctx.finish()  # a software renderer draws in this process, and its time counts
        self._overhead += _SMOOTHING * (now() - start - core - self._overhead)
        self.wnd.is_closing |= actions.quitting

    def announce(self, words: str, work: Callable[[], object]) -> None:
        """Show `words` in the next frame, and call `work` after it."""
        self.do_work()
        self.actions.say(words, topic=_WORK)
        self._work = work

    def do_work(self) -> None:
        """Do the announced work, if any. The window shows the announcement until the next frame."""
        work, self._work, self._announced = self._work, None, False
        self.actions.messages.drop(_WORK)
        if work is not None:
            self.actions.attempt(work)

    def show_words(self, words: str) -> None:
        """Draw a frame with these words and without a picture, before work that takes seconds."""
        self.actions.say(words, topic=_WORK)
        self.pass_interface()  # a new message has no size in its first pass
        self.draw_window(_INSTANT)
        self.wnd.swap_buffers()
        self.actions.messages.drop(_WORK)

    def _take_events(self) -> bool:
        """Handle the waiting events. Events after a new size or scene wait for its first picture, or for announced work.

        Return True if the events need a frame of their own, without a tick. The interface needs several passes: for a motion, a
        press and a release, and for the size of a window that opens.
        """
        answers = False
        while self._work is None and (self.session.views or self._minimised) and (taken := self.desktop.take()):
            self.wake()
            answers = answers or not all(taken) or not self.controls.active
            if self.session.views and not self.controls.flies:  # no shortcut works in flight
                self.pass_interface()
            self._fit()
        self._fit()
        return answers

    @property
    def _minimised(self) -> bool:
        return not all(self.wnd.buffer_size)

    def _fit(self) -> None:
        size = self._place[2:]
        if not self._minimised and size != self.session.size:
            self.actions.attempt(lambda: self.session.resize(size))

    @property
    def _place(self) -> tuple[int, int, int, int]:
        """The picture's part of the window: left, top, width, height in pixels."""
        size = self.wnd.buffer_size
        return self.interface.layout.pixels(size[0] / max(self.wnd.width, 1), size)

    def pass_interface(self) -> None:
        """Make the interface's windows without drawing them."""
        for _ in range(_PASSES):
            self._draw_interface(_INSTANT, None)
            imgui.end_frame()

    def _draw_interface(self, dt: float, cursor: tuple[int, int] | None, picture: moderngl.Texture | None = None) -> None:
        """Begin a pass of the interface, `dt` seconds after the last one, and make its windows, over a `picture` if given."""
        if self.desktop.scale != self.backend.scale:
            self.backend.resize_scale(self.desktop.scale)
        self.backend.begin(self.wnd.size, self.wnd.buffer_size, dt)
        layout, options = self.interface.layout, self.session.options
        layout.start(self.backend.scale, options.controls and not options.hidden)
        if picture is not None:
            image, place = imgui.ImTextureRef(picture.glo), layout.picture
            imgui.get_background_draw_list().add_image(image, place[:2], place[2:], (0, 1), (1, 0))  # its bottom row is the first
        self.interface.draw(cursor)

    def _tick(self, hurried: bool) -> None:
        """Move the camera, and give the session a tick of time, which ends early for input.

        Flowing events, such as mouse motions, end at most every other tick, and no tick of a moving camera. The effect of another
        event in flight shows at once, since the tick after it gathers no records. hurried: True if such an event came before it.
        """
        session, start = self.session, now()
        slow = session.renderers[0].about["software"] and math.prod(session.size) > _LARGE
        if slow and not session.views and not self.wnd.headless:
            self.show_words("drawing the picture…")
        budget, dt = session.renderers[0].settings.budget / 1e3, max(self._unspent, 0.0)
        self._quick, self._unspent, first = 0, 0.0, not session.views
        self.controls.fly(dt)
        moving, seconds = session.moving, max(budget - self._overhead, _LEAST * budget)
        gatherer = session.renderers[0].scheduler.gatherer
        if first and gatherer.awaits_light and not math.isnan(session.auto_exposure.stops):  # a new size: its light takes a while
            session.tick(dt, seconds, gather=False)
            return
        flowing = not self._cut and not moving
        self._cut = not session.tick(dt, seconds, lambda: self.desktop.waits(flowing), gather=not (hurried and moving))
        if self._cut:
            self._take_events()
        if self._cut and moving and session.views:
            passed = now() - start
            self._unspent = -passed  # the next tick counts this time again
            self.controls.fly(passed)
            session.tick(passed, seconds, gather=False)
        waits = partial(self.desktop.waits, False)
        if not session.views:  # the scene or the size is new
            session.tick(0.0, seconds, waits)
        if first:  # the first picture takes a while, and notices are invisible before it
            end = now() + _DARK
            while gatherer.awaits_light and now() < end and not (session.options.frozen or waits()):
                session.tick(0.0, seconds, waits)
            self.actions.messages.renew()

    def _present(self, dt: float, cursor: tuple[int, int] | None) -> None:
        """Draw picture and interface into the window, and write the requested screenshot."""
        actions = self.actions
        if actions.screenshot_wanted:
            actions.screenshot_wanted = False
            if not self.session.whole:
                self.session.tick(0.0, self.session.renderers[0].settings.budget / 1e3)
                self.display.update(self.canvas, cursor)
            while not self.display.complete:
                self.display.update(self.canvas, cursor)
            actions.attempt(lambda: actions.save_screenshot(self.canvas.read()[..., :3]))
        self._announced = self._work is not None
        self.draw_window(dt, cursor, self.canvas.textures[0])

    def draw_window(self, dt: float, cursor: tuple[int, int] | None = None, picture: moderngl.Texture | None = None) -> None:
        """Draw the interface over a `picture`, or over grey."""
        self._draw_interface(dt, cursor, picture)
        window = Screen(self.wnd.fbo, self.wnd.buffer_size)
        window.use()
        window.gl.clear(*GREY[0])
        self.backend.draw()

    # ---- from start to end -----------------------------------------------------------------------------------------

    def wake(self) -> None:
        self._awake_until = now() + _AWAKE

    def end(self) -> None:
        """Close the window before the next frame. Unsaved changes are lost."""
        self.actions.quitting = self.wnd.is_closing = True

    @property
    def still(self) -> bool:
        """True if the next frame would equal this one without input."""
        rests = self.session.at_rest and self.display.complete and self._work is None and not self.controls.active
        return rests or self._minimised

    def may_sleep(self) -> bool:
        """Check for changes without an event. Return True if no frame has to be drawn.

        This is so if the picture is still, no event came for _AWAKE seconds, and no message appears or vanishes.
        """
        if not self.still or now() < self._awake_until:
            return False
        self.actions.collect()
        messages = self.actions.messages
        messages.expire()
        tracing = self.session.tracing
        traced = Identity(tracing.shown), None if tracing.traced is None else round(100.0 * tracing.traced)
        plane = self.session.plane.share if self.session.options.plane else None
        shown = messages.lines, traced, plane, self.wnd.buffer_size
        before, self._shown = self._shown, shown
        return shown == before and messages.rests > 0.0 and self.session.at_rest

    def _closing(self) -> bool:
        """Return True if the window shall close. Its close button opens the prompt about unsaved changes first."""
        if self.wnd.is_closing and not self.actions.quitting:
            self.actions.attempt(self.actions.quit)
            self.wnd.is_closing = self.actions.quitting
            self.wake()  # to draw the prompt
        return bool(self.wnd.is_closing)

    def loop(self) -> None:
        """Draw frames until the window closes. Draw no frame that would equal the previous one."""
        timer = Timer()
        timer.start()
        while not self._closing():
            slept = False
            while self.may_sleep() and not self._closing():
                self.desktop.wait(min(_LOOK, self.actions.messages.rests))
                self._take_events()
                slept = True
            _, dt = timer.next_frame()
            self.wnd.title = f"{self.actions.title}{'*' * self.actions.editor.unsaved} – {TITLE}"
            self.frame(_SLEEP if slept else dt)
            if not self._closing():
                self.wnd.swap_buffers()
                if self.still:
                    self.desktop.wait(_SLEEP)

    def close(self) -> str | None:
        """Save preferences, a flight in recording and records, and free everything except the window.

        Return None, or the reason of a failure.
        """
        choices = self.actions.preferences
        choices.size = choices.size if self.wnd.fullscreen else self.wnd.size
        problem = save(choices)
        try:
            if self.session.path_recorder.recording is not None:  # at a signal; quit writes it earlier
                self.actions.record()
        except (IrrsplatError, OSError) as error:
            problem = str(error)
        problem = self._save_cache() or problem
        self.release()
        return problem

    def load_cache(self, path: str, update: bool) -> None:
        """Load the file of the left side's records, if it exists, and save them there at the end.

        update: True if a file of another state of the scene is loaded, with a message. Records that differ are gathered again.
        Raises InputError for a file of other settings and, without `update`, of another scene.
        """
        self._kept = KeptCache(path), self.session.scene
        if os.path.exists(path) and (reason := self.session.renderers[0].load_cache(path, update)):
            self.actions.say(cache_file.renewal(path, reason))

    def _save_cache(self) -> str | None:
        """Write the file of records again, unless there are none. Return None, or the reason of an unchanged file in one line."""
        renderer = self.session.renderers[0]
        if self._kept is None or not renderer.cache.count:
            return None
        kept, scene = self._kept
        if self.session.scene is not scene:
            return f"{kept.path}: not written, since the scene on show is no longer the loaded one"
        try:
            kept.save(renderer.save_cache)
        except IrrsplatError as error:
            return str(error)
        return None


def run(
    scene: Scene,
    source: str,
    size: tuple[int, int] | None,
    preferences: Preferences,
    camera: Camera | None = None,
    preset: str = "default",
    values: SettingValues | None = None,
    notices: Sequence[str] = (),
    cache: str | None = None,
    loading: LoadOptions = LoadOptions(),  # noqa: B008  # frozen, so safe as a default
    update: bool = False,
) -> str | None:
    """Open the window on `scene`, and run until it closes. Return None, or the reason why preferences or records are not saved.

    values: settings on top of the preset. notices: lines to show at first. cache: the file of the scene's records. loading: the
    options by which `scene` was read. update: True if a file of another state of the scene is updated. Raises GLError if no
    window can be opened. Raises InputError for an invalid size, and for a cache file of another scene or other settings. Raises
    KeyboardInterrupt after Ctrl-C, with all closed.
    """
    return_large_arrays()
    wnd = open_window(size or preferences.size or SIZE)
    try:
        wnd.title = f"preparing {scene.name} – {TITLE}"
        wnd.fbo.clear(*GREY[0])
        wnd.swap_buffers()
        viewer = Viewer(wnd, scene, source, preferences, camera, preset, values, loading)
        viewer.show_words(f"preparing {viewer.actions.title}…")
        for notice in notices:
            viewer.actions.say(notice)
        came: list[int] = []
        try:
            if cache is not None:
                viewer.load_cache(cache, update)
            with signals(viewer.end) as came:
                viewer.loop()
        finally:
            problem = viewer.close()
        if signal.SIGINT in came:
            raise KeyboardInterrupt(f"interrupted; {problem or 'what the window keeps is written'}")
        return problem
    finally:
        wnd.destroy()
