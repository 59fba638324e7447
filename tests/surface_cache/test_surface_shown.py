"""Surface cache in the viewer: its buffer and its value under the cursor."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Programs, ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.gpu.target import Target, pixels
from irrsplat.image.tonemap import tonemap
from irrsplat.renderer import Renderer

SIZE = (97, 61)
EXPOSURE = -1.0  # stops


@pytest.mark.few_sites
def test_the_buffer_is_the_light_that_a_white_surface_reflects(ctx: moderngl.Context) -> None:
    """The buffer and its values under the cursor equal lookups."""
    target, programs, shown = Target(ctx, SIZE, (4,)), Programs(ctx), BUFFERS["surface"]
    with Renderer(irrsplat.load("cornell"), SIZE, ctx=ctx, gather_size=8, shadow_size=128) as renderer:
        view, _ = renderer.frame()
        surface = renderer.scheduler.gatherer.surface_now
        assert surface is not None
        found, source = pixels(surface.view(view.gbuffer)), ViewSource(renderer, view, EXPOSURE)
        shown.draw(Canvas(target, programs), source)
        mask = pixels(view.gbuffer.position)[..., 3] > 0.0
        expected = np.where(mask[..., None], tonemap(found[..., :3] / np.pi, EXPOSURE), 0.0)
        assert expected[mask].std() > 0.1 and (found[..., 3] == mask).all()
        assert np.abs(target.read()[..., :3] - expected).max() < 1.0 / 255.0
        for y, x in np.random.default_rng(1).permutation(np.argwhere(mask))[:5]:
            value = shown.value(source, int(x), int(y))
            assert value is not None and np.array_equal(value, found[y, x, :3])
        assert shown.value(source, *np.argwhere(~mask)[0][::-1]) is None
        assert "W/m²" in BUFFERS["surface"].legend(source).text
    programs.release()
    target.release()
