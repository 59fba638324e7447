"""The difference between two states of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from irrsplat.scene.model import Mesh, Scene

_SAME_FACTOR = 1e-6  # relative difference below which two dimming factors count as equal


@dataclass(frozen=True)
class SceneChange:
    """Change from `old` to `new`, which have the same meshes in the same order.

    moved: indices of meshes with other vertices. relit: True if any light differs. repainted: indices of meshes with another
    material. other_sky: True if the sky differs apart from its suns, which are lights.
    """

    old: Scene
    new: Scene
    moved: tuple[int, ...]
    relit: bool
    repainted: tuple[int, ...] = ()
    other_sky: bool = False

    @classmethod
    def between(cls, old: Scene, new: Scene) -> SceneChange:
        """Return the change from `old` to `new`."""
        pairs = list(zip(old.meshes, new.meshes, strict=True))
        moved = tuple(i for i, (a, b) in enumerate(pairs) if is_elsewhere(a, b))
        repainted = tuple(i for i, (a, b) in enumerate(pairs) if a is not b and a.material != b.material)
        return cls(old, new, moved, old.lights != new.lights, repainted, old.sky_parts != new.sky_parts)

    @property
    def back(self) -> SceneChange:
        """The change from `new` to `old`."""
        return replace(self, old=self.new, new=self.old)

    def __bool__(self) -> bool:
        """True if anything differs."""
        return bool(self.moved or self.repainted) or self.relit or self.other_sky

    @property
    def changes_light(self) -> bool:
        """True if all light may differ, because lights, the sky or materials do, or a mesh is shown in the dark."""
        return self.relit or self.other_sky or bool(self.repainted) or self.was_dark

    @cached_property
    def dimming(self) -> np.ndarray | None:
        """The factors (3,) by which all red, green and blue light has changed, where only the lights differ.

        Light is linear in its sources, so these factors scale any cached value. They are 0 where no light is left. None where no
        factor exists, or a light was off.
        """
        old, new = self.old.lights, self.new.lights
        if not self.relit or self.moved or self.repainted or self.other_sky:
            return None
        if not (any(any(light.color) for light in new) or emits(self.new).any()):
            return np.zeros(3)
        if len(old) != len(new):
            return None
        if any(replace(a, color=b.color, name=b.name) != b for a, b in zip(old, new, strict=True)):
            return None
        before, after = (np.array([light.color for light in lights], float) for lights in (old, new))
        lit = before > 0.0
        if (before < 0.0).any() or after[~lit].any():
            return None
        ratio = np.divide(after, before, out=np.full_like(before, np.nan), where=lit)
        least, most = (reduce(ratio, axis=0, initial=limit, where=lit) for reduce, limit in ((np.min, np.inf), (np.max, -np.inf)))
        factor: np.ndarray = np.where(lit.any(0), most, 1.0)
        if (np.where(lit.any(0), most - least, 0.0) > _SAME_FACTOR * factor).any() or (emits(self.new) & (factor != 1.0)).any():
            return None
        return factor

    @cached_property
    def was_dark(self) -> bool:
        """True if light may differ, and no light, sky or visible surface of `old` emits."""
        differs = self.relit or self.other_sky or bool(self.repainted) or self.hides
        return differs and not (any(any(light.color) for light in self.old.lights) or emits(self.old).any())

    @property
    def hides(self) -> bool:
        """True if a mesh was hidden or is visible again (see motion.hidden)."""
        return any(self.old.meshes[i].is_point != self.new.meshes[i].is_point for i in self.moved)


def emits(scene: Scene) -> np.ndarray:
    """Return (3,) bool: True if the sky or a visible surface emits red, green and blue."""
    if scene.environment is not None:
        return np.ones(3, bool)
    sources = [scene.sky, scene.sky_gradient, *(mesh.material.emission for mesh in scene.meshes if not mesh.is_point)]
    return np.asarray(np.any(np.array(sources, float) != 0.0, axis=0))


def is_elsewhere(before: Mesh, after: Mesh) -> bool:
    """True if a mesh's vertices or faces changed; a repainted mesh shares these arrays with the former one."""
    shared = before.positions is after.positions and before.normals is after.normals and before.faces is after.faces
    return not shared
