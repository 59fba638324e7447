"""Takes the pictures of the viewer in docs/images again: the default view, every buffer, overlays, two presets."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

import irrsplat
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.viewer import Viewer
from irrsplat.app.viewer.window import open_window
from irrsplat.scene.model import Camera
from irrsplat.settings import SettingValues, preset

IMAGES = Path(__file__).resolve().parents[2] / "images"
LARGE, SMALL = (960, 600), (400, 300)  # pixels
LIMIT = 200_000  # bytes a picture
DT = 1.0 / 30.0
PLAIN = ("alpha", "smooth_normal")  # where nothing is cut out, clear or bent by a normal map
# complete is enough: the way to 1 % takes minutes, and so few records are there that each can be seen; long ticks, since
# nobody waits for a frame
SETTINGS: SettingValues = {"viewer_quality": 0.0, "viewer_samples": 16, "budget": 1000.0}


def settled(viewer: Viewer) -> None:
    """Frames until nothing changes any more."""
    for _ in range(3000):
        viewer.frame(DT)
        if viewer.still:
            break


def drawn(viewer: Viewer) -> None:
    """A few frames more, messages gone."""
    viewer.actions.messages.lines.clear()
    for _ in range(3):  # windows take their size from the frame before
        viewer.frame(DT)


def keep(viewer: Viewer, name: str, settle: bool = True) -> None:
    """Store what the window shows as docs/images/`name`.png, with fewer colours where it would be over the limit. settle: once
    nothing changes any more."""
    if settle:
        settled(viewer)
    drawn(viewer)
    width, height = viewer.wnd.buffer_size
    pixels = np.frombuffer(viewer.wnd.fbo.read(components=3), "u1").reshape(height, width, 3)[::-1]
    target, picture = IMAGES / f"{name}.png", Image.fromarray(pixels.copy())
    picture.save(target, optimize=True)
    for colours in (256, 128, 64):
        if target.stat().st_size > LIMIT:
            picture.quantize(colours, dither=Image.Dither.FLOYDSTEINBERG).save(target, optimize=True)
    assert target.stat().st_size <= LIMIT, f"{target} has {target.stat().st_size} bytes"
    print(f"{target.name}: {target.stat().st_size // 1000} kB, after {time.process_time():.0f} s of processor time", flush=True)


def show(scene: str, size: tuple[int, int], take: Callable[[Viewer], None], camera: Camera | None = None) -> None:
    """Open a window in memory on a bundled scene, and take pictures of it."""
    wnd = open_window(size, headless=True)
    viewer = Viewer(wnd, irrsplat.load(scene), scene, Preferences(), camera, values=SETTINGS)
    take(viewer)
    viewer.release()
    wnd.destroy()


def whole(viewer: Viewer) -> None:
    """The window as it opens, records over it, and two presets."""
    actions, options = viewer.actions, viewer.actions.session.options
    settled(viewer)
    actions.session.change(0, **{name: getattr(preset("default"), name) for name in SETTINGS})  # as it opens
    for _ in range(12):  # until the times of ticks are those of its own budget
        viewer.frame(DT)
    keep(viewer, "viewer/window", settle=False)
    actions.session.change(0, **SETTINGS)
    actions.session.options.controls = False
    options.buffer, options.discs, options.inspect = "irradiance", True, True
    viewer.controls.mouse = (0.36 * LARGE[0], 0.3 * LARGE[1])
    viewer.backend.mouse_position(*viewer.controls.mouse)
    keep(viewer, "viewer/records")
    options.discs = options.inspect = False
    viewer.controls.mouse_moved(-1, -1, 0, 0)
    actions.session.split(True)
    keep(viewer, "viewer/split_presets")


def buffers(viewer: Viewer) -> None:
    """Every buffer, by itself with its legend; but for those that need a path tracer, or show nothing of this scene."""
    actions = viewer.actions
    actions.session.options.controls = False
    settled(viewer)
    for name in (name for name in BUFFERS if name not in ("reference", "error", *PLAIN)):
        if name == "requests":  # some pixels must still request records
            actions.clear()
            while not (actions.session.progress and 0.5 < actions.session.progress[0].coverage < 1.0):
                actions.session.tick(DT, 0.01)
            actions.toggle("frozen")
        if name != "emission":
            actions.session.options.buffer = name
            keep(viewer, f"viewer/{name}" if name == "light" else f"buffers/{name}")  # a folder has no more than 14 entries
        if name == "requests":
            actions.toggle("frozen")


def sky(viewer: Viewer) -> None:
    """Show emitted light alone: in this scene, the sky."""
    actions = viewer.actions
    actions.session.change(0, bounces=0)
    actions.session.options.controls = False
    actions.session.options.buffer = "emission"
    keep(viewer, "buffers/emission")


def main() -> None:
    """Take them all."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["IRRSPLAT_CONFIG"] = folder  # nobody's settings
        show("cornell", LARGE, whole)
        show("curved", SMALL, buffers)
        show("atrium", SMALL, sky)


if __name__ == "__main__":
    main()
