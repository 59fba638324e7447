"""Runs of texels against the same runs of a plain list."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.gpu import texel_table
from irrsplat.gpu.target import float_texture

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
