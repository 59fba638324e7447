"""Two sides in one picture: how far they differ, in numbers or as an eye sees it (FLIP)."""

from __future__ import annotations

from importlib.util import find_spec
from threading import Thread

import moderngl
import numpy as np

from irrsplat.app.verify.error_image import PIXELS_PER_DEGREE
from irrsplat.app.viewer.buffers.background_truth import Lattice
from irrsplat.app.viewer.buffers.buffer_view import BufferView
from irrsplat.app.viewer.buffers.legend import Legend, colour_map
from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Identity, Values, ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.buffers.truth import NO_TRUTH
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.show.screen import clear
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, float_texture
from irrsplat.reference.worker import INSTALL


def flip_is_there() -> bool:
    """Whether FLIP can be computed here."""
    return find_spec("flip_evaluator") is not None


class Comparison(Owner):
    """Draws what the two sides of a session differ by, with a legend, and the difference at a pixel."""

    def __init__(self, session: Session, buffer_view: BufferView) -> None:
        self.session, self.buffer_view = session, buffer_view
        self.flip = FlipMap(session.ctx)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees; the view's buffers are another's."""
        return (self.flip,)

    @property
    def inputs(self) -> object:
        """What it is made of besides both sides, for a memo."""
        return self.session.options.compare == "FLIP" and (self.session.at_rest, Identity(self.flip.texture), self.flip.working)

    def update(self) -> None:
        """Take FLIP's map where it has been computed meanwhile, and begin another one where the sides are at rest and differ from
        those before."""
        session = self.session
        if session.options.compare != "FLIP" or not session.compared:
            return
        self.flip.collect()
        sources = [(session.buffer(side), session.source(side)) for side in (0, 1)]
        subject = tuple((name, source.inputs, BUFFERS[name].inputs(source)) for name, source in sources)
        wanted = self.flip.subject != subject and session.at_rest and not self.flip.working and flip_is_there()
        if wanted and not self._truth_is_missing:
            pictures = [self._picture(*one) for one in sources]
            truth = next((source.truth for name, source in sources if BUFFERS[name].needs_truth), None)
            if truth is not None:  # which is known in the middle of each cell of pixels alone
                pictures = [_at_cells(picture, truth.lattice) for picture in pictures]
            left, right = pictures
            self.flip.begin(subject, left, right, 1 if truth is None else truth.lattice.stride)

    @property
    def _truth_is_missing(self) -> bool:
        """Whether a side shows what the path tracer has to find first."""
        session = self.session
        return any(BUFFERS[session.buffer(side)].needs_truth and session.source(side).truth is None for side in (0, 1))

    @property
    def _truth_is_coarse(self) -> bool:
        """Whether a side shows a truth of some pixels alone."""
        shown = ((BUFFERS[self.session.buffer(side)], self.session.source(side).truth) for side in (0, 1))
        return any(buffer.needs_truth and truth is not None and truth.lattice.stride > 1 for buffer, truth in shown)

    def forget(self) -> None:
        """Know nothing of what was compared."""
        self.flip.subject = None

    def draw(self, target: Target) -> None:
        """Draw it over the whole target."""
        if self.session.options.compare == "FLIP":
            return self.flip.draw(target, self.buffer_view)
        left, right = (self._source(side) for side in (0, 1))
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
        """What its colours stand for."""
        if self._truth_is_missing:
            return Legend(NO_TRUTH)
        if self.session.options.compare == "FLIP":
            return self.flip.legend()
        values, _ = self._values()
        if values is None and self._truth_is_coarse:
            return Legend("no difference yet: FLIP compares the pixels that have a reference")
        if values is None:
            return Legend("no difference: these two buffers are not numbers of one kind; FLIP compares their pictures")
        buffer = BUFFERS[self.session.buffer(0)]
        return Legend("|left - right|, mean of the channels", "0", f"{values.full:.3g}", buffer.unit, colour_map())

    @property
    def title(self) -> str:
        """What is compared, in words."""
        words = [BUFFERS[self.session.buffer(side)].title for side in (0, 1)]
        what = words[0] if words[0] == words[1] else f"{words[0]} and {words[1]}"
        return f"{'FLIP' if self.session.options.compare == 'FLIP' else 'difference'} of {what}, {self.session.pair}"

    def value(self, x: int, y: int) -> np.ndarray | None:
        """The difference at a pixel in the buffer's unit, or FLIP's 0..1; None where there is none."""
        if self.session.options.compare == "FLIP":
            return self.flip.value(self.buffer_view, x, y, self.session.size)
        if self._values()[0] is None:
            return None
        found = []
        for side in (0, 1):
            source = self._source(side)
            place = self.session.place(source.view, x, y)
            found.append(self.buffer_view.value(self.session.buffer(side), source, *place))
        left, right = found
        if left is None or right is None or not np.isfinite([*left, *right]).all():  # nothing is seen: depth is infinite there
            return None
        difference: np.ndarray = np.mean(np.abs(left - right), keepdims=True)
        return difference

    def _source(self, side: int) -> ViewSource:
        return self.session.source(side)

    def _values(self) -> tuple[Values, Values] | tuple[None, None]:
        """Where both sides' numbers lie; None where they are not of one kind."""
        names = [self.session.buffer(side) for side in (0, 1)]
        left, right = (BUFFERS[name].values(self._source(side)) for side, name in enumerate(names))
        if left is None or right is None or len({BUFFERS[name].unit for name in names}) > 1 or left.channels != right.channels:
            return None, None
        return left, right

    def _picture(self, name: str, source: ViewSource) -> np.ndarray:
        """(H, W, 3) a buffer as it is shown, 0..1, without anything over it."""
        target = Target(self.session.ctx, self.session.size, (4,))
        try:
            self.buffer_view.draw(target, name, source)
            return np.ascontiguousarray(target.read()[..., :3])
        finally:
            target.release()


