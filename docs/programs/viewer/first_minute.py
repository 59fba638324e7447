"""Takes the viewer's first seconds, still and while the camera orbits: docs/images/viewer/first_SCENE.png, a contact sheet each.

`python docs/programs/viewer/first_minute.py [SCENE …]` (cornell, door, atrium, furnished) opens a window in memory. Columns
are TIMES in seconds after the window opened, on this machine with its present load; the upper row is still. The furnished room
is the one of `furnished.py`.
"""

from __future__ import annotations

import math
import sys
import time

import furnished
import numpy as np
from PIL import Image, ImageDraw
from screens import IMAGES, LIMIT

import irrsplat
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.viewer import Viewer
from irrsplat.app.viewer.window import open_window

SCENES = ("cornell", "door", "atrium", "furnished")
TIMES = (0.3, 1.0, 2.0, 4.0, 8.0)  # seconds
SIZE, CELL = (960, 600), (400, 250)  # pixels
ANGLE, TURN = math.radians(8.0), 1.5  # of the orbit to either side, and radians of its phase per second


def pictures(scene: str, orbits: bool) -> list[Image.Image]:
    """Return the window at each of TIMES, or at the first frame after it."""
    wnd, found = open_window(SIZE, headless=True), list[Image.Image]()
    made = furnished.room() if scene == "furnished" else irrsplat.load(scene)
    start = last = time.monotonic()
    viewer = Viewer(wnd, made, scene, Preferences())
    camera = viewer.actions.session.free_camera
    while len(found) < len(TIMES):
        now = time.monotonic()
        if orbits:
            way = math.sin(TURN * (now - start)) - math.sin(TURN * (last - start))  # to and fro
            camera.turn(ANGLE * way, 0.0, camera.camera.target)
        viewer.frame(now - last)
        last = now
        if time.monotonic() - start >= TIMES[len(found)]:
            width, height = viewer.wnd.buffer_size
            pixels = np.frombuffer(viewer.wnd.fbo.read(components=3), "u1").reshape(height, width, 3)[::-1]
            left, top, *size = viewer._place
            picture = Image.fromarray(pixels[top : top + size[1], left : left + size[0]].copy()).resize(
                CELL, Image.Resampling.BOX
            )
            words = f"{time.monotonic() - start:.1f} s" + ", orbiting" * orbits
            ImageDraw.Draw(picture).text((8, 6), words, "white", stroke_width=2, stroke_fill="black", font_size=16)
            found.append(picture)
    viewer.release()
    wnd.destroy()
    return found


def main() -> None:
    """Take all sheets."""
    for scene in sys.argv[1:] or SCENES:
        rows = pictures(scene, orbits=False), pictures(scene, orbits=True)
        sheet = Image.new("RGB", (CELL[0] * len(TIMES), CELL[1] * len(rows)))
        for number, picture in enumerate((*rows[0], *rows[1])):
            column, row = number % len(TIMES), number // len(TIMES)
            sheet.paste(picture, (CELL[0] * column, CELL[1] * row))
        target = IMAGES / "viewer" / f"first_{scene}.png"
        dithers = Image.Dither.FLOYDSTEINBERG, Image.Dither.NONE
        for colours, dither in ((256, dithers[0]), (128, dithers[0]), (256, dithers[1]), (64, dithers[1])):
            sheet.quantize(colours, dither=dither).save(target, optimize=True)
            if target.stat().st_size <= LIMIT:
                break
        print(f"{target.name}: {target.stat().st_size // 1000} kB", flush=True)


if __name__ == "__main__":
    main()
