"""Two sides in one picture: the difference of their numbers."""

from __future__ import annotations

import numpy as np

from irrsplat.app.viewer.buffers.reference import NO_REFERENCE
from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Legend, Values, colour_map
from irrsplat.app.viewer.buffers.table import BUFFERS, BufferView
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.show.screen import clear
from irrsplat.gpu.target import Target


class Comparison:
    """Draws what the two sides of a session differ by, with a legend, and the difference at a pixel."""

    def __init__(self, session: Session, buffer_view: BufferView) -> None:
        self.session, self.buffer_view = session, buffer_view

    def draw(self, target: Target) -> None:
        left, right = (self.session.source(side) for side in (0, 1))
        a, b = self._values()
        if a is None or b is None:
            return clear(target, GROUND)
        self.buffer_view.programs("viewer/compare/difference")(
            target,
            colours=self.buffer_view.colours,
            left_values=a.texture,
            right_values=b.texture,
            left_albedo=a.albedo or a.texture,
            right_albedo=b.albedo or b.texture,
            left_position=left.view.gbuffer.position,
            right_position=right.view.gbuffer.position,
            left_form=a.form,
            right_form=b.form,
            everywhere=a.everywhere and b.everywhere,
            full=a.full,
            ground=GROUND,
            size=target.size,
        )

    def legend(self) -> Legend:
        session = self.session
        if any(BUFFERS[session.buffer(side)].needs_reference and session.source(side).reference is None for side in (0, 1)):
            return Legend(NO_REFERENCE)
        values, _ = self._values()
        if values is None:
            return Legend("no difference: these two buffers are not numbers of one kind at every pixel")
        buffer = BUFFERS[self.session.buffer(0)]
        return Legend("|left - right|, mean of the channels", "0", f"{values.full:.3g}", buffer.unit, colour_map())

    @property
    def title(self) -> str:
        words = [BUFFERS[self.session.buffer(side)].title for side in (0, 1)]
        what = words[0] if words[0] == words[1] else f"{words[0]} and {words[1]}"
        return f"difference of {what}, {self.session.pair}"

    def value(self, x: int, y: int) -> np.ndarray | None:
        """Return the difference at a pixel in the buffer's unit; None where there is none."""
        if self._values()[0] is None:
            return None
        found = []
        for side in (0, 1):
            source = self.session.source(side)
            place = self.session.place(source.view, x, y)
            found.append(self.buffer_view.value(self.session.buffer(side), source, *place))
        left, right = found
        if left is None or right is None or not np.isfinite([*left, *right]).all():  # nothing is seen: depth is infinite there
            return None
        difference: np.ndarray = np.mean(np.abs(left - right), keepdims=True)
        return difference

    def _values(self) -> tuple[Values, Values] | tuple[None, None]:
        """Return the numbers of both sides; None if they are not of one kind."""
        names = [self.session.buffer(side) for side in (0, 1)]
        left, right = (BUFFERS[name].values(self.session.source(side)) for side, name in enumerate(names))
        if left is None or right is None or len({BUFFERS[name].unit for name in names}) > 1 or left.channels != right.channels:
            return None, None
        return left, right
