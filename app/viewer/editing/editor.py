"""The editor of lights and objects: their changes, the selection, undo and redo."""

from __future__ import annotations

from dataclasses import replace

from irrsplat.app.viewer.editing.light_edit import LightEdit
from irrsplat.app.viewer.editing.scene_edit import EditedScene, ObjectEdit, SceneEdit
from irrsplat.app.viewer.session import Session

_MOST = 300  # the most states that undo keeps


class Editor:
    """The editor of a session's scene. mesh: the number of the picked object. light: the number of the picked light.

    Each change shows at once. An undo step covers all changes between two calls of `settle`. handles_used: True if the mouse is
    on the handles in the picture. dragging: True if the mouse moves the handles. The interface sets both in each frame.
    """

    def __init__(self, session: Session) -> None:
        self.session, self.loaded = session, session.scene
        self.edit = self.saved = SceneEdit.of(session.scene)  # saved: the edit in the last written file
        self.present, self.past, self.future = self.edit, list[SceneEdit](), list[SceneEdit]()  # states to undo and redo
        self._scenes = EditedScene(session.scene)
        self.mesh: int | None = None
        self.light: int | None = 0 if session.scene.lights else None
        self.handles_used = self.dragging = False

    # ---- changes ---------------------------------------------------------------------------------------------------

    @property
    def changed(self) -> bool:
        return self.edit != SceneEdit.of(self.loaded)

    @property
    def unsaved(self) -> bool:
        """True if no file holds the present state of the scene."""
        return self.edit != self.saved

    def apply(self, edit: SceneEdit) -> None:
        """Show another edit. It becomes an undo step at the next `settle`.

        Raises InputError, and changes nothing, if the edit makes an invalid scene.
        """
        if edit == self.edit:
            return
        self.session.pose(self._scenes.scene(edit))
        self.edit = edit
        self.mesh = self.mesh if self.mesh is not None and self.mesh < len(edit.objects) else None
        if self.light is not None and self.light >= len(edit.lights):
            self.light = len(edit.lights) - 1 if edit.lights else None

    def settle(self) -> None:
        """Make one undo step of all changes since the last call."""
        if self.edit != self.present:
            self.past, self.future = [*self.past, self.present][-_MOST:], []
            self.present = self.edit

    def undo(self) -> bool:
        """Undo a step; return False if there is none."""
        self.settle()
        return self._step(self.past, self.future)

    def redo(self) -> bool:
        """Redo the step that was undone last; return False if there is none."""
        self.settle()
        return self._step(self.future, self.past)

    def _step(self, source: list[SceneEdit], target: list[SceneEdit]) -> bool:
        """Show the last state of `source`, and move the present one to `target`."""
        if not source:
            return False
        self.apply(source[-1])
        target.append(self.present)
        self.present = source.pop()
        return True

    # ---- lights ----------------------------------------------------------------------------------------------------

    @property
    def lights(self) -> tuple[LightEdit, ...]:
        return self.edit.lights

    def set_light(self, number: int, edited: LightEdit) -> None:
        self.apply(self.edit.with_light(number, edited))

    def delete_light(self, number: int) -> None:
        self.apply(replace(self.edit, lights=(*self.lights[:number], *self.lights[number + 1 :])))

    # ---- objects ---------------------------------------------------------------------------------------------------

    def set_object(self, number: int, edit: ObjectEdit) -> None:
        """Change a mesh. Raises InputError for a material that needs another way of drawing."""
        self.apply(self.edit.with_object(number, edit))

    def hide(self, number: int, hidden: bool = True) -> None:
        self.set_object(number, replace(self.edit.objects[number], hidden=hidden))
        if hidden and self.mesh == number:
            self.mesh = None

    def pick_light(self, number: int | None) -> None:
        """Pick a light, in place of an object."""
        self.light, self.mesh = number, None
