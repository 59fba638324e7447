"""Writes ten-tasks.md and its pictures: common tasks in the viewer, by real keys and mouse in a real window.

It needs a virtual display: `apt-get install xvfb xdotool`. It finds the things to click by their labels.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from imgui_bundle import imgui
from PIL import Image

import irrsplat
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.viewer import Viewer
from irrsplat.app.viewer.window import open_window

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tests.app.viewer.interface import x_drop  # noqa: E402

HERE = Path(__file__).resolve().parents[1]
IMAGES = HERE.parent / "images" / "walk"
SIZE = (1000, 640)
LIMIT = 200_000  # bytes a picture
PATIENCE = 900.0  # seconds: a limit of safety
SAMPLES = 256  # of a pixel of the reference on show
LABELLED = (
    *("begin_menu", "menu_item", "button", "small_button", "checkbox", "combo", "begin_combo", "selectable", "radio_button"),
    *("slider_float", "slider_int", "drag_float3", "drag_float", "drag_int", "color_edit3", "input_text", "collapsing_header"),
)
TASKS: list[tuple[str, Callable[[Walker], None]]] = []
PAGE = """# Tasks in the viewer

The number in each heading counts the actions: keys, clicks, drags and typed texts. Some tasks start from the state that the
task before leaves. `python docs/programs/viewer/walk.py` performs all tasks by xdotool in a window of {width}×{height} pixels
on a virtual display, checks their results, and writes this page.

