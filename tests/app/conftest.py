"""Fixtures of the command line's tests: a stand-in for the renderer, and a working folder with a small scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.core.buffers import CHANNELS
from irrsplat.image.frame import Frame
from irrsplat.image.view import Progress
from irrsplat.settings import Settings

PLAIN = """cam 0 0 5 0 0 0 0 1 0
proj 40 1 0.1 100
sky 1 1 1
obj triangle.obj
"""
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


class FakeRenderer:
    """Stand-in for the renderer: it stores its arguments and returns frames of constants."""

    arguments: SimpleNamespace
    stats: dict[str, Any]
    reported: Progress
    notices: tuple[str, ...] = ()
    settings: Settings = Settings()

    def __init__(self, scene: Any, size: tuple[int, int], preset: str, tile_size: int | None = None, **settings: Any) -> None:
        type(self).arguments = SimpleNamespace(scene=scene, size=size, preset=preset, tile_size=tile_size, settings=settings)

    def __enter__(self) -> FakeRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def render(
        self,
        camera: Any = None,
        progress: Callable[[Any], None] | None = None,
        figures: bool = False,
        buffers: Any = None,
        gather: bool = True,
    ) -> Frame:
        if not gather:  # the antialiased picture, rendered after the arrays
            return self.frame()
        vars(self.arguments).update(camera=camera, figures=figures, progress=progress, buffers=buffers)
        if progress is not None:
            progress(self.reported)
        return self.frame()

    def change(self, settings: Settings) -> None:
        """Accept other settings."""

    def frame(self) -> Frame:
        """Return a frame of constants."""
        width, height = self.arguments.size
        shapes = {c.name: (height, width, 3) if c.components == 3 else (height, width) for c in CHANNELS.values()}
        shapes |= {f.name: (1, 3) for f in fields(Frame) if f.name.startswith("records_")}
        arrays: dict[str, Any] = {name: np.ones(shape, "f4") for name, shape in shapes.items()}
        stats: Any = {"rounds": 1, "records": 1, "converged": True, "exposure": 0.0} | self.stats
        return Frame(**arrays, stats=stats)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> type[FakeRenderer]:
    """Replace the renderer by FakeRenderer; `fake.arguments` holds its arguments, `fake.stats` more statistics of its frames."""
    monkeypatch.setattr(irrsplat, "Renderer", FakeRenderer)
    FakeRenderer.stats = {}
    FakeRenderer.reported = Progress(round=1, records=3, new=3, coverage=0.5)
    FakeRenderer.arguments = SimpleNamespace()
    return FakeRenderer


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a working folder with a small scene; return the folder."""
    (tmp_path / "plain.scene").write_text(PLAIN)
    (tmp_path / "triangle.obj").write_text(TRIANGLE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Return a function that runs a refused command line, asserts its effects and returns the one line of stderr."""
    monkeypatch.chdir(tmp_path)

    def files() -> dict[Path, bytes | None]:
        return {path: path.read_bytes() if path.is_file() else None for path in tmp_path.rglob("*")}

    def run(argv: list[str], status: int = 2) -> str:
        before = files()
        assert cli.main(argv) == status
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1 and err.endswith("\n"), err
        assert err.startswith("irrsplat: ")
        assert "Traceback" not in err
        assert files() == before
        return err

    return run
