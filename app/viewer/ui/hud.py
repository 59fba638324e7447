"""What stands over the picture: times and numbers, the legend with the value under the cursor, messages, the record inspected."""

from __future__ import annotations

from collections import deque
from typing import Any

import moderngl
import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.background_truth import Truth
from irrsplat.app.viewer.input.keys import KEYS
from irrsplat.app.viewer.show.legend import SHOWINGS, TRUTHS, Legend, legend
from irrsplat.app.viewer.show.markers import radius_legend
from irrsplat.app.viewer.show.record_inspector import InspectedRecord
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.image.view import View

FRAMES = 120  # in the plot
_PLAIN = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
    | imgui.WindowFlags_.no_move
)
_RED, _AMBER = (0.75, 0.2, 0.15, 0.92), (0.98, 0.67, 0.30, 1.0)
_MARGIN = 8.0
_LEGEND = 340.0  # width of its text, at most
_NUMBERS = 212.0  # width of their window, at least: what is to be clicked stays where it is while the lines change


class Hud:
    """Draws what stands over the picture of a actions, and keeps the times of the last frames."""

    def __init__(self, actions: Actions, backend: ImguiBackend) -> None:
        self.actions, self.backend = actions, backend
        self.frames: deque[float] = deque(maxlen=FRAMES)  # milliseconds from picture to picture
        self.ticks: deque[float] = deque(maxlen=FRAMES)  # milliseconds of work
        self.legend_height = 0.0  # window coordinates that the legend took
        self.numbers_size = (0.0, 0.0)
        self._record_height = 0.0
        self._read: dict[int, tuple[tuple[Any, ...], tuple[Any, ...], np.ndarray | None]] = {}  # by side: values, and of what
        self.extra: dict[str, float] = {}  # milliseconds of what is not the core's, by name

    def numbers(self, scale: float, clock: str) -> None:
        """Frames a second, milliseconds by stage, records, coverage, and the plot of the last frames."""
        actions, session = self.actions, self.actions.session
        if not actions.panels.hud or not session.progress:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos((view.size.x - _MARGIN, 30.0 * scale), imgui.Cond_.always, (1.0, 0.0))
        imgui.set_next_window_bg_alpha(0.72)
        imgui.set_next_window_size_constraints((_NUMBERS * scale, 0.0), (view.size.x, view.size.y))
        imgui.begin("numbers", None, _PLAIN)
        recent = list(self.frames)[-20:]
        mean = sum(recent) / max(len(recent), 1)
        work = self.ticks[-1] if self.ticks else 0.0
        imgui.text(f"{1e3 / max(mean, 1e-3):.0f} fps, {work:.0f} ms a tick" + (", at rest" if session.at_rest else ""))
        most = max(max(self.frames, default=0.0), 100.0)
        plot = np.array(self.ticks, "f4") if self.ticks else np.zeros(1, "f4")
        imgui.plot_lines("##ticks", plot, 0, f"0..{most:.0f} ms", 0.0, most, (190.0 * scale, 40.0 * scale))
        self._buttons()
        if imgui.begin_table("stages", 2, imgui.TableFlags_.sizing_stretch_prop, (190.0 * scale, 0.0)):
            for stage, ms in {**session.ms, **self.extra}.items():
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_disabled(stage)
                imgui.table_next_column()
                imgui.text(f"{ms:6.1f} ms")
            imgui.end_table()
        imgui.text_disabled(f"clock: {clock}")
        for side, progress in enumerate(session.progress):
            imgui.separator()
            renderer = session.renderers[side]
            who = f"{('left', 'right')[side]}: " if len(session.progress) > 1 else ""
            imgui.text(f"{who}{progress.records} records, {progress.new} new")
            in_view = renderer.scheduler.count_in_view(session.camera, renderer.size)
            imgui.text(f"{in_view} in view, coverage {100.0 * progress.coverage:.1f} %")
            if progress.surface < 1.0:
                imgui.text_colored(_AMBER, f"surface cache {100.0 * progress.surface:.0f} %")
            if progress.stale:
                imgui.text_colored(_AMBER, f"{progress.stale} to be gathered again")
            if progress.full:
                imgui.text_colored(_AMBER, "this view needs more: raise max_records")
        took = imgui.get_window_size()
        self.numbers_size = (took.x, took.y)
        imgui.end()

    def _buttons(self) -> None:
        actions = self.actions
        if imgui.small_button("thaw" if actions.session.options.frozen else "freeze"):
            actions.toggle("frozen")
        for word, action in (("step", "step"), ("clear", "clear")):
            imgui.same_line()
            if imgui.small_button(word):
                actions.press(next(k for k in KEYS if k.action == action))
        if actions.session.options.frozen:
            imgui.same_line()
            imgui.text_colored(_AMBER, "frozen")
        if actions.session.path_recorder.recording is not None:
            imgui.text_colored(_AMBER, "recording (R ends it)")
        if actions.session.path_recorder.playing is not None:
            imgui.text_colored(_AMBER, "playing (P stops it)")
        self._tracing()

    def _tracing(self) -> None:
        share = self.actions.session.truths.share
        if share is not None:
            imgui.text_colored(_AMBER, f"tracing, {100.0 * share:.0f} % (Y stops it)")

    # ---- legend ----------------------------------------------------------------------------------------------------

    def legends(self, scale: float, cursor: tuple[int, int] | None) -> None:
        """Of each side: what is shown, in which colours and units, and its value under the cursor."""
        session = self.actions.session
        if not session.views:
            return
        view, height = imgui.get_main_viewport(), 0.0
        density = session.size[0] / max(view.size.x, 1.0)
        for side, region in session.sides():
            left = (region[0] if region else 0) / density
            width = (region[2] if region else session.size[0]) / density
            imgui.set_next_window_pos((left + _MARGIN, view.size.y - _MARGIN), imgui.Cond_.always, (0.0, 1.0))
            imgui.set_next_window_bg_alpha(0.72)
            imgui.begin(f"legend {side}", None, _PLAIN | imgui.WindowFlags_.no_inputs)
            imgui.push_text_wrap_pos(min(max(width - 4.0 * _MARGIN, 60.0), _LEGEND * scale))
            self._legend(side, scale, cursor if cursor and session.side_at(cursor[0]) == side else None)
            imgui.pop_text_wrap_pos()
            height = max(height, imgui.get_window_height())
            imgui.end()
        self.legend_height = height + 2.0 * _MARGIN

    def _legend(self, side: int, scale: float, cursor: tuple[int, int] | None) -> None:
        session = self.actions.session
        renderer, view = session.of(side)
        name = session.options.buffers[side]
        showing = SHOWINGS[name]
        preset = f"  preset {renderer.preset}" if session.options.split == "presets" else ""
        imgui.text(showing.title + preset)
        settings, options = renderer.settings, session.options
        truth = session.truths.of(session.scene, view.camera, session.size, settings.bounces)
        surface = renderer.scheduler.gatherer.surface_at(view.gbuffer) if name == "surface" else None
        found = legend(
            name,
            settings=settings,
            scene=session.scene,
            camera=view.camera,
            exposure=session.exposure,
            shadows=renderer.shadows,
            truth=truth,
            surface=surface,
        )
        _scale(found, scale)
        if showing.how in TRUTHS:
            self._tracing()
        if options.points or options.discs or options.normals:
            by = "age" if options.by_age else "radius"
            _scale(radius_legend(settings, session.scene, by, renderer.cache.count), scale)  # type: ignore[arg-type]
        value = self._value(side, name, view, cursor, truth, surface) if cursor is not None else None
        if value is not None:
            imgui.text(" ".join(f"{v:.4g}" for v in value) + f" {showing.unit if showing.unit != '1' else ''}")

    def _value(
        self,
        side: int,
        name: str,
        view: View,
        cursor: tuple[int, int],
        truth: Truth | None,
        surface: moderngl.Texture | None,
    ) -> np.ndarray | None:
        """What is under the cursor, read again where that, or what is shown, is another."""
        key = (name, *cursor, id(view), id(truth), id(surface))
        if key != self._read.get(side, ((),))[0]:
            self._read[side] = (
                key,
                (view, truth, surface),
                self.actions.session.buffer_view.value(name, view, *cursor, truth, surface),
            )
        return self._read[side][2]

    # ---- the rest --------------------------------------------------------------------------------------------------

    def record(self, found: InspectedRecord | None, scale: float) -> None:
        """The record inspected: its numbers, the pixels it serves, the hemisphere that it saw."""
        if found is None:
            return
        view = imgui.get_main_viewport()
        # below the numbers where there is room, else beside them
        width, height = self.numbers_size if self.actions.panels.hud else (0.0, 0.0)
        meets = 30.0 * scale + height + self._record_height + 2.0 * _MARGIN > view.size.y
        right = view.size.x - _MARGIN - (width + _MARGIN if meets else 0.0)
        imgui.set_next_window_pos((right, view.size.y - _MARGIN), imgui.Cond_.always, (1.0, 1.0))
        imgui.set_next_window_bg_alpha(0.8)
        imgui.begin("record", None, _PLAIN | imgui.WindowFlags_.no_inputs)
        if imgui.begin_table("numbers of the record", 2, imgui.TableFlags_.sizing_fixed_fit):
            for label, text in (*found.lines, ("serves", f"{found.served} pixels")):
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_disabled(label)
                imgui.table_next_column()
                imgui.text(text)
            imgui.end_table()
        width = 170.0 * scale
        self.backend.image(found.picture, (width, width * found.picture.height / found.picture.width))
        self._record_height = imgui.get_window_height()
        imgui.text_disabled("what it sees" + ("; held" if self.actions.session.held is not None else "; a click holds it"))
        imgui.end()

    def messages(self, scale: float) -> None:
        """Lines for the user, at the top in the middle; errors can be closed."""
        actions = self.actions
        actions.tidy()
        if not actions.messages:
            return
        view = imgui.get_main_viewport()
        imgui.set_next_window_pos((0.5 * view.size.x, 30.0 * scale), imgui.Cond_.always, (0.5, 0.0))
        imgui.set_next_window_size_constraints((0.0, 0.0), (0.9 * view.size.x, view.size.y))
        errors = [m for m in actions.messages if m.error]
        if errors:
            imgui.push_style_color(imgui.Col_.window_bg, _RED)
        imgui.begin("messages", None, _PLAIN | (0 if errors else imgui.WindowFlags_.no_inputs))
        imgui.push_text_wrap_pos(0.85 * view.size.x)
        for message in actions.messages:
            imgui.text_wrapped(message.text)
        imgui.pop_text_wrap_pos()
        if errors and imgui.small_button("close"):
            actions.messages = [m for m in actions.messages if not m.error]
        imgui.end()
        if errors:
            imgui.pop_style_color()

    def lamps(self) -> None:
        """Where the lights are, while their panel is open; the one picked is filled."""
        session = self.actions.session
        if not self.actions.panels.lights:
            return
        camera, view = session.camera, imgui.get_main_viewport()
        draw = imgui.get_background_draw_list()
        for i, lamp in enumerate(self.actions.lamps):
            if lamp.light.directional:
                continue
            x, y, z = camera.axes @ (np.asarray(lamp.light.position) - np.asarray(camera.eye))
            if z >= 0.0:
                continue
            per = view.size.y / camera.screen / -z
            place = (0.5 * view.size.x + x * per, 0.5 * view.size.y - y * per)
            colour = imgui.get_color_u32(_AMBER if lamp.on else (0.5, 0.5, 0.5, 1.0))
            draw.add_circle(place, 9.0, imgui.get_color_u32((0.0, 0.0, 0.0, 0.7)), 0, 4.0)
            draw.add_circle(place, 9.0, colour, 0, 2.0)
            if i == self.actions.lamp:
                draw.add_circle_filled(place, 5.0, colour)


