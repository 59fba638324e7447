"""Pictures that are kept while the window is open, to be compared with what it shows later."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl

from irrsplat.gpu.resource import Owner, Resource
from irrsplat.image.view import View

MOST = 8  # that are kept at once


@dataclass(frozen=True, eq=False)
class Snapshot(Owner):
    """A picture by its name. view: of which the picture, its alpha and the g-buffer's positions are its own; the rest is gone."""

    name: str
    view: View

    @staticmethod
    def of(view: View, name: str) -> Snapshot:
        """A copy of what a view shows now."""
        image, alpha, position = map(_copy, (view.image, view.alpha, view.gbuffer.position))
        gbuffer = replace(view.gbuffer, position=position, filters=None)
        return Snapshot(name, replace(view, image=image, alpha=alpha, gbuffer=gbuffer, indirect=None, emission=None))

    def owned(self) -> tuple[Resource, ...]:
        """What this frees."""
        return (self.view.image, self.view.alpha, self.view.gbuffer.position)


def _copy(texture: moderngl.Texture) -> moderngl.Texture:
    made = texture.ctx.texture(texture.size, texture.components, texture.read(), dtype=texture.dtype)
    made.filter = texture.filter
    made.repeat_x = made.repeat_y = False
    return made
