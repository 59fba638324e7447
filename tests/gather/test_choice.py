"""`--gather auto`: what is timed decides, once for a process and from process to process; no test goes by the clock."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import moderngl
import numpy as np
import pytest

from irrsplat.app import cli
from irrsplat.core import paths
from irrsplat.gather import autotune
from irrsplat.gpu import context
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from tests.support.worlds import ABOVE, box, floor

ONE = Settings(bounces=1)
SMALL = Scene((floor(), box((-0.5, 0.0, -0.5), (0.5, 0.5, 0.5))), (), (ABOVE,), sky=(1.0, 1.0, 1.0))


class Clock:
    """Stands in for choice.race: says what it is told to, and keeps count."""

    def __init__(self, *times: autotune.Times) -> None:
        self.times, self.asked = list(times), 0

    def __call__(self, ctx: moderngl.Context, scene: Scene, side: int, rays: str) -> autotune.Times:
        self.asked += 1
        return self.times[min(self.asked, len(self.times)) - 1]


@pytest.fixture
def rays(ctx: moderngl.Context) -> str:
    """The kind of rays that is the faster one here."""
    return autotune.ray_kind(ctx, ONE)


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Clock]:
    """Begins a process in which nothing is known, and the race goes as given; the file is that of before."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))

    def fresh(*times: autotune.Times) -> Clock:
        clock = Clock(*times)
        monkeypatch.setattr(autotune, "_known", {})
        monkeypatch.setattr(autotune, "race", clock)
        return clock

    return fresh


def test_the_faster_one_is_taken_and_stays(ctx: moderngl.Context, fresh: Callable[..., Clock], tmp_path: Path) -> None:
    """Timed once; the next process takes what was kept, whatever it would measure itself."""
    clock = fresh((1.0, 2.0), (2.0, 1.0))
    assert [autotune.kind(ctx, SMALL, ONE) for _ in range(3)] == ["raster"] * 3
    assert clock.asked == 1
    clock = fresh((2.0, 1.0))
    assert autotune.kind(ctx, SMALL, ONE) == "raster" and clock.asked == 0
    assert autotune.kept(context.describe(ctx)) == [(1.0, 2.0)]
    assert len(list((tmp_path / "cache").iterdir())) == 1, "one file, and nothing beside it"


def test_rays_where_they_win(ctx: moderngl.Context, fresh: Callable[..., Clock], rays: str) -> None:
    fresh((2.0, 1.0))
    assert autotune.kind(ctx, SMALL, ONE) == rays


def test_what_else_it_goes_by_is_timed_apart(ctx: moderngl.Context, fresh: Callable[..., Clock], rays: str) -> None:
    """Sizes from 64 on count as one; other triangles, or another driver, are timed again."""
    clock = fresh((1.0, 2.0), (2.0, 1.0), (1.0, 2.0))
    sizes = [Settings(bounces=1, gather_size=n) for n in (64, 128, 16, 4)]
    assert [autotune.kind(ctx, SMALL, s) for s in sizes] == ["raster", "raster", rays, rays]
    assert autotune.kind(ctx, Scene(SMALL.meshes[:1], (), (ABOVE,)), ONE) == "raster"
    assert clock.asked == 3
    about = context.describe(ctx)
    assert context.machine(about) != context.machine(about | {"version": "another"})


def test_where_it_is_clear_nothing_is_timed(
    ctx: moderngl.Context, fresh: Callable[..., Clock], monkeypatch: pytest.MonkeyPatch, rays: str
) -> None:
    clock = fresh((1.0, 2.0))
    assert autotune.kind(ctx, SMALL, Settings(bounces=2)) == rays
    assert autotune.kind(ctx, SMALL, Settings()) == rays
    for name in ("plane", "raster", "trace"):
        assert autotune.kind(ctx, SMALL, Settings(gather=name, bounces=1)) == name
    assert autotune.kind(ctx, SMALL, Settings(bounces=0)) == "raster"
    assert autotune.kind(ctx, Scene((), (), (ABOVE,)), ONE) == "raster"
    monkeypatch.setattr(autotune, "DOUBTFUL", {True: 10, False: 10})
    monkeypatch.setattr(autotune, "_GUESS", {True: 10, False: 10})
    assert autotune.kind(ctx, SMALL, ONE) == rays
    assert clock.asked == 0


@pytest.mark.parametrize(
    "content",
    ["", "{", "[]", '{"version": 1}', '{"version": 9, "milliseconds": {}}', '{"version": 1, "milliseconds": {"NAME": [1, "x"]}}',
     '{"version": 1, "milliseconds": {"NAME": [NaN, 1.0]}}', '{"version": 1, "milliseconds": [3]}', "[" * 5000],
)  # fmt: skip
def test_a_broken_file_is_written_anew(
    ctx: moderngl.Context, fresh: Callable[..., Clock], content: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    fresh((2.0, 1.0))
    autotune.kind(ctx, SMALL, ONE)
    file = tmp_path / "cache" / "gathers.json"
    (name,) = json.loads(file.read_text())["milliseconds"]
    file.write_text(content.replace("NAME", name))
    clock = fresh((1.0, 2.0))
    assert autotune.kind(ctx, SMALL, ONE) == "raster" and clock.asked == 1
    assert json.loads(file.read_text())["milliseconds"] == {name: [1.0, 2.0]}
    assert capfd.readouterr() == ("", "")


def test_where_nothing_can_be_kept_it_is_the_same_each_time(
    ctx: moderngl.Context, fresh: Callable[..., Clock], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file in the folder's place; no folder at all: then nothing is timed, or the next process might choose otherwise."""
    (tmp_path / "cache").write_text("in the way")
    clock = fresh((2.0, 1.0))
    assert autotune.kind(ctx, SMALL, ONE) == "raster" and clock.asked == 0
    monkeypatch.setattr(paths, "cache_folder", lambda: None)
    clock = fresh((2.0, 1.0))
    assert autotune.kind(ctx, SMALL, ONE) == "raster" and clock.asked == 0
    assert autotune.kept(context.describe(ctx)) == []


def test_the_race_itself(ctx: moderngl.Context, race: Callable[..., autotune.Times], rays: str) -> None:
    """It runs both, and lets go of what it made."""
    times = race(ctx, SMALL, 16, rays)
    assert all(0.0 < t < 1e4 for t in times)
    lit = Scene((floor(), *SMALL.meshes), (), (ABOVE,))
    sites = autotune._sites(lit, np.concatenate([m.positions[m.faces] for m in (SMALL.meshes[1], floor(), floor())]), 12)
    assert np.allclose(np.linalg.norm(sites.normal, axis=1), 1.0)
    assert sites.triangle is not None and (sites.triangle < 26).all()
    assert (sites.normal[sites.triangle >= 12, 1] > 0.0).all(), "the floor looks up, into the scene"


def test_a_renderer_goes_by_it(fresh: Callable[..., Clock], rays: str) -> None:
    fresh((2.0, 1.0))
    with Renderer(SMALL, (8, 8), bounces=1, gather_size=8) as renderer:
        assert renderer.scheduler.gatherer.gather_pass.kind == rays
        assert renderer.render().stats["gathered_by"] == rays


def test_the_doctor_tells(ctx: moderngl.Context, fresh: Callable[..., Clock], capsys: pytest.CaptureFixture[str]) -> None:
    fresh((2.0, 1.0))
    autotune.kind(ctx, SMALL, ONE)
    assert cli.main(["doctor"]) == 0
    assert "by rasters in 0 of the 1 scenes timed here" in capsys.readouterr().out
