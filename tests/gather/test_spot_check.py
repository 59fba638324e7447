"""The spot check: looks from places all over a view find where records agree with each other and are wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.gather.spot_check import PlacesChecked, SpotCheck, Spots
from irrsplat.indirect.gathering.record_gatherer import RecordGatherer
from irrsplat.scene.model import Camera, Scene
from tests.support import worlds

SIZE = (96, 72)
CAMERA = Camera((0.0, 0.5, 1.0), (0.0, 0.0, 0.0), fov=40.0)
EVERYWHERE = {"bounces": 1, "gather": "trace"}  # settings


def feet() -> Scene:
    """Black boards that stand on a table under a white sky, each as high as the way to the next: between them it is dark."""
    black, high = worlds.material(0.0), 0.05
    boxes = [worlds.box((x, 0.0, -0.1), (x + 0.004, high, 0.1), black) for x in (-0.2, -0.18, 0.0, 0.03, 0.2, 0.215)]
    return worlds.scene(worlds.floor(1.0), *boxes, sky=1.0, camera=CAMERA)


@contextmanager
def glances(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """From how many places a look is taken, of each batch, while the block lasts."""
    counts: list[int] = []
    glance = RecordGatherer.glance

    def counted(self: RecordGatherer, shadows: object, sites: Sites, budget: object, side: int) -> np.ndarray:
        found = glance(self, shadows, sites, budget, side)  # type: ignore[arg-type]
        counts.append(len(found))
        return found

    with monkeypatch.context() as patched:
        patched.setattr(RecordGatherer, "glance", counted)
        yield counts


def spots(count: int, apart: float = 0.01, rows: float = 72.0) -> Spots:
    """So many places on a level line, which records say the same of."""
    place = np.zeros((count, 3), "f4")
    place[:, 0] = apart * (0.5 + np.arange(count))
    up = np.tile(np.array([0.0, 1.0, 0.0], "f4"), (count, 1))
    return Spots.joined(
        [Spots(Sites(place, up, up, np.zeros(count, int), np.arange(count)), np.ones(count), np.full(count, apart), rows)]
    )


def test_what_is_off_by_little_wants_no_record() -> None:
    """Nor does what is dark; each look along more rays is taken where the one before it contradicts."""
    check = replace(SpotCheck.of(spots(4)), found=np.array([0.9, 0.3, 0.05, 1.5]))
    assert len(check.contradicting) == 2
    second = check.next
    assert second.stage == 1 and not second.looked and len(second.spots) == 2
    third = replace(second, found=np.array([0.8, 0.1])).next
    assert third.last and len(third.spots) == 1
    assert len(replace(third, found=np.array([0.2])).contradicting) == 1
    assert len(replace(third, found=np.array([0.7])).contradicting) == 0
    dark = replace(spots(3), said=np.array([0.004, 0.001, 1.0]), floor=0.1)
    assert (dark.off(np.array([0.001, 0.9, 1.0])) < 0.05).all()


def test_of_those_close_together_the_worst_stands_for_all() -> None:
    close = spots(64, rows=720.0)
    off = np.linspace(0.5, 0.9, 64)
    found = close.worst(off)
    assert 63 in found and 1 < len(found) < 64
    other = close[np.arange(64)[::-1]]  # the order makes no difference
    again = other.sites.position[other.worst(off[::-1]), 0]
    assert np.array_equal(np.sort(again), np.sort(close.sites.position[found, 0]))


def test_places_are_looked_at_once_unless_from_closer() -> None:
    done, seen = PlacesChecked(), spots(50)
    assert len(done.left(seen)) == 50
    done.note(seen, 10)
    assert len(done.left(seen)) == 0
    assert len(done.left(replace(seen, distance=4.0 * seen.distance))) == 0  # from further away
    assert len(done.left(replace(seen, distance=seen.distance / 8.0))) == 50  # from closer
    turned = replace(seen.sites, geometric=-seen.sites.geometric)
    assert len(done.left(replace(seen, sites=turned))) == 50  # the other side of a sheet
    done.forget_if_fewer(10)
    assert len(done.cells) and len(done.left(seen)) == 0
    done.forget_if_fewer(9)  # a record has gone
    assert not len(done.cells) and len(done.left(seen)) == 50


def test_a_view_seen_again_is_not_looked_at_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor after its records were kept in a file, nor where only the light's strength has changed; a new view is."""
    scene, path = feet(), tmp_path / "records.cache"
    with irrsplat.Renderer(scene, SIZE, **EVERYWHERE) as renderer:  # type: ignore[arg-type]
        with glances(monkeypatch) as first:
            count = renderer.render().stats["records"]
        assert sum(first) > 1000
        renderer.save_cache(path)
        with glances(monkeypatch) as again:
            assert renderer.render().stats["records"] == count
        assert sum(again) == 0
        with glances(monkeypatch) as nearby:
            renderer.render(replace(CAMERA, eye=(0.004, 0.5, 1.0)))
        assert sum(nearby) < 0.5 * sum(first)
        renderer.forget()
        with glances(monkeypatch) as anew:
            assert renderer.render().stats["records"] == count
        assert anew == first
    with irrsplat.Renderer(scene, SIZE, **EVERYWHERE) as other, glances(monkeypatch) as loaded:  # type: ignore[arg-type]
        other.load_cache(path)
        assert other.render().stats["records"] == count
    assert sum(loaded) == 0


def test_ticks_and_tiles_come_to_the_records_of_a_render(monkeypatch: pytest.MonkeyPatch) -> None:
    """And views in passing are not looked at."""
    scene, counts = feet(), []
    for tile in (0, 40):
        with irrsplat.Renderer(scene, SIZE, tile_size=tile, **EVERYWHERE) as renderer:  # type: ignore[arg-type]
            counts.append(renderer.render())
    assert np.array_equal(counts[0].irradiance, counts[1].irradiance)
    with irrsplat.Renderer(scene, SIZE, **EVERYWHERE) as ticked:  # type: ignore[arg-type]
        with glances(monkeypatch) as passing:
            for x in np.linspace(-0.1, 0.1, 5):
                ticked.frame(replace(CAMERA, eye=(float(x), 0.5, 1.0)), seconds=10.0)
        assert sum(passing) == 0
        with glances(monkeypatch) as looks:
            while not ticked.frame(CAMERA, seconds=0.02)[1].done:
                pass
        assert len(looks) > 3 and sum(looks) > 1000
