"""Whether the camera has lost the scene: it is well outside, and sees nothing of it, or only backs."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Identity, ViewSource
from irrsplat.core.memo import Memo
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, pixels
from irrsplat.scene.model import Camera, Scene

_GRID = (64, 64)  # places in the view that are looked at: what covers less than one is lost as well
_MARGIN = 0.1  # scene diagonals beyond its bounds that still count as at the scene


class Whereabouts(Owner):
    """Looks at what a view sees; nothing is drawn for a camera in the scene, and once for each g-buffer of one outside.

    Which side of the triangles is to be seen, files do not say reliably: it is the one that the first camera sees more of.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.program = Program(ctx, "viewer/sides", "lib/fullscreen")
        self.target = Target(ctx, _GRID, (1,))
        self._memo = Memo()
        self._world: object = None  # whose triangles `_shown` is about
        self._shown = 0.0  # the side of its triangles that is to be seen: 1 front, 2 back, 0 not known

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.target)

    def forget(self) -> None:
        """Know nothing of what was looked at."""
        self._world, self._shown = None, 0.0
        self._memo.forget()

    def lost(self, source: ViewSource, is_first: bool) -> bool:
        """Whether the camera of the source's view is outside of the scene and sees nothing of it, or only its other side.

        is_first: whether it is the scene's first camera, which never has lost it.
        """
        view, scene = source.view, source.scene
        if self._world is not source.renderer.world:
            self._world, self._shown = source.renderer.world, 0.0
        if is_first and not self._shown:
            sides = self._sides(source)
            self._shown = 2.0 if (sides == 2.0).sum() > (sides == 1.0).sum() else 1.0
        if is_first or not scene.triangles or not outside(view.camera, scene):
            return False
        sides = self._memo.get("sides", Identity(view.gbuffer), lambda: self._sides(source))
        return not (sides == self._shown if self._shown else sides > 0.0).any()

    def _sides(self, source: ViewSource) -> np.ndarray:
        """(64, 64, 1) what is seen: 0 nothing, 1 a front, 2 a back."""
        gbuffer, camera = source.view.gbuffer, source.view.camera
        planes = source.renderer.world.geometry.uniforms
        self.program(
            self.target, position=gbuffer.position, emission=gbuffer.emission, eye=tuple(camera.eye), grid=_GRID, **planes
        )
        return pixels(self.target.textures[0])


def outside(camera: Camera, scene: Scene) -> bool:
    """Whether the eye is well outside of the scene's bounds."""
    low, high = scene.bounds
    eye = np.asarray(camera.eye, float)
    return float(np.linalg.norm(eye - np.clip(eye, low, high))) > _MARGIN * scene.diagonal