def _scale(found: Legend, scale: float) -> None:
    """A colour scale with its ends, and its text."""
    if found.colours is not None:
        imgui.text(found.low)
        imgui.same_line()
        place, draw = imgui.get_cursor_screen_pos(), imgui.get_window_draw_list()
        width, height = 160.0 * scale, imgui.get_text_line_height()
        step = width / len(found.colours)
        for i, (r, g, b) in enumerate(found.colours):
            colour = imgui.get_color_u32((float(r), float(g), float(b), 1.0))
            draw.add_rect_filled((place.x + i * step, place.y), (place.x + (i + 1) * step + 0.5, place.y + height), colour)
        if found.mark is not None and 0.0 <= found.mark <= 1.0:
            x = place.x + found.mark * width
            draw.add_line((x, place.y - 2.0), (x, place.y + height + 2.0), imgui.get_color_u32((1.0, 1.0, 1.0, 1.0)), 2.0)
        imgui.dummy((width, height))
        imgui.same_line()
        imgui.text(f"{found.high} {found.unit if found.unit != '1' else ''}")
    elif found.low or found.high:
        imgui.text(f"{found.low} … {found.high} {found.unit if found.unit != '1' else ''}")
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
    imgui.text_wrapped(found.text)
    imgui.pop_style_color()
