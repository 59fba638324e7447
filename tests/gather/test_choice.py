"""`--gather auto`: the faster gather of a timed pair is kept in a file, and later processes take it from there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import moderngl
import pytest

from irrsplat.app import cli
from irrsplat.gather import autotune
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from tests.support.worlds import ABOVE, box, floor

ONE = Settings(bounces=1, gather_size=8)
SMALL = Scene((floor(), box((-0.5, 0.0, -0.5), (0.5, 0.5, 0.5))), (), (ABOVE,), sky=(1.0, 1.0, 1.0))


@pytest.fixture
def timed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[float, float], None]:
    """Begin as a new process does, with a race of the given outcome in milliseconds, rasters first."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))

    def begin(rasters: float, rays: float) -> None:
        monkeypatch.setattr(autotune, "_known", {})
        monkeypatch.setattr(autotune, "race", lambda *_: (rasters, rays))

    return begin


def test_the_faster_gather_is_taken_and_kept(
    ctx: moderngl.Context, timed: Callable[[float, float], None], capsys: pytest.CaptureFixture[str]
) -> None:
    """A later process renders by the kept choice, and `irrsplat doctor` reports it."""
    timed(2.0, 1.0)
    rays = autotune.ray_kind(ctx, ONE)
    assert autotune.kind(ctx, SMALL, ONE) == rays
    timed(1.0, 2.0)
    with Renderer(SMALL, (8, 8), bounces=1, gather_size=8) as renderer:
        assert renderer.render().stats["gathered_by"] == rays
    assert autotune.kind(ctx, SMALL, Settings(bounces=1, gather="raster")) == "raster"
    assert autotune.kind(ctx, SMALL, Settings()) == rays, "further bounces always go by rays"
    assert cli.main(["doctor"]) == 0
    assert "by rasters in 0 of the 1 scenes timed here" in capsys.readouterr().out
