"""The brightest light in a view."""

from __future__ import annotations

from weakref import ref

import moderngl
import numpy as np

from irrsplat.core.color import LUMINANCE
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.image.view import View
from irrsplat.meter.light_scale import PERCENTILE
from irrsplat.renderer import Renderer

_LATTICE = (96, 60)  # pixels that are looked at for the brightest


class BrightestLight(Owner):
    """Finds how bright the light in views is, of which false colours by themselves take their upper end."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.program, self.target = Program(ctx, "viewer/light_level", "lib/fullscreen"), Target(ctx, _LATTICE, (4,))
        self.found = 0.0  # W/m², weighted as luminance is
        self._view: ref[View] | None = None  # weak: it knows its scene, which may no longer be open

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.program, self.target)

    def look(self, renderer: Renderer, view: View) -> None:
        """Look at the view, where that is another one than before."""
        if self._view is not None and view is self._view():
            return
        self.program(
            self.target,
            position=view.gbuffer.position,
            sums=view.sums,
            direct=renderer.direct_irradiance(view),
            weights=LUMINANCE,
            lattice=_LATTICE,
        )
        light, seen = self.target.read()[..., :2].reshape(-1, 2).T
        self.found = float(np.percentile(light[seen > 0.0], PERCENTILE)) if seen.any() else 0.0
        self._view = ref(view)
