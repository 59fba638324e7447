"""Fixtures for tests of scene files, which write small files and load the first."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from irrsplat.scene import Scene, load
from irrsplat.scene.stand_ins import camera
from tests.support.gltf_files import GltfFile

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Scene]:
    """Write `text` to the file `name`, and `files` to the same folder (`a_light="…"` is the file a.light), and load the first.
    The file t.obj, one triangle, always exists."""

    def write(text: str | bytes, name: str = "a.scene", **files: str) -> Scene:
        (tmp_path / "t.obj").write_text(TRIANGLE)
        for stem, content in files.items():
            (tmp_path / stem.replace("_", ".")).write_text(content)
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load(path)

    return write


@pytest.fixture
def without_stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the search for a room in models without a camera: it takes most of the time of loading a small file."""
    monkeypatch.setattr(camera, "room_places", lambda *_: camera.RoomPlaces(()))


@pytest.fixture
def file() -> GltfFile:
    """Return an empty glTF file."""
    return GltfFile()


@pytest.fixture
def show(file: GltfFile, tmp_path: Path) -> Callable[..., Scene]:
    """Load the glTF file with one scene of all nodes without parents."""

    def show(**options: Any) -> Scene:
        return load(file.gltf(tmp_path / "a.gltf"), **options)

    return show
