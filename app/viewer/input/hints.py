"""Hints for the first minute: each goes once it was followed, and none comes back in later runs."""

from __future__ import annotations

HINTS = {"fly": "right mouse + WASD fly", "orbit": "left drag orbit", "keys": "F1 keys"}


class Hints:
    """The hints that have not been followed yet. followed: a list of names of HINTS; what is anything else is left out."""

    def __init__(self, followed: object = ()) -> None:
        self.followed = {name for name in HINTS if isinstance(followed, (list, tuple)) and name in followed}

    def follow(self, name: str) -> None:
        """The user has done what a hint of HINTS says."""
        self.followed.add(name)

    @property
    def line(self) -> str:
        """The hints that are left, in one line; empty for none."""
        return "  ·  ".join(text for name, text in HINTS.items() if name not in self.followed)
