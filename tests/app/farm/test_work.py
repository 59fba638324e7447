"""The work of a farm's workers, done here without a scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from irrsplat.app import cli, grammar
from irrsplat.app.common.pictures import Pictures
from irrsplat.app.farm import cluster, work
from irrsplat.app.film.flight import Flight
from irrsplat.core.errors import InputError
from irrsplat.scene import load
from irrsplat.scene.camera_path import load_path
from tests.app.film.test_fill import FLIGHT
from tests.support.viewing import write_room

FILL, RENDER = ["fill", "room.scene", *FLIGHT], ["render", "room.scene", *FLIGHT, "--cache-mode", "frozen"]


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[work.Job]:
    """The job of a flight of four frames, in a working folder with a room."""
    write_room(tmp_path)
    (tmp_path / "a.path").write_text("frames 4\ncam -0.3 0 0.9 0 0 -1 0 1 0\ncam 0.2 0.1 0.7 0.4 0 -1 0 1 0\n")
    monkeypatch.chdir(tmp_path)
    scene = load("room.scene")
    flight = Flight(load_path("a.path", scene.camera().fov), range(4))
    yield cluster.job_of(grammar.parse(FILL), scene, flight)
    work.release()


def test_parts_that_are_filled_apart_are_a_whole(job: work.Job) -> None:
    """Each frame has its records, and a frame from the merged cache is that of the command, to the byte."""
    parts = [work.fill(job, numbers) for numbers in cluster.split(range(4), 2)]
    assert [part.done.frames for part in parts] == [{0: 1.0, 1: 1.0}, {2: 1.0, 3: 1.0}]
    whole = cluster._merged([part.cache for part in parts], None)
    last = work.fill(job, range(4), whole)
    assert [*last.done.frames.values()] == [1.0] * 4
    assert (
        max(cluster.count(part.cache) for part in parts)
        < cluster.count(last.cache)
        < sum(cluster.count(part.cache) for part in parts)
    )
    Path("film.cache").write_bytes(last.cache)
    assert cli.main([*RENDER, "-o", "a{frame}.png"]) == 0
    done = work.render(job, range(1, 3), last.cache, ["b{frame}.png", "c{frame}"], None, Pictures(), work.driver())
    assert [stats["frame"] for stats in done.stats] == [1, 2]
    assert [done.files[number, 0][""] for number in (1, 2)] == [Path(f"a{number}.png").read_bytes() for number in (1, 2)]
    assert "image.png" in done.files[1, 1]
    with pytest.raises(InputError, match="would differ in their bits"):
        work.render(job, range(1), last.cache, ["b{frame}.png"], None, Pictures(), "another driver")


def test_a_worker_with_another_scene_or_other_code_refuses(job: work.Job) -> None:
    """The scene changes between the command's reading and the worker's."""
    with pytest.raises(InputError, match=r"this worker has irrsplat .*, code [0-9a-f]{12}, and the job is for other code"):
        work.fill(replace(job, software="other code"), range(1))
    point_light = Path("lamp.light")
    point_light.write_text(point_light.read_text().replace("3 3 3", "4 3 3"))
    with pytest.raises(InputError, match="the scene of this worker was made for other lights"):
        work.fill(job, range(1))


def test_a_flight_is_split_into_parts_that_are_alike() -> None:
    for count, parts in ((90, 4), (7, 3), (3, 8), (1, 1)):
        found = cluster.split(range(5, 5 + count), parts)
        assert [number for part in found for number in part] == list(range(5, 5 + count))
        assert len(found) == min(count, parts) and max(map(len, found)) - min(map(len, found)) <= 1
    assert cluster.runs([0, 1, 2, 5, 6, 9], 2) == [range(0, 3), range(5, 7), range(9, 10)]
