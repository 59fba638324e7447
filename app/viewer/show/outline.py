"""The line around the picked object: all of its silhouette, where other things hide it, too."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import ViewSource
from irrsplat.app.viewer.editing.picking import triangles_of
from irrsplat.core.memo import Memo
from irrsplat.gpu.program import Draw, DrawState, Program
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target
from irrsplat.scene.model import Camera, Mesh

_WIDTH = 2.0  # of the line, window coordinates; as wide a dark seam lies around it
_NEAR, _FAR = 1e-3, 1e3  # metres; depth is clamped, so that they clip nothing


class Outline(Owner):
    """Draws it over a picture: a bright line with a dark seam, so that it shows on anything."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.line = Program(ctx, "viewer/outline/line", "lib/fullscreen")
        self._made, self._memo = Workshop(), Memo()

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.line, self._made)

    def forget(self) -> None:
        self._made.clear()
        self._memo.forget()

    def __call__(self, target: Target, source: ViewSource, mesh: int, density: float) -> None:
        """Draw the line around a mesh of the source's scene. density: pixels per window coordinate."""
        scene, camera, size = source.scene, source.view.camera, target.size
        if mesh >= len(scene.meshes) or scene.meshes[mesh].is_point:
            return
        texture = self._made.get("silhouette", size, lambda: self.ctx.texture(size, 1))
        geometry = source.renderer.world.geometry  # a program keeps what it has drawn of one
        program = self._made.get("program", geometry, lambda: Program(self.ctx, "viewer/outline/silhouette", "image/gbuffer"))
        mask = self._made.get("mask", texture, lambda: Target(self.ctx, size, textures=[texture]))

        def fill() -> moderngl.Texture:
            mask.use()
            mask.gl.clear()
            first, count = triangles_of(scene, mesh)
            clip = camera.clip_from_view(size[0] / size[1], _NEAR, _FAR) @ camera.view_from_world
            part, state = Draw(3 * first, 3 * count, {}), DrawState(depth_clamp=True)
            program(mask, geometry=geometry, draws=[part], state=state, clip_from_world=clip)
            return texture

        found = self._memo.get("silhouette", (texture, geometry, camera, scene.meshes, mesh), fill)
        width = max(round(_WIDTH * density), 1)
        box = _box(scene.meshes[mesh], camera, size, 2 * width + 1)
        self.line(target, state=DrawState(blend="over"), scissor=box, silhouette=found, width=width)


def _box(mesh: Mesh, camera: Camera, size: tuple[int, int], margin: int) -> tuple[int, int, int, int]:
    """The part of the picture that a mesh may take, with a margin: x, y, width, height in pixels from the lower left corner."""
    low, high = mesh.positions.min(0).astype(float), mesh.positions.max(0).astype(float)
    corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
    place = (corners - camera.eye) @ camera.axes.T
    if (place[:, 2] > -_NEAR).any():
        return (0, 0, *size)
    at = np.asarray(size) / 2.0 + place[:, :2] / -place[:, 2:] * size[1] / camera.screen
    start = np.clip(np.floor(at.min(0)) - margin, 0, size).astype(int)
    end = np.clip(np.ceil(at.max(0)) + margin, 0, size).astype(int)
    return int(start[0]), int(start[1]), int(end[0] - start[0]), int(end[1] - start[1])
