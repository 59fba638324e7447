"""A host's window: irrsplat draws into the OpenGL context of moderngl-window, which draws on top of it.

python docs/programs/in_moderngl_window.py
"""

from __future__ import annotations

import dataclasses
import math

import moderngl_window

import irrsplat


class Host(moderngl_window.WindowConfig):  # type: ignore[misc]  # its base is untyped
    """Turns about the Cornell box; the picture refines while it turns."""

    gl_version = (3, 3)
    title = "irrsplat in a host's window"
    window_size = (480, 480)
    aspect_ratio = None

    def __init__(self, **arguments: object) -> None:
        super().__init__(**arguments)
        scene = irrsplat.load("cornell")
        self.camera = scene.camera()
        self.renderer = irrsplat.Renderer(scene, self.wnd.buffer_size, "preview", ctx=self.ctx)

    def on_render(self, time: float, frame_time: float) -> None:
        """A tick: 30 ms of work at most, into the window's framebuffer."""
        x, y, z = self.camera.eye
        camera = dataclasses.replace(self.camera, eye=(x + 0.4 * math.sin(time), y, z))
        view, progress = self.renderer.frame(camera, seconds=0.03)
        self.renderer.show(view, self.wnd.fbo)
        self.wnd.title = f"{self.title}: {progress.records} records, {progress.coverage:.0%}"
        self.ctx.enable_only(self.ctx.NOTHING)  # what the host draws now states its own blending and depth test

    def on_resize(self, width: int, height: int) -> None:
        """The renderer follows the window; its records stay."""
        if width and height:
            self.renderer.resize(self.wnd.buffer_size)

    def on_close(self) -> None:
        """While the context is still there."""
        self.renderer.release()


if __name__ == "__main__":
    moderngl_window.run_window_config(Host)
