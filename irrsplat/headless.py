"""One call for one picture: a view of a scene without a window."""

from __future__ import annotations

from typing import Any

from irrsplat.output import Frame
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Scene


def render(
    scene: Scene, size: tuple[int, int] = (800, 800), camera: Camera | str | None = None, preset: str = "default", **settings: Any
) -> Frame:
    """One view of `scene`, headless, refined until every pixel is served; arguments and errors as `Renderer`."""
    with Renderer(scene, size, preset, **settings) as renderer:
        return renderer.render(camera)
