"""A renderer's records in a file: kept, and taken back."""

from __future__ import annotations

from irrsplat.core import files
from irrsplat.core.paths import named
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.records import cache_file
from irrsplat.records.scene_stamp import stamp
from irrsplat.scene.model import Scene


def save(path: files.Pathlike, scene: Scene, scheduler: RecordScheduler) -> None:
    """Write the records, whole or not at all; errors as Renderer.save_cache."""
    files.check_file(named(path))
    cache_file.write(path, cache_file.key(scene, scheduler.settings), scheduler.state(), stamp(scene))


def load(path: files.Pathlike, update: bool, scene: Scene, scheduler: RecordScheduler) -> str:
    """Take the records of a file in place of the scheduler's own, as Renderer.load_cache has it."""
    wanted = cache_file.key(scene, scheduler.settings)
    if not update:
        scheduler.restore(cache_file.read(named(path), wanted))
        return ""
    found, reason = cache_file.read_of_any_scene(named(path), wanted)
    scheduler.restore(cache_file.carried_over(found, stamp(scene)) if reason else found.state)
    if reason:
        scheduler.cache.invalidate()
    return reason
