"""Moves where the gather's kind is chosen by time and differs by size; changes one after the other; changes that fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gather import autotune
from irrsplat.gpu.bvh_table import TriangleTable
from irrsplat.gpu.target import pixels
from irrsplat.indirect.gathering.change_probe import ChangeProbe
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene import change, ray_caster
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Mesh
from tests.renderer.test_move import BOX, shift
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.viewing import Driver, push
from tests.support.worlds import lamp

TWO = (lamp((-0.5, 0.2, 0.5), 5.0), *room().lights)
WAY = shift(0.3, 0.0, 0.2)


def agrees(renderer: Renderer) -> None:
    """The picture is about what a fresh renderer makes of the scene as it is now; what no record has a part in, exactly."""
    frame = renderer.render()
    same = {"gather_size": renderer.settings.gather_size, "gather": renderer.settings.gather}  # 8² texels are 4 % off, rays 2 %
    with Renderer(renderer.scene, SIZE, **{**FAST, **same}) as fresh:
        other = fresh.render()
    assert np.array_equal(frame.position, other.position) and np.array_equal(frame.direct, other.direct)
    assert frame.irradiance.mean() == pytest.approx(other.irradiance.mean(), rel=0.05)
    assert frame.stats["converged"]


@pytest.mark.parametrize("coarse", ["raster", "trace"])
def test_probes_look_as_records_do(monkeypatch: pytest.MonkeyPatch, coarse: str) -> None:
    """Where 16² are faster one way and 64² the other: a move is as good as with either alone."""
    monkeypatch.setattr(autotune, "_known", {})
    monkeypatch.setattr(ray_caster, "available", lambda: False)
    times = {"raster": (1.0, 2.0), "trace": (2.0, 1.0)}
    fine = "trace" if coarse == "raster" else "raster"
    monkeypatch.setattr(autotune, "_times", lambda name, measure: times[coarse if name.endswith("; 16 texels") else fine])
    with Renderer(room(), SIZE, **{**FAST, "gather_size": 32}) as renderer:
        assert renderer.scheduler.gatherer.gather_pass.kind == fine
        renderer.render()
        for way in (WAY, np.eye(4), WAY):
            renderer.move(BOX, way)
            renderer.frame()
        assert renderer.scheduler.gatherer.probes.gather.kind == fine
        agrees(renderer)


@pytest.mark.parametrize("lights", [TWO, (), room().lights])
@pytest.mark.parametrize("moved", [False, True])
def test_lights_change_and_a_mesh_moves_before_a_frame(lights: Any, moved: bool) -> None:
    """More lights than the shadow maps are of, or fewer; after a move before, so that there are probes, or as the first one."""
    with Renderer(room(), SIZE, **FAST) as renderer:
        renderer.render()
        if moved:
            renderer.move(BOX, shift(0.1))
            renderer.render()
        renderer.relight(lights)
        renderer.move(BOX, WAY)
        renderer.relight(tuple(reversed(lights)))
        renderer.move(BOX, WAY)
        renderer.change(replace(renderer.settings, shadow_size=32))
        renderer.move(BOX, shift(0.2))
        renderer.change(replace(renderer.settings, shadow_size=64))
        agrees(renderer)


def state(renderer: Renderer) -> list[Any]:
    """All that a change may change, by value."""
    gatherer, cache = renderer.scheduler.gatherer, renderer.cache.read()
    known = renderer.scene.lights, renderer.settings, gatherer.settings, renderer.world.shows(renderer.scene), gatherer.unsettled
    return [*known, *(a.tobytes() for a in (*cache.values(), *flatten(renderer.scene)[:2], renderer.cache.stale))]


def fails(*_: Any, **__: Any) -> Any:
    raise RuntimeError("no memory")


def interrupted(*_: Any, **__: Any) -> Any:
    raise KeyboardInterrupt


CHANGES: dict[str, tuple[Any, str, Callable[[Renderer], None]]] = {
    "probes": (ChangeProbe, "__call__", lambda r: r.move(BOX, WAY)),
    "kind": (autotune, "kind", lambda r: r.change(replace(r.settings, gather_size=12))),
    "lights": (autotune, "gather_pass", lambda r: r.relight(TWO)),
    "gather": (autotune, "gather_pass", lambda r: r.change(replace(r.settings, gather="raster", gradients=False))),
    "triangles": (TriangleTable, "update", lambda r: r.move(BOX, WAY)),
}


@pytest.mark.parametrize("case", CHANGES)
def test_a_change_that_fails_changes_nothing(monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    """It can be made later, and the renderer goes on as before until then."""
    owner, name, act = CHANGES[case]
    with Renderer(room(), SIZE, **FAST, gather="trace") as renderer:
        renderer.render()
        before, image = state(renderer), pixels(renderer.frame()[0].image).copy()
        with monkeypatch.context() as patch, pytest.raises(RuntimeError, match="no memory"):
            patch.setattr(owner, name, fails)
            act(renderer)
        assert state(renderer) == before, "all is as it was"
        assert np.array_equal(pixels(renderer.frame()[0].image), image)
        act(renderer)
        renderer.change(replace(renderer.settings, **{**FAST, "gather": "auto", "gradients": True}))
        agrees(renderer)


@pytest.mark.parametrize("act", [lambda r: r.move(BOX, WAY), lambda r: r.relight(TWO)], ids=["move", "relight"])
def test_a_change_that_is_interrupted_while_records_change_forgets_them(
    monkeypatch: pytest.MonkeyPatch, act: Callable[[Renderer], None]
) -> None:
    """Only some would have changed; the renderer goes on with the scene as it was, and the change can be made later."""
    with Renderer(room(), SIZE, **FAST, gather="trace") as renderer:
        renderer.render()
        scene = renderer.scene
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            for name in ("keep_only", "invalidate"):
                patch.setattr(RecordCache, name, interrupted)
            act(renderer)
        assert renderer.cache.count == 0 and renderer.scene is scene
        agrees(renderer)
        act(renderer)
        agrees(renderer)


def test_without_bounces_what_a_record_sees_is_shown_as_it_was_gathered(driver: Driver) -> None:
    """The cache keeps its records of two bounces, and the rays that they see by, while there are none to gather."""
    driver.session.change(0, bounces=2)
    driver.settle()
    driver.session.change(0, bounces=0)
    driver.move(120, 120)
    push(driver, "I")
    driver.frame(2)
    assert driver.viewer.inspected is not None


def test_meshes_are_compared_once_for_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many follow it: lights, records, triangles, the surface cache; and not at all where nothing has changed."""
    compared: list[str] = []
    real = change.is_elsewhere

    def counted(before: Mesh, after: Mesh) -> bool:
        compared.append(after.name)
        return real(before, after)

    monkeypatch.setattr(change, "is_elsewhere", counted)
    with Renderer(room(), SIZE, **{**FAST, "bounces": "all"}) as renderer:
        renderer.render()
        assert not compared
        meshes = len(renderer.scene.meshes)
        for act in (
            lambda: renderer.move(BOX, WAY),
            lambda: renderer.relight(TWO),
            lambda: renderer.repaint(BOX, replace(renderer.scene.meshes[BOX].material, albedo=(0.1, 0.2, 0.3))),
        ):
            compared.clear()
            act()
            renderer.frame()
            assert len(compared) == meshes
