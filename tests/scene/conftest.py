"""What tests of scene files share: writing a few files beside each other and loading the first."""

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
    """Writes `text` to the file `name`, and each of `files` beside it (`a_light="…"` is the file a.light), and loads the first.

    The file t.obj, one triangle, is always there.
    """

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
    """An empty glTF file."""
    return GltfFile()


@pytest.fixture
def show(file: GltfFile, tmp_path: Path) -> Callable[..., Scene]:
    """Load the glTF file, whose one scene holds all nodes that are no children."""

    def show(**options: Any) -> Scene:
        return load(file.gltf(tmp_path / "a.gltf"), **options)

    return show
