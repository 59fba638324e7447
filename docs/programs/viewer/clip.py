"""Makes the README's clip of the viewer in use: docs/images/viewer/clip.gif. What a hand does is done by calls, step by step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from PIL import Image
from screens import DT, IMAGES

import irrsplat
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.viewer import Viewer
from irrsplat.app.viewer.window import open_window

SIZE, SMALL = (900, 560), (560, 348)  # pixels: of the window, and of the clip
COLOURS, MS = 224, 250  # of the clip's palette, and milliseconds a picture
LIMIT = 1_000_000  # bytes
FRAMES = 4  # of the viewer for each picture


class Clip:
    """The pictures so far."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer, self.pictures = viewer, list[Image.Image]()

    def take(self, count: int, step: Callable[[float], object] = lambda share: None, frames: int = FRAMES) -> None:
        """Take `count` pictures; before each, call `step` with the share of the way, and draw so many frames."""
        for number in range(count):
            step((number + 1) / count)
            for _ in range(frames):
                self.viewer.frame(DT)
            width, height = self.viewer.wnd.buffer_size
            pixels = np.frombuffer(self.viewer.wnd.fbo.read(components=3), "u1").reshape(height, width, 3)[::-1]
            self.pictures.append(Image.fromarray(pixels.copy()).resize(SMALL, Image.Resampling.LANCZOS))

    def save(self) -> None:
        """Write the clip with one palette for all pictures, so that what rests costs nothing."""
        target, rows = IMAGES / "viewer" / "clip.gif", Image.new("RGB", (SMALL[0], SMALL[1] * len(self.pictures)))
        for number, picture in enumerate(self.pictures):
            rows.paste(picture, (0, SMALL[1] * number))
        palette = rows.quantize(COLOURS, Image.Quantize.MEDIANCUT)
        plain = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in self.pictures]
        plain[0].save(target, save_all=True, append_images=plain[1:], duration=MS, loop=0, optimize=True)
        assert target.stat().st_size <= LIMIT, f"{target} has {target.stat().st_size} bytes"
        print(f"{target.name}: {target.stat().st_size // 1000} kB, {len(plain)} pictures")


def walk(clip: Clip) -> None:
    """Open the box, look around, see its records and its light, move the lamp, and measure a plane."""
    actions = clip.viewer.actions
    session, camera = actions.session, actions.session.free_camera
    clip.take(5, frames=2)
    clip.take(3, frames=16)
    for way in (1.0, -1.0):
        clip.take(4, lambda share: camera.turn(0.06 * way, 0.015 * way, camera.camera.target))  # noqa: B023
    clip.take(2, frames=12)
    actions.toggle("discs")
    clip.take(3)
    actions.toggle("discs")
    actions.show("irradiance")
    clip.take(3)
    actions.show("image")
    actions.session.options.lights, lamp = True, actions.editor.scene.lights[0]
    clip.take(2)
    x, y, z = lamp.position

    def move(share: float) -> None:
        actions.editor.set_light(0, replace(lamp, position=(x - 1.6 * share, y - 0.8 * share, z)))

    clip.take(6, move)
    clip.take(3, frames=20)
    actions.session.options.lights = False
    actions.show("light")
    clip.take(4, frames=12)
    actions.show("image")
    actions.toggle("plane")
    while session.plane.share is not None:
        clip.viewer.frame(DT)
    actions.messages.lines = []
    clip.take(5)


def main() -> None:
    """Make it."""
    wnd = open_window(SIZE, headless=True)
    viewer = Viewer(wnd, irrsplat.load("cornell"), "cornell", Preferences())
    clip = Clip(viewer)
    walk(clip)
    viewer.release()
    wnd.destroy()
    clip.save()


if __name__ == "__main__":
    main()
