"""Embree's rays match the shader's rays for any geometry and any cut-outs."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.gather import kinds
from irrsplat.gpu import context, world
from irrsplat.scene import ray_caster
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Texture, Wrap
from irrsplat.settings import Settings
from tests.gather.test_analytic import room
from tests.gather.test_textures import UP, checker, image
from tests.support.worlds import Lit, box, material, point_light, quad, scene, sites

pytest.importorskip("embreex")


def test_it_sees_what_the_shader_s_rays_see(ctx: moderngl.Context) -> None:
    """E, gradients and the Hessian match in a furnished room, before and after a move; a repetition is equal bit for bit.

    Rounding decides the hit of a ray on an edge, so that some of the 24 × 1024 rays may differ.
    """
    rng = np.random.default_rng(7)
    where = sites(rng.uniform(-0.9, 0.9, (24, 3)), rng.normal(size=(24, 3)))
    before = room()
    moved = replace(before, meshes=(*before.meshes[:-1], replace(before.meshes[-1], positions=before.meshes[-1].positions + 0.2)))
    E = []
    with Lit(ctx, before) as lit:
        for world in (before, moved):
            lit.world.apply(SceneChange.between(lit.world.scene, world))
            truth, found, again = (lit.gather(where, 32, kind, capacity=7) for kind in ("trace", "embree", "embree"))
            for a, b, c in zip(*(vars(one).values() for one in (truth, found, again)), strict=True):
                assert np.array_equal(b, c, equal_nan=True)
                assert np.abs(a - b).max() < 2e-3 * np.abs(a).max()
            E.append(found.E)
    assert np.abs(E[1] - E[0]).max() > 0.05 * E[0].mean(), "what has moved is seen"


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_it_passes_what_is_cut_out(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch, wrap: Wrap) -> None:
    """Through fences with half cut out, one above another, a record sees the sky, and the wall in front of some of it.

    Segments that pass all cut-out triangles end at the wall alone. Paint on the wall keeps Embree's scene. A shift of the
    pattern by a texel swaps posts and holes, also together with a move of the wall in a large scene.
    """
    monkeypatch.setattr(world, "_LARGE", 12)  # triangles: the wall keeps a ray structure of its own after a move
    pattern = Texture(image(np.full((8, 8), 255), 255 * checker(8)), wrap=(wrap, wrap))
    paint, uvs = replace(material(0.5), albedo_texture=pattern, alpha_mode="mask", alpha_cutoff=0.5), np.zeros((4, 4), "f4")
    uvs[:, :2] = (-0.1, 0.1), (-0.1, 1.4), (1.2, 1.4), (1.2, 0.1)
    fences = [replace(quad((-1, height, -1), (0, 0, 2), (2, 0, 0), paint), uvs=uvs) for height in (0.5, 0.52, 0.6)]
    behind = box((-0.3, 0.8, -0.3), (0.3, 1.0, 0.3), material(0.8))
    where = sites([(x, 0.0, 0.1) for x in np.linspace(-0.8, 0.8, 9)], UP)
    with Lit(ctx, scene(*fences, behind, sky=1.0, lights=(point_light((0.0, 2.0, 0.0)),))) as lit:
        truth, found = (lit.gather(where, 32, kind).E[:, 0] for kind in ("trace", "embree"))
        starts = np.random.default_rng(1).uniform(-0.9, 0.9, (200, 3)) * (1.0, 0.0, 1.0)
        ends = starts + np.array([0.0, 2.0, 0.0])
        whole, passed = (lit.world.caster.reach(starts, ends, cut_outs) for cut_outs in (True, False))
        by_fences = np.mean(whole < 0.35)
        swapped = replace(paint, albedo_texture=replace(pattern, transform=(1.0, 0.0, 0.125, 0.0, 1.0, 0.0)))
        opened = [replace(fence, material=swapped) for fence in fences]
        away = replace(behind, positions=behind.positions + np.float32(0.05))
        repainted = [(*some, replace(one, material=material(0.2))) for some, one in ((fences, behind), (opened, away))]
        states = [lit.scene, *(replace(lit.scene, meshes=meshes) for meshes in ((*fences, away), lit.scene.meshes, *repainted))]
        for before, after, kept in zip(states, states[1:], (False, False, True, False), strict=False):
            caster = lit.world.caster
            lit.world.apply(SceneChange.between(before, after))
            assert (lit.world.caster is caster) == kept
        assert np.mean((lit.world.caster.reach(starts, ends) < 0.35) != (whole < 0.35)) > 0.6
    assert 0.3 < by_fences < 0.7 and np.allclose(passed, np.where(np.abs(starts).max(1) < 0.3, 0.4, 1.0), atol=1e-5)
    assert 0.1 * np.pi < truth.min() and truth.max() < 0.9 * np.pi, "there are fences"
    assert np.allclose(found, truth, rtol=2e-3)


def test_without_it_the_others_go_on(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Embree is the default only on software renderers; without it, auto selects the shader and a request is an error."""
    monkeypatch.setattr(context, "describe", lambda ctx: {"software": True})
    assert kinds.kind(ctx, Settings()) == "embree"
    monkeypatch.setattr(context, "describe", lambda ctx: {"software": False})
    assert kinds.kind(ctx, Settings()) == "trace"
    assert kinds.kind(ctx, Settings(gather="embree")) == "embree"
    monkeypatch.undo()
    monkeypatch.setattr(ray_caster, "available", lambda: False)
    assert kinds.kind(ctx, Settings()) == "trace"
    with pytest.raises(InputError, match=r"--gather embree needs the package embreex .*pip install"):
        kinds.kind(ctx, Settings(gather="embree"))
