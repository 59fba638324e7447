"""Small pictures of scenes that were open before, as tooltips of their names."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import moderngl
import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend
from irrsplat.core.errors import IrrsplatError
from irrsplat.gpu.resource import Owner, Resource

_WIDEST = 4 * preferences.PICTURE_SIDE  # pixels: a larger file is none of ours


class ScenePictures(Owner):
    """Shows them; each is read when it is wanted, and again when its file has changed."""

    def __init__(self, backend: ImguiBackend) -> None:
        self.backend = backend
        self._read: dict[Path, tuple[int, moderngl.Texture | None]] = {}  # and the files' times

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return tuple(texture for _, texture in self._read.values())

    def tooltip(self, source: str, scale: float) -> None:
        """Where the mouse is on the last item, show the scene's picture, if there is one, and where it lies."""
        if not imgui.begin_item_tooltip():
            return
        texture = self._texture(source)
        if texture is not None:
            self.backend.image(texture, (scale * texture.width, scale * texture.height))
        imgui.text_unformatted(source)
        imgui.end_tooltip()

    def _texture(self, source: str) -> moderngl.Texture | None:
        try:
            path = preferences.picture_path(source)
            changed = path.stat().st_mtime_ns
        except (IrrsplatError, OSError):
            return None
        if path not in self._read or self._read[path][0] != changed:
            before = self._read.pop(path, (0, None))[1]
            if before is not None:
                before.release()
            self._read[path] = changed, self._load(path)
        return self._read[path][1]

    def _load(self, path: Path) -> moderngl.Texture | None:
        """The picture in a file; None for a damaged one, which is no loss."""
        from PIL import Image

        with suppress(OSError, ValueError, Image.DecompressionBombError), Image.open(path) as picture:
            if max(picture.size) <= _WIDEST:
                values = np.asarray(picture.convert("RGBA"))[::-1]
                return self.backend.ctx.texture(picture.size, 4, np.ascontiguousarray(values).tobytes())
        return None
