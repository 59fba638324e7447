"""The editor of lights and objects: their changes, the selection, undo and redo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.view_options import Point
from irrsplat.core.vectors import vector
from irrsplat.scene.model import Light, Mesh, Scene
from irrsplat.scene.motion import hidden

_BESIDE = 0.03  # of the scene's extent: the distance of a copied light from its original
_MOST = 50  # the most scenes that undo keeps; each holds its moved meshes


class Editor:
    """The editor of a session's scene. mesh: the number of the picked object. light: the number of the picked light.

    Each change shows at once as a new scene, which shares all unchanged meshes with the scene before. An undo step covers all
    changes between two calls of `settle`. handles_used: True if the mouse is on the handles in the picture. dragging: True if the
    mouse moves the handles. The interface sets both in each frame.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.loaded = self.saved = self.present = session.scene  # saved: the scene in the last written file
        self.past, self.future = list[Scene](), list[Scene]()  # scenes to undo and redo
        self.mesh: int | None = None
        self.light: int | None = 0 if session.scene.lights else None
        self.handles_used = self.dragging = False

    @property
    def scene(self) -> Scene:
        return self.session.scene

    @property
    def unsaved(self) -> bool:
        """True if no file holds the present state of the scene."""
        return self.scene is not self.saved

    def last_lit(self, colour: Callable[[Scene], Point]) -> Point:
        """Return the last colour that was not black, in the present scene or in the steps of undo; black for none.

        colour: a call that returns the colour of a light or an object in a scene with as many lights as now.
        """
        scenes = (self.scene, self.present, *reversed(self.past))
        known = (colour(scene) for scene in scenes if len(scene.lights) == len(self.scene.lights))
        return next(filter(any, known), (0.0, 0.0, 0.0))

    # ---- undo and redo ---------------------------------------------------------------------------------------------

    def apply(self, scene: Scene) -> None:
        """Show another state of the scene. It becomes an undo step at the next `settle`."""
        self.session.pose(scene)
        if self.light is not None and self.light >= len(scene.lights):
            self.light = len(scene.lights) - 1 if scene.lights else None

    def settle(self) -> None:
        """Make one undo step of all changes since the last call."""
        if self.scene is not self.present:
            self.past, self.future = [*self.past, self.present][-_MOST:], []
            self.present = self.scene

    def undo(self) -> bool:
        """Undo a step; return False if there is none, or during a drag."""
        self.settle()
        return self._step(self.past, self.future)

    def redo(self) -> bool:
        """Redo the step that was undone last; return False if there is none."""
        self.settle()
        return self._step(self.future, self.past)

    def _step(self, source: list[Scene], target: list[Scene]) -> bool:
        """Show the last state of `source`, pick its first light that differs, and move the present state to `target`."""
        if not source or self.dragging:
            return False
        before = self.scene.lights
        self.apply(source[-1])
        self.light = next((i for i, light in enumerate(self.scene.lights) if light not in before), self.light)
        target.append(self.present)
        self.present = source.pop()
        return True

    # ---- lights and objects ----------------------------------------------------------------------------------------

    def set_light(self, number: int, *light: Light) -> None:
        """Replace a light by another one, or delete it."""
        lights = self.scene.lights
        self.apply(replace(self.scene, lights=(*lights[:number], *light, *lights[number + 1 :])))

    def add_light(self) -> None:
        """Add and pick a copy of the picked light; for none or a directional one, a point light halfway to the camera's target.

        The point light has the intensity at which the present exposure shows a bright surface there.
        """
        camera, scene, stops = self.session.camera, self.scene, self.session.auto_exposure.stops
        if self.light is not None and not scene.lights[self.light].directional:  # the position of a sun is a direction
            light = scene.lights[self.light].shifted(_BESIDE * self.session.extent * camera.axes[0])
        else:
            eye, target = np.array([camera.eye, camera.target])
            shine = 0.25 * math.dist(eye, target) ** 2 * 2.0 ** -(stops if math.isfinite(stops) else 0.0)
            light = Light(vector(0.5 * (eye + target)), (shine, shine, shine), physical=True)
        self.apply(replace(scene, lights=(*scene.lights, replace(light, name=""))))
        self.pick_light(len(scene.lights))

    def keep_view(self) -> None:
        """Add the present view to the scene's cameras."""
        cameras = self.scene.cameras
        self.apply(replace(self.scene, cameras=(*cameras, replace(self.session.camera, name=f"view {len(cameras) + 1}"))))

    def set_mesh(self, number: int, mesh: Mesh) -> None:
        """Replace a mesh by a moved or repainted state. Raises InputError for a material that needs another way of drawing."""
        meshes = self.scene.meshes
        self.apply(replace(self.scene, meshes=(*meshes[:number], mesh, *meshes[number + 1 :])))

    def hide(self, number: int) -> None:
        """Hide a mesh at the middle of the scene, so that the scene's bounds do not grow."""
        self.set_mesh(number, hidden(self.scene.meshes[number], self.scene.bounds.mean(0)))
        self.mesh = None if self.mesh == number else self.mesh

    def pick_light(self, number: int | None) -> None:
        """Pick a light, in place of an object."""
        self.light, self.mesh = number, None
