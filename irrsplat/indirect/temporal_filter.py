"""Temporal accumulation with reprojection: changes of the records appear over several pictures, and not at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, SplatBuffer, Uniforms
from irrsplat.core.timing.input_waits import stop_for_input
from irrsplat.gpu.program import Program, SampledTexture
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, bands
from irrsplat.scene.model import Camera

SHARE = 0.2  # of a picture's irradiance that follows the records at once, while they or the view change
CHANGING = 0.8  # the same share after lights, meshes or the surface cache have changed: the last picture no longer holds
PICTURES = 8  # after the last change, over which all of it follows


@dataclass(frozen=True)
class _Shown:
    """The last picture.

    target: its irradiance, and facing_of its normals. subject: all its inputs. scene: objects that differ after a change of the
    scene. left: number of pictures until accumulation has converged.
    """

    target: Target
    camera: Camera
    subject: object
    scene: tuple[object, ...]
    left: int


class TemporalFilter(Owner):
    """Filter that blends the irradiance of a picture of `size` (width, height) with that of the last picture at equal
    positions."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.ctx, self.size = ctx, size
        self.program = self.own(Program(ctx, "indirect/temporal", "lib/fullscreen"))
        self.linear = self.own(ctx.sampler(repeat_x=False, repeat_y=False, filter=(moderngl.LINEAR, moderngl.LINEAR)))
        self.nothing = self.own(Target(ctx, (3, 3), (4, 1)))  # read instead of a last picture: one program for all
        self._targets = self.own(Workshop())  # two of each size
        self._shown: _Shown | None = None

    def forget(self) -> None:
        """Show the records' sums alone in the next picture."""
        self._shown = None

    def left(self, subject: object) -> int:
        """Return the number of pictures after the next one until accumulation has converged. subject: all their inputs."""
        shown = self._shown
        if shown is None:
            return 0
        return PICTURES if shown.subject != subject else max(shown.left - 1, 0)

    def __call__(
        self,
        splats: SplatBuffer,
        gbuffer: GBuffer,
        camera: Camera,
        subject: object,
        scene: tuple[object, ...],
        filling: bool = False,
        provisional: bool = False,
    ) -> SplatBuffer:
        """Return the sums of the next picture: `splats` after convergence, else (w·E, w) of w = 1/depth in textures of this pass.

        scene: objects, one of which differs after a change of lights, meshes or the surface cache. filling: True if pixels
        without irradiance keep the last picture's. provisional: True for irradiance that is far better than the last picture.
        Raises InputWaits between two parts of the picture.
        """
        shown, left = self._shown, self.left(subject)
        changed = shown is not None and any(a is not b for a, b in zip(shown.scene, scene, strict=True))
        now, share = self._target(splats.sums.size, shown), CHANGING if changed or provisional else SHARE
        if shown is None or shown.subject == subject:
            share = 1.0 / (left + 1)
        stride = splats.pixel_stride
        before = self._before(shown or _Shown(self.nothing, camera, None, (), 0))
        for band in bands(now.size):
            self.program(
                now,
                scissor=band,
                **gbuffer.surface_uniforms,
                sums=splats.sums,
                pixel_stride=stride,
                **before,
                accumulating=shown is not None,
                kept=filling and not changed,
                share=share,
            )
            stop_for_input(self.ctx)  # the last picture stays in the other target
        self._shown = _Shown(now, camera, subject, scene, left)
        return replace(splats, sums=now.textures[0]) if left or filling else splats

    def _target(self, size: tuple[int, int], shown: _Shown | None) -> Target:
        """Return a target for the next picture's irradiance, without the last picture's."""

        def target(number: int) -> Target:
            return self._targets.get(f"{size} {number}", (), lambda: Target(self.ctx, size, (4, 1)))

        return target(1) if shown is not None and shown.target is target(0) else target(0)

    def _before(self, shown: _Shown) -> Uniforms:
        """Return the uniforms of the last picture."""
        camera, (width, height), texels = shown.camera, self.size, np.array(shown.target.size)
        stride = -(-width // shown.target.size[0])
        irradiance, facing = (SampledTexture(texture, self.linear) for texture in shown.target.textures)
        # the texel of pixel x is x/stride: its centre is at x/stride + 1/2, and x + 1/2 = width·(clip + 1)/2
        scale = 0.5 * np.array(self.size) / stride / texels
        offset = scale + (0.5 - 0.5 / stride) / texels
        return {
            "shown": irradiance,
            "shown_facing": facing,
            "clip_from_world": camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
            "shown_place": (*scale.tolist(), *offset.tolist()),
        }