def _at_cells(picture: np.ndarray, lattice: Lattice) -> np.ndarray:
    """The pixels of a picture (H, W, 3) that are in the middle of the lattice's cells, (rows, columns, 3)."""
    places = (
        np.clip(np.arange(count) * lattice.stride + lattice.stride // 2 - margin, 0, pixels - 1)
        for count, margin, pixels in zip(lattice.count, lattice.margin, picture.shape[1::-1], strict=True)
    )
    columns, rows = places
    return np.ascontiguousarray(picture[np.ix_(rows, columns)])


class FlipMap(Owner):
    """FLIP (Andersson et al. 2020) of two pictures, computed in a thread; the last map until the next is there."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.subject: object = None  # what the map, or the one that is computed, is of
        self.texture: moderngl.Texture | None = None
        self.mean = 0.0
        self._found: tuple[np.ndarray, float] | None = None
        self._thread: Thread | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.texture,)

    @property
    def working(self) -> bool:
        """Whether a map is being computed."""
        return self._thread is not None

    def begin(self, subject: object, left: np.ndarray, right: np.ndarray, stride: int = 1) -> None:
        """Compute the map of two display pictures (H, W, 3), 0..1; the right one is the reference. stride: pixels of the window
        that one of theirs stands for, across and down."""
        self.subject = subject

        def compute() -> None:
            import flip_evaluator

            size = {"ppd": PIXELS_PER_DEGREE / stride}
            found, mean, _ = flip_evaluator.evaluate(right, left, "LDR", applyMagma=False, parameters=size)
            self._found = np.asarray(found)[..., 0], float(mean)

        self._thread = Thread(target=compute, name="FLIP", daemon=True)
        self._thread.start()

    def collect(self) -> None:
        """Take the map that has been computed meanwhile."""
        if self._thread is None or self._thread.is_alive():
            return
        self._thread = None
        if self._found is None:  # it failed, and the thread has said so
            return
        (found, self.mean), self._found = self._found, None
        if self.texture is not None:
            self.texture.release()
        self.texture = float_texture(self.ctx, (found.shape[1], found.shape[0]), 1)
        self.texture.write(np.ascontiguousarray(found[::-1], "f4").tobytes())

    def draw(self, target: Target, buffer_view: BufferView) -> None:
        """Draw the map; the ground's colour before the first."""
        if self.texture is None:
            return clear(target, GROUND)
        program = buffer_view.programs("viewer/compare/flip")
        program(target, colours=buffer_view.colours, map=self.texture, size=target.size)

    def legend(self) -> Legend:
        """The scale and the mean."""
        if not flip_is_there():
            return Legend(f"FLIP needs: {INSTALL}")
        if self.texture is None or self.working:
            return Legend("is computed once both sides are at rest")
        text = f"mean {self.mean:.4f}, of the pictures as they are shown, {PIXELS_PER_DEGREE:g} pixels a degree"
        return Legend(text, "0", "1", "", colour_map())

    def value(self, buffer_view: BufferView, x: int, y: int, size: tuple[int, int]) -> np.ndarray | None:
        """The map at a pixel of a window of `size`."""
        if self.texture is None:
            return None
        at = x * self.texture.width // size[0], y * self.texture.height // size[1]
        return buffer_view.texels(self.texture, *at)

    def release(self) -> None:
        """Free the map; what is being computed is waited for, as it does not take long."""
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        super().release()
        self.texture, self.subject = None, None