{rows}
"""


def task(title: str) -> Callable[[Callable[[Walker], None]], Callable[[Walker], None]]:
    """Add a task to the walk."""

    def add(do: Callable[[Walker], None]) -> Callable[[Walker], None]:
        TASKS.append((title, do))
        return do

    return add


@dataclass
class Labels:
    """Where the widgets of the last frame are: label → (left, top, right, bottom), window coordinates."""

    now: dict[str, tuple[float, float, float, float]]

    def follow(self) -> None:
        """From now on, note where imgui puts every widget that has a label."""
        for name in LABELLED:
            setattr(imgui, name, self._watched(getattr(imgui, name), name in ("begin_menu", "begin_combo")))

    def _watched(self, make: Callable[..., Any], opens: bool) -> Callable[..., Any]:
        def widget(label: str, *args: Any, **options: Any) -> Any:
            result = make(label, *args, **options)
            if not (opens and result):  # then the last item is another window's
                low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
                self.now[label.split("##")[0]] = (low.x, low.y, high.x, high.y)
            return result

        return widget


class Walker:
    """A person at the viewer. done: what was done so far, in the words of the page. kept: the name of the last picture."""

    def __init__(self, viewer: Viewer, labels: Labels) -> None:
        self.viewer, self.labels, self.done = viewer, labels, list[str]()
        self.kept = ""

    # ---- time ------------------------------------------------------------------------------------------------------

    @property
    def window(self) -> int:
        """The number of its X window."""
        import glfw

        return int(glfw.get_x11_window(self.viewer.wnd._window))

    def wait(self, frames: int = 4) -> None:
        """So many frames go by, as in the viewer's own loop."""
        for _ in range(frames):
            self.labels.now.clear()
            self.viewer.frame(1.0 / 30.0)
            self.viewer.wnd.swap_buffers()

    def until(self, true: Callable[[], object], what: str) -> None:
        """Frames go by until something is `true`."""
        end = time.monotonic() + PATIENCE
        while not true():
            assert time.monotonic() < end, f"{what}: not within {PATIENCE:g} s"
            self.wait(1)

    def rest(self) -> None:
        """Frames go by until the picture is done; nobody waits for its finest touches."""
        session = self.viewer.actions.session
        self.until(lambda: session.progress and all(p.still or p.error is not None for p in session.progress), "a picture")
        self.wait(3)

    # ---- hands -----------------------------------------------------------------------------------------------------

    def _hand(self, *words: object, frames: int = 3) -> None:
        subprocess.run(["xdotool", *map(str, words)], check=True, capture_output=True)
        self.wait(frames)

    def key(self, *keys: str) -> None:
        """Press keys; each is an action."""
        for name in keys:
            self.done.append(f"`{name.title() if '+' in name or len(name) == 1 or name.islower() else name}`")
            self._hand("key", name)

    def hold(self, key: str, seconds: float) -> None:
        """Hold a key down: one action."""
        self.done.append(f"hold `{key.upper()}`")
        self._hand("keydown", key)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.wait(1)
        self._hand("keyup", key)

    def type(self, text: str) -> None:
        """Type a text: one action."""
        self.done.append(f"type `{text}`")
        self._hand("type", "--delay", "60", text)

    def place(self, label: str) -> tuple[float, float]:
        """The middle of what is labelled so, once it is there."""
        self.wait(2)
        self.until(lambda: label in self.labels.now, f"no {label!r} among {sorted(self.labels.now)}")
        x0, y0, x1, y1 = self.labels.now[label]
        return 0.5 * (x0 + x1), 0.5 * (y0 + y1)

    def click(self, *labels: str) -> None:
        """Click on one labelled thing after the other."""
        for label in labels:
            self.done.append(f"*{label}*")
            self._click(self.place(label))

    def click_at(self, point: tuple[float, float, float], words: str) -> None:
        """Click on a point of the scene."""
        self.done.append(f"click on {words}")
        self._click(self.seen(point))

    def _click(self, at: tuple[float, float]) -> None:
        self._hand("mousemove", round(at[0]), round(at[1]))
        self._hand("mousedown", 1)
        self._hand("mouseup", 1, frames=5)

    def drag(self, start: tuple[float, float], end: tuple[float, float], words: str, button: int = 1) -> None:
        """Drag with a mouse button: one action."""
        self.done.append(words)
        self._hand("mousemove", round(start[0]), round(start[1]))
        self._hand("mousedown", button)
        for i in range(1, 9):
            x, y = (a + (b - a) * i / 8 for a, b in zip(start, end, strict=True))
            self._hand("mousemove", round(x), round(y), frames=2)
        self._hand("mouseup", button)

    def point_at(self, point: tuple[float, float, float], words: str) -> None:
        """Bring the mouse over a point of the scene."""
        self.done.append(f"point at {words}")
        x, y = self.seen(point)
        self._hand("mousemove", round(x), round(y))

    def seen(self, point: tuple[float, float, float]) -> tuple[float, float]:
        """Where in the window a point of the scene is."""
        found = self.viewer.interface.layout.seen(self.viewer.actions.session.camera, point)
        assert found is not None, f"{point} is not in view"
        return found

    # ---- what is left of it ----------------------------------------------------------------------------------------

    def keep(self, name: str) -> None:
        """Store what the window shows as docs/images/walk/`name`.png."""
        self.wait(2)
        width, height = self.viewer.wnd.buffer_size
        pixels = np.frombuffer(self.viewer.wnd.fbo.read(components=3), "u1").reshape(height, width, 3)[::-1]
        target, picture = IMAGES / f"{name}.png", Image.fromarray(pixels.copy())
        picture.save(target, optimize=True)
        for colours in (256, 128, 64):
            if target.stat().st_size > LIMIT:
                picture.quantize(colours, dither=Image.Dither.FLOYDSTEINBERG).save(target, optimize=True)
        if target.stat().st_size > LIMIT:  # noise does not pack
            picture.resize((3 * width // 4, 3 * height // 4), Image.Resampling.BOX).quantize(64).save(target, optimize=True)
        assert target.stat().st_size <= LIMIT, f"{target} has {target.stat().st_size} bytes"
        self.kept = name


@task("Open another scene")
def open_scene(walker: Walker) -> None:
    walker.key("ctrl+o")
    walker.type("door")
    walker.key("Return")
    walker.until(lambda: walker.viewer.actions.source == "door", "the scene")
    walker.rest()


@task("Fly through it")
def fly(walker: Walker) -> None:
    walker.click("File", "cornell")
    walker.until(lambda: walker.viewer.actions.source == "cornell", "the scene")
    before = walker.viewer.actions.session.camera
    walker.hold("w", 0.8)
    x, y = 0.7 * SIZE[0], 0.5 * SIZE[1]
    walker.drag((x, y), (x + 60.0, y + 20.0), "drag with the right button", button=3)
    assert walker.viewer.actions.session.camera != before
    walker.key("Home")
    walker.rest()
    assert walker.viewer.actions.session.camera == before


@task("Find the cause of a dark corner")
def dark_corner(walker: Walker) -> None:
    walker.key("ctrl+d")
    walker.click_at((2.78, 0.02, 1.0), "the floor before the short box")
    walker.rest()
    assert walker.viewer.actions.session.options.surface is not None


@task("Change the colour of a wall and undo it")
def repaint(walker: Walker) -> None:
    walker.key("ctrl+d")
    walker.click_at((0.0, 3.5, 2.8), "the wall")
    editor = walker.viewer.actions.editor
    assert editor.mesh is not None
    x0, y0, _, y1 = walker.labels.now["reflectance"]
    walker.drag((x0 + 20.0, 0.5 * (y0 + y1)), (x0 + 90.0, 0.5 * (y0 + y1)), "drag its red")
    walker.rest()
    walker.keep("repaint")
    assert walker.viewer.actions.editor.past
    walker.key("ctrl+z")
    walker.rest()


@task("Dim a light and make it warmer")
def dim(walker: Walker) -> None:
    walker.key("F4")
    walker.click(next(label for label in walker.labels.now if "(" in label and ")" in label))
    x, y = walker.place("lumen")
    walker.drag((x - 40.0, y), (x - 55.0, y), "drag *lumen*")
    x, y = walker.place("kelvin")
    walker.drag((x - 20.0, y), (x - 60.0, y), "drag *kelvin*")
    walker.rest()


@task("Move a light")
def move(walker: Walker) -> None:
    (lamp,) = walker.viewer.actions.editor.scene.lights
    before = lamp.position
    x, y = walker.seen(before)
    walker.drag((x - 60.0, y), (x - 130.0, y), "drag its red arrow")
    walker.rest()
    assert walker.viewer.actions.editor.scene.lights[0].position != before


@task("Measure illuminance along a line")
def measure(walker: Walker) -> None:
    walker.key("F4")
    walker.click("buffer", "light (false colours)")
    walker.key("ctrl+l")
    walker.drag(walker.seen((2.4, 0.0, 0.5)), walker.seen((0.3, 0.0, 0.5)), "drag a line over the floor")
    walker.rest()
    assert walker.viewer.display.profile(0) is not None


@task("Compare with the published method")
def compare(walker: Walker) -> None:
    walker.key("ctrl+l", "1", "Tab", "space")
    session = walker.viewer.actions.session
    assert session.options.divider == 0.0, "the right side alone"
    walker.until(lambda: len(session.progress) == 2 and all(p.coverage > 0.7 for p in session.progress), "both presets")


@task("Compare with the reference")
def truth(walker: Walker) -> None:
    walker.key("Tab", "y")
    session = walker.viewer.actions.session
    walker.until(lambda: session.tracing.traced is not None, "the path tracer")
    walker.click("buffer", "error")
    walker.until(lambda: session.tracing.shown and session.tracing.shown.estimate.samples >= SAMPLES, "a reference")
    walker.wait(3)
    walker.keep("truth")
    walker.key("y")
    assert session.tracing.traced is None and session.options.buffer == "error"


@task("Save the edited scene")
def save(walker: Walker) -> None:
    walker.key("1", "ctrl+s")
    walker.wait(3)
    walker.key("Return")  # takes the proposed name
    walker.wait(3)
    assert list(Path().glob("*.scene")), walker.viewer.actions.messages.lines


@task("Find a command by name")
def palette(walker: Walker) -> None:
    walker.key("ctrl+p")
    walker.type("record discs")
    walker.wait(3)
    walker.keep("palette")
    walker.key("Return")
    walker.wait(3)
    assert walker.viewer.actions.session.options.discs


@task("Open a file by drag and drop")
def drop(walker: Walker) -> None:
    walker.key("x")
    walker.done.clear()
    walker.done.append("drag `door.scene` onto the window")
    source, scene = x_drop.DropSource(walker.window), next((ROOT / "scenes").rglob("door.scene"))
    hand = Thread(target=source.drop, args=([scene], (SIZE[0] // 2, SIZE[1] // 2)))
    hand.start()
    walker.until(lambda: not hand.is_alive() and walker.viewer.actions.source == str(scene), "the scene")
    source.close()
    walker.rest()


@task("Measure illuminance at desk height")
def plane(walker: Walker) -> None:
    walker.key("ctrl+m")
    session = walker.viewer.actions.session
    walker.until(lambda: session.plane.share is None, "a measured plane")
    walker.rest()


@task("Save a film")
def film(walker: Walker) -> None:
    walker.viewer.actions.toggle("plane")
    walker.key("r")
    walker.hold("w", 0.8)
    walker.key("r")
    walker.click("File", "Save film")
    walker.until(lambda: "frame 0" not in walker.viewer.actions.film.progress, "the first frames")
    walker.wait(3)
    walker.keep("film")
    walker.viewer.actions.cancel_film()  # its frames take minutes on two cores; tests/app/film makes a whole one


def in_words(count: int) -> str:
    """So many actions."""
    return f"{count} action{'s' * (count != 1)}"


def main() -> None:
    """Walk, and write the page."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as folder, x_drop.display(SIZE):
        os.environ |= {"IRRSPLAT_CONFIG": folder, "XDG_PICTURES_DIR": folder, "XDG_VIDEOS_DIR": folder}
        os.chdir(folder)
        labels = Labels({})
        labels.follow()
        wnd = open_window(SIZE)
        wnd.position = (0, 0)
        viewer = Viewer(wnd, irrsplat.load("cornell"), "cornell", Preferences())
        viewer.actions.dialog.native = False  # the desktop's dialogs differ from one desktop to the next
        walker = Walker(viewer, labels)
        walker.rest()
        for number, (title, do) in enumerate(TASKS, start=1):
            walker.done.clear()
            do(walker)
            if walker.kept != do.__name__:
                walker.keep(do.__name__)
            count, how = len(walker.done), ", ".join(walker.done)
            rows.append(f"## {number}. {title}: {in_words(count)}\n\n{how}\n\n![{title}](../images/walk/{do.__name__}.png)\n")
            print(f"{number}. {title}: {in_words(count)}", flush=True)
        viewer.release()
        wnd.destroy()
    width, height = SIZE
    page = PAGE.format(width=width, height=height, rows="\n".join(rows).rstrip())
    (HERE.parent / "how-to" / "ten-tasks.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
