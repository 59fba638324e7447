"""What is different between two states of one scene: computed once, and handed down to all who go by it."""

from __future__ import annotations

from dataclasses import dataclass

from irrsplat.scene.model import Scene


@dataclass(frozen=True)
class SceneChange:
    """From `old` to `new`, which have the same meshes in the same order.

    moved: the indices of the meshes that are elsewhere. relit: whether any light differs.
    """

    old: Scene
    new: Scene
    moved: tuple[int, ...]
    relit: bool

    @classmethod
    def between(cls, old: Scene, new: Scene) -> SceneChange:
        """What a renderer of `old` has to make anew for `new`."""
        moved = tuple(i for i, (a, b) in enumerate(zip(old.meshes, new.meshes, strict=True)) if a is not b)
        return cls(old, new, moved, relit=old.lights != new.lights)

    def __bool__(self) -> bool:
        """Whether anything differs."""
        return bool(self.moved) or self.relit
