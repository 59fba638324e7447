"""What tests of scene files share: writing a few files beside each other and loading the first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from irrsplat.scene import Camera, Mesh, Scene, load
from irrsplat.scene.io.assets import asset as assets

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
    """OBJ, PLY and STL files are loaded without a light and a camera that suit them, whose search takes most of the time."""

    def plain(path: Path, meshes: Sequence[Mesh], *more: Any) -> Scene:
        notices, files = more[4], [path, *more[5]]
        return Scene(
            tuple(mesh for mesh in meshes if len(mesh.faces)),
            (),
            (Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),),
            notices=tuple(notices),
            files=tuple(dict.fromkeys(map(str, files))),
        )

    monkeypatch.setattr(assets, "finish", plain)
