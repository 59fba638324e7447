"""Limits of radii: compare each record with the records near it, on the GPU, by the formula of radius_limit.frag.

All records are cut into strips along the axis of their greatest extent. Within a strip, the records within COMPARED_WITHIN radii
a·R are a range in the order of their places along this axis.
"""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.gpu import texel_table
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, float_texture
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, record_uniforms
from irrsplat.settings import Settings

COMPARED_WITHIN = 2.0  # radii a·R of a record: greatest distance of records compared with it
_COLUMNS = 64  # of the target: few records then fill whole blocks of pixels, which software renderers draw at once
_HIGHEST = 4096  # rows of the target at most, if 64 columns lead to more: implementations of OpenGL limit textures to 8192
_STRIP = 32768  # records per strip at most: Mesa's software renderer silently ends a fragment's loops after 65535 iterations
_WIDTH = 12  # of a strip, in spacings of the records, about: narrower strips need more draws, wider ones more comparisons


class RadiusLimitPass(Owner):
    """Pass that computes the limits of records' radii."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        defines = [record_defines(gradients) | {"COMPARED_WITHIN": COMPARED_WITHIN} for gradients in (False, True)]
        self.programs = [self.own(Program(ctx, "records/radius_limit", "lib/fullscreen", some)) for some in defines]
        self._made = self.own(Workshop())  # the tables of both kinds of records, and the target

    def __call__(self, cache: RecordCache, first: int, settings: Settings, old: bool) -> np.ndarray:
        """Return (N,) the limits of all records. Those from number `first` on are new.

        A new record is limited by records of lower numbers, so that batch sizes do not matter. old: limit the new records by all
        others, and those before `first` by the new ones.
        """
        limits = cache.limits(cache.count).copy()
        if first < cache.count:
            limits[first:] = self._limits(cache, slice(first, cache.count), 0, settings, old)
            if first and old:
                limits[:first] = np.minimum(limits[:first], self._limits(cache, slice(first), first, settings, True))
        return limits

    def _limits(self, cache: RecordCache, which: slice, low: int, settings: Settings, by_all: bool) -> np.ndarray:
        """Return (K,) the limits of the records `which` by those from number `low` on.

        by_all: compare with records of higher numbers, too.
        """
        size, places = cache.records.size, cache.positions
        columns = max(_COLUMNS, size[0] * size[1] // _HIGHEST)
        shape = columns, size[0] * size[1] // columns
        found = self._made.get("found", shape, lambda: Target(self.ctx, shape, (1,)))
        targets = self._made.get("targets", shape, lambda: float_texture(self.ctx, shape, 1))
        others = self._made.get("others", size, lambda: float_texture(self.ctx, size))
        extents = np.ptp(places, axis=0)
        axes = along, across = extents.argsort()[:0:-1].tolist()
        share = float(extents[across]) / max(float(extents[along]), 1e-30)
        order = np.concatenate(_strips(places[which], axes, share))  # near records share a block
        texel_table.write(targets, 0, (order + which.indices(cache.count)[0])[:, None])
        begin = 0
        for numbers in _strips(places[low:], axes, share):
            strip = low + numbers
            texel_table.write(others, begin, np.column_stack([places[strip], strip]))
            self.programs[settings.gradients](
                found,
                state=DrawState(blend="min") if begin else DrawState(),
                scissor=(0, 0, columns, -(-len(order) // columns)),
                **cache.records.uniforms,
                **record_uniforms(settings),
                adapt=settings.adapt,
                targets=targets,
                count=len(order),
                by_all=by_all,
                others=others,
                axes=axes,
                bounds=(places[strip, across].min(), places[strip, across].max()),
                span=(begin, begin + len(strip)),
            )
            begin += len(strip)
        limits = np.empty(len(order), "f4")
        limits[order] = texel_table.read(self.ctx, found.textures[0], 0, len(order))[:, 0]
        return limits


def _strips(places: np.ndarray, axes: tuple[int, int], share: float) -> list[np.ndarray]:
    """Return the numbers of places (N, 3) in strips along the first of the `axes` and across the second one, each in its order.

    share: the extent of all places along the second axis, as a share of that along the first one.
    """
    along, across = axes
    count = max(int(np.sqrt(len(places) * share) / _WIDTH), -(-len(places) // _STRIP))
    strips = np.array_split(np.argsort(places[:, across], kind="stable"), count)
    return [strip[np.argsort(places[strip, along], kind="stable")] for strip in strips]
