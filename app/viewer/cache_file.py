"""The viewer's cache file: its records are there when the window opens, and are kept when it closes."""

from __future__ import annotations

import os

from irrsplat.app.common.kept_cache import KeptCache
from irrsplat.app.viewer.actions import Actions
from irrsplat.core.errors import IrrsplatError
from irrsplat.records import cache_file


class CacheFile:
    """Keeps a session's records in the file at `path`, those of the left side where there are two.

    update: a file of another state of the scene is taken, and what that concerns is gathered again, with a message. Raises
    InputError where there is a file that is not for these settings or, without `update`, not for this scene.
    """

    def __init__(self, path: str, actions: Actions, update: bool = False) -> None:
        self.path, self.actions, self.source = path, actions, actions.source
        self._kept = KeptCache(path)
        if os.path.exists(path) and (reason := actions.session.renderers[0].load_cache(path, update)):
            actions.say(cache_file.renewal(path, reason))

    def save(self) -> str | None:
        """Write the file anew; None, or one line: why it stays as it was.

        It belongs to the scene that was opened first as its own files light it, and an empty cache never replaces it.
        """
        actions, renderer = self.actions, self.actions.session.renderers[0]
        if not renderer.cache.count:
            return None
        if actions.source != self.source:
            return f"{self.path}: not written, since another scene was opened"
        if actions.editor.changed:
            return f"{self.path}: not written, since lights or objects are no longer the scene's own"
        try:
            self._kept.save(renderer.save_cache)
        except IrrsplatError as error:
            return str(error)
        return None
