"""Runs of texels against the same runs of a plain list."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.gpu import texel_table
from irrsplat.gpu.target import Target, float_texture

WIDTH, HEIGHT = 8, 6


@pytest.mark.parametrize("components", [1, 4])
def test_what_is_written_lies_where_it_belongs(ctx: moderngl.Context, components: int) -> None:
    """Every run that there is: within a row, over its end, over whole rows, and to the last texel."""
    texture, truth = float_texture(ctx, (WIDTH, HEIGHT), components), np.zeros((WIDTH * HEIGHT, components), "f4")
    texture.write(truth.tobytes())
    rng = np.random.default_rng(0)
    for first in range(WIDTH * HEIGHT):
        for last in range(first, WIDTH * HEIGHT + 1, 5):
            values = rng.random((last - first, components))
            texel_table.write(texture, first, values)
            truth[first:last] = values
            assert np.array_equal(texel_table.read(ctx, texture, first, last), truth[first:last])
        assert np.array_equal(np.frombuffer(texture.read(), "f4").reshape(truth.shape), truth)
    texture.release()


def test_a_copy_fills_the_first_rows_whatever_was_drawn_before(ctx: moderngl.Context) -> None:
    """OpenGL cuts copies off by the scissor: a cache that grew after a draw into few columns lost all records in the others."""
    elsewhere = Target(ctx, (WIDTH, HEIGHT), (1,))
    elsewhere.use(scissor=(0, 0, 2, 1))
    small, large = float_texture(ctx, (WIDTH, 2)), float_texture(ctx, (WIDTH, HEIGHT))
    values = np.random.default_rng(1).normal(size=(WIDTH * 2, 4)).astype("f4") * 1e9
    texel_table.write(small, 0, values)
    large.write(np.full((WIDTH * HEIGHT, 4), 7.0, "f4").tobytes())
    texel_table.copy(ctx, small, large)
    found = np.frombuffer(large.read(), "f4").reshape(-1, 4)
    assert np.array_equal(found[: WIDTH * 2], values) and (found[WIDTH * 2 :] == 7.0).all()
    for thing in (small, large, elsewhere):
        thing.release()
