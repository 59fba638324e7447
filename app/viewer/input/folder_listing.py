"""What lies in a folder that the viewer can open, and how a path that is begun goes on."""

from __future__ import annotations

import os
from dataclasses import dataclass

from irrsplat.core.timing.clock import now
from irrsplat.scene import FORMATS

ENDINGS = (*FORMATS, ".path")  # that the viewer opens
_AGAIN = 1.0  # seconds after which a folder is read again


@dataclass(frozen=True)
class Entry:
    """A folder, or a file that can be opened."""

    name: str
    is_folder: bool

    @property
    def shown(self) -> str:
        """Its name, a folder's with a slash at its end."""
        return self.name + "/" if self.is_folder else self.name


class FolderListing:
    """Lists folders, each read again after a second at most."""

    def __init__(self) -> None:
        self._read: tuple[str, float, tuple[Entry, ...]] | None = None

    def entries(self, folder: str, begin: str = "") -> tuple[Entry, ...]:
        """Folders, then files of ENDINGS, by name, that begin with `begin`, whatever the case; none of those whose name begins
        with a dot, unless `begin` does. Nothing for a folder that cannot be read."""
        if self._read is None or self._read[0] != folder or now() >= self._read[1]:
            self._read = folder, now() + _AGAIN, _entries(folder)
        found = self._read[2]
        return tuple(e for e in found if e.name.lower().startswith(begin.lower()) and (begin or e.name[0] != "."))

    def place(self, typed: str, folder: str) -> tuple[str, str]:
        """The folder that a typed path is about, absolute, and what its last name begins with; it is relative to `folder`."""
        head, tail = os.path.split(os.path.expanduser(typed))
        return os.path.normpath(os.path.join(folder, head)), tail

    def completed(self, typed: str, folder: str) -> str:
        """The path as far as all entries that it may stand for agree; as it is where there is none."""
        where, begin = self.place(typed, folder)
        found = [entry.shown for entry in self.entries(where, begin)]
        if not found:
            return typed
        agreed = found[0]
        while any(not name.lower().startswith(agreed.lower()) for name in found):
            agreed = agreed[:-1]
        if any(not name.startswith(agreed) for name in found):  # they agree but for case: what is typed stays
            agreed = begin + agreed[len(begin) :]
        return typed[: len(typed) - len(begin)] + agreed

    def found(self, typed: str, folder: str) -> str:
        """What a typed path stands for: what is there, seen from `folder`; else it as it is, such as a scene's name."""
        path = os.path.normpath(os.path.join(folder, os.path.expanduser(typed)))
        return path if os.path.exists(path) else typed


def _entries(folder: str) -> tuple[Entry, ...]:
    """All of a folder that may be of interest."""
    try:
        with os.scandir(folder) as found:
            all_of = [Entry(one.name, one.is_dir()) for one in found]
    except OSError:
        return ()
    wanted = [e for e in all_of if e.is_folder or os.path.splitext(e.name)[1].lower() in ENDINGS]
    return tuple(sorted(wanted, key=lambda e: (not e.is_folder, e.name.lower())))
