"""The line that the user measures along: from one point on a surface to another, dragged, or clicked one after the other."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float, float]


@dataclass
class MeasuringLine:
    """start, end: world space; None: not set yet. open: whether the end is still to come."""

    start: Point | None = None
    end: Point | None = None
    open: bool = False

    @property
    def ends(self) -> tuple[Point, Point] | None:
        """Both points, where they are there and not one."""
        if self.start is None or self.end is None or self.start == self.end:
            return None
        return self.start, self.end

    def press(self, point: Point) -> None:
        """A button went down at a point: a new line begins there; or the one ends there whose first end was clicked."""
        if self.open:
            self.end, self.open = point, False
        else:
            self.start, self.end, self.open = point, None, True

    def drag(self, point: Point) -> None:
        """The mouse moved with the button down."""
        self.end = point

    def release(self) -> None:
        """The button went up: a line that was dragged has its end."""
        self.open = self.open and self.end is None
