"""A magnifier: the pixels around the cursor, each as a square of several."""

from __future__ import annotations

import moderngl

from irrsplat.app.viewer.show.screen import Programs, Region
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target

ZOOM = 8  # pixels for one, across and down
COUNT = 27  # pixels that are shown, across and down; odd, so that one is in the middle


class Magnifier(Owner):
    """Draws the pixels of a picture around the cursor, unfiltered."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.programs = Programs(ctx)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.programs,)

    def draw(self, target: Target, picture: moderngl.Texture, cursor: tuple[int, int]) -> None:
        """Draw over the target, which has the picture's size. cursor: a pixel, from the upper left corner."""
        region = place(target.size, cursor)
        self.programs("viewer/compare/magnify")(
            target,
            scissor=region,
            picture=picture,
            middle=(cursor[0], target.size[1] - 1 - cursor[1]),
            corner=region[:2],
            zoom=ZOOM,
            count=COUNT,
        )


def place(size: tuple[int, int], cursor: tuple[int, int]) -> Region:
    """Where it lies in a window of `size` pixels: around the cursor, as far as there is room. cursor: from the upper left."""
    side = ZOOM * COUNT
    wanted = cursor[0] - side // 2, size[1] - 1 - cursor[1] - side // 2
    x, y = (max(min(at, pixels - side), 0) for at, pixels in zip(wanted, size, strict=True))
    return x, y, side, side
