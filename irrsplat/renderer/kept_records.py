"""A renderer's records in a file: kept, taken back, and carried over to another state of their scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from irrsplat.core import files
from irrsplat.core.buffers import ShadowMaps
from irrsplat.core.paths import named
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.records import cache_file
from irrsplat.records.scene_stamp import earlier
from irrsplat.renderer.state import State
from irrsplat.scene.model import Scene


class Holder(Protocol):
    """The parts of a Renderer that are required to carry records over."""

    scheduler: RecordScheduler

    def forget(self) -> None:
        """Without records, and with every buffer to be drawn again."""

    def draw_shadows(self) -> ShadowMaps:
        """The shadow maps of the scene as it is now."""


def save(path: files.Pathlike, scene: Scene, scheduler: RecordScheduler) -> None:
    """Write the records, whole or not at all; errors as Renderer.save_cache."""
    files.check_file(named(path))
    cache_file.write(path, cache_file.key(scene, scheduler.settings), scheduler.state(), cache_file.stamp(scene))


def load(path: files.Pathlike, update: bool, present: State, holder: Holder, change_to: Callable[[State], None]) -> str:
    """Take the records of a file in place of the holder's own, as Renderer.load_cache has it.

    present: the holder's state. change_to: changes it to another one.
    """
    scheduler, wanted = holder.scheduler, cache_file.key(present.scene, holder.scheduler.settings)
    if not update:
        scheduler.restore(cache_file.read(named(path), wanted))
        return ""
    found, reason = cache_file.read_of_any_scene(named(path), wanted)
    if reason:
        _renew(found, found.key.lights == wanted.lights, present, holder, change_to)
    else:
        scheduler.restore(found.state)
    return reason


def _renew(
    found: cache_file.Content, same_lights: bool, present: State, holder: Holder, change_to: Callable[[State], None]
) -> None:
    """Take the records of a file that belong to another state of the scene, and go on to the present one from there."""
    scheduler, then = holder.scheduler, earlier(found.scene, present.scene, cache_file.stamp(present.scene))
    records = cache_file.carried_over(found.state, then)
    holder.forget()
    try:
        change_to(replace(present, scene=then.scene))
        scheduler.restore(records)
        if then.complete and same_lights:  # a look at what was there before tells whom the change concerns
            scheduler.gatherer.restore_surface(holder.draw_shadows(), Budget(None))
        else:
            scheduler.cache.invalidate()
        change_to(present)
    except BaseException:
        scheduler.cache.truncate(0)
        change_to(present)
        raise
