"""load_cache(update=True): records of another state of the scene, renewed where the change affects them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat import Frame, InputError, Renderer
from irrsplat.core.timing.clock import use_clock
from irrsplat.records import cache_file
from irrsplat.scene.model import Scene
from irrsplat.scene.motion import moved
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.counted_clock import RayClock
from tests.support.worlds import box, material

FINE = FAST | {"gather_size": 16}
BOX = 1  # of `room`


def shift(x: float, y: float, z: float) -> np.ndarray:
    """Return the translation (4, 4) by these metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def repainted(scene: Scene) -> Scene:
    walls = scene.meshes[0]
    return replace(scene, meshes=(replace(walls, material=replace(walls.material, albedo=(0.2, 0.3, 0.7))), *scene.meshes[1:]))


def exchanged(scene: Scene) -> Scene:
    """Replace the box by another one and change the order of meshes."""
    other = box((0.4, -1, 0.0), (0.8, -0.5, 0.4), material((0.8, 0.2, 0.2)))
    return replace(scene, meshes=(other, scene.meshes[0]))


def lit_otherwise(scene: Scene) -> Scene:
    """Return the scene with another light position, and a wall in another colour."""
    lights = tuple(replace(light, position=(-0.5, 0.2, 0.5)) for light in scene.lights)
    return replace(repainted(scene), lights=lights)


CHANGES: dict[str, Callable[[Scene], Scene]] = {
    "a moved mesh": lambda scene: moved(scene, scene.meshes, BOX, shift(0.3, 0.0, 0.2)),
    "other lights and materials": lit_otherwise,
    "another mesh": exchanged,
}


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("saved") / "room.cache"
    with Renderer(room(), SIZE, **FINE) as renderer:
        renderer.render()
        renderer.save_cache(path)
    return path


def apart(one: Frame, truth: Frame) -> float:
    """Return the relative RMSE of irradiance."""
    seen = truth.weight > 0.0
    return float(np.sqrt(np.mean((one.irradiance - truth.irradiance)[seen] ** 2)) / truth.irradiance[seen].mean())


@pytest.mark.parametrize("change", CHANGES)
def test_a_renewed_cache_is_as_exact_as_a_fresh_one(change: str, saved: Path, tmp_path: Path) -> None:
    """Both have about 1 % error against a much finer render of the changed scene; a saved cache belongs to that scene."""
    scene = CHANGES[change](room())
    with Renderer(scene, SIZE, **FINE) as renderer:
        with pytest.raises(InputError, match="this record cache was made for"):
            renderer.load_cache(saved)
        fresh = renderer.render()
        assert renderer.load_cache(saved, update=True)
        kept = renderer.cache.count
        renewed = renderer.render()
        renderer.save_cache(tmp_path / "new.cache")
        assert renderer.load_cache(tmp_path / "new.cache", update=True) == ""
        assert kept > 0.5 * fresh.stats["records"] and not len(renderer.cache.stale)
    with Renderer(scene, SIZE, **FINE | {"gather_size": 32, "a": 0.3, "seed": 5}) as fine:
        truth = fine.render()
    assert apart(renewed, truth) < 1.3 * apart(fresh, truth)
    assert renewed.irradiance.mean() == pytest.approx(truth.irradiance.mean(), rel=0.01)


def test_records_on_a_moved_mesh_go_and_others_are_gathered_again(saved: Path) -> None:
    """The box moves by a centimetre: the records on it, a twentieth to half of all, go."""
    scene = moved(room(), room().meshes, BOX, shift(0.01, 0.0, 0.0))
    before = cache_file.read_any(saved).state.records
    with Renderer(scene, SIZE, **FINE) as renderer:
        renderer.load_cache(saved, update=True)
        state = renderer.cache.state()
        assert len(renderer.cache.stale) == renderer.cache.count
    kept = np.isin(before["id"], state["id"])
    assert np.array_equal(before["position"][kept], state["position"]) and 0.5 < kept.mean() < 0.95


def test_records_of_a_file_leave_coarse_light_when_the_surface_cache_is_complete(tmp_path: Path) -> None:
    """A light moves, and a file of records before the move is loaded while values of the surface cache are coarse.

    All records are gathered by these first, and again by the complete surface cache. The settled picture then differs from a
    fresh render less than pictures of two seeds do (2.2 %). With records by coarse values, 3.8 % remained.
    """
    cornell = irrsplat.load("cornell")
    x, y, z = cornell.lights[0].position
    with use_clock(RayClock(3e6)), Renderer(cornell, (64, 48)) as renderer:
        renderer.frame(seconds=0.08)  # makes the coarse values
        renderer.render()
        renderer.save_cache(tmp_path / "before.npz")
        renderer.relight([replace(cornell.lights[0], position=(x + 0.48, y, z))])
        for _ in range(4):
            renderer.frame(seconds=0.08)
        assert renderer.scheduler.gatherer.provisional
        renderer.load_cache(tmp_path / "before.npz", update=True)
        view, progress = renderer.frame(seconds=0.08)
        while not progress.still:
            view, progress = renderer.frame(seconds=0.08)
        found, last = view.read().irradiance, renderer.scene
    with Renderer(last, (64, 48)) as fresh:
        reference = fresh.render().irradiance
    assert np.sqrt(np.mean((found - reference) ** 2)) < 0.022 * reference.mean()  # measured: 0.017


def test_other_settings_are_refused_all_the_same(saved: Path) -> None:
    with Renderer(room(), SIZE, **FINE | {"gather_size": 12}) as renderer:
        with pytest.raises(InputError, match="made with --gather-size 16, not --gather-size 12"):
            renderer.load_cache(saved, update=True)
        assert renderer.cache.count == 0
