"""What is different between two states of one scene: computed once, and handed down to all who go by it."""

from __future__ import annotations

from dataclasses import dataclass

from irrsplat.scene.model import Mesh, Scene


@dataclass(frozen=True)
class SceneChange:
    """From `old` to `new`, which have the same meshes in the same order.

    moved: the indices of the meshes that are elsewhere. relit: whether any light differs. repainted: the indices of the meshes
    that have another material. other_sky: whether the sky differs, but for its suns, which are lights.
    """

    old: Scene
    new: Scene
    moved: tuple[int, ...]
    relit: bool
    repainted: tuple[int, ...] = ()
    other_sky: bool = False

    @classmethod
    def between(cls, old: Scene, new: Scene) -> SceneChange:
        """What a renderer of `old` has to make anew for `new`."""
        pairs = list(zip(old.meshes, new.meshes, strict=True))
        moved = tuple(i for i, (a, b) in enumerate(pairs) if is_elsewhere(a, b))
        repainted = tuple(i for i, (a, b) in enumerate(pairs) if a is not b and a.material != b.material)
        return cls(old, new, moved, old.lights != new.lights, repainted, old.sky_parts != new.sky_parts)

    def __bool__(self) -> bool:
        """Whether anything differs."""
        return bool(self.moved or self.repainted) or self.relit or self.other_sky

    @property
    def looks_otherwise(self) -> bool:
        """Whether all light may be another, since lights, the sky or materials differ."""
        return self.relit or self.other_sky or bool(self.repainted)

    @property
    def hides(self) -> bool:
        """Whether a mesh has vanished, or is there again (see motion.hidden)."""
        return any(self.old.meshes[i].is_point != self.new.meshes[i].is_point for i in self.moved)


def is_elsewhere(before: Mesh, after: Mesh) -> bool:
    """Whether a mesh's triangles are others now; a repainted mesh shares them with that before."""
    if before is after:
        return False
    shared = before.positions is after.positions and before.normals is after.normals and before.faces is after.faces
    return not shared
