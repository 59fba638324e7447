"""The viewer's cache file: its records are there when the window opens, and kept when it closes."""

from __future__ import annotations

import os

from irrsplat.app.viewer.actions import Desk
from irrsplat.core.errors import IrrsplatError


class Keeper:
    """Keeps the records of the scene on a desk in the file at `path`, those of the left side where there are two.

    Raises InputError where there is a file that is not for this scene and these settings.
    """

    def __init__(self, path: str, desk: Desk) -> None:
        self.path, self.desk, self.source = path, desk, desk.source
        if os.path.exists(path):
            desk.session.renderers[0].load_cache(path)

    def keep(self) -> str | None:
        """Write the file anew; None, or one line: why it stays as it was.

        It belongs to the scene that was opened first, as that is lit by its own files; and nothing does not take its place.
        """
        desk, renderer = self.desk, self.desk.session.renderers[0]
        if not renderer.cache.count:
            return None
        if desk.source != self.source:
            return f"{self.path}: not written, since another scene was opened"
        if any(lamp != desk.loaded(number) for number, lamp in enumerate(desk.lamps)):
            return f"{self.path}: not written, since the lights are no longer the scene's own"
        try:
            renderer.save_cache(self.path)
        except IrrsplatError as error:
            return str(error)
        return None
