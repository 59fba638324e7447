"""OpenGL objects and scenes are freed; tests/trust/test_a_day.py does many more actions."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import pytest

from irrsplat.app.viewer import window
from tests.support.viewing import viewing, write_room

ROOT = Path(__file__).resolve().parents[3]
CREATORS = ("texture", "depth_texture", "buffer", "framebuffer", "program", "vertex_array")
RARE = {"quit", "screenshot", "record"}
RARE |= {"save_as", "save_again", "save_film"}
LEFT_OUT = RARE | {"trace"}  # actions that are not tried at random: these, and one that takes minutes


class Watch:
    """Counter of the living OpenGL objects by kind, of those created since its construction."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[tuple[str, Any]] = []
        for name in CREATORS:
            monkeypatch.setattr(moderngl.Context, name, self._watched(name, getattr(moderngl.Context, name)))

    def _watched(self, name: str, create: Callable[..., Any]) -> Callable[..., Any]:
        def make(*args: Any, **options: Any) -> Any:
            thing = create(*args, **options)
            self.made.append((name, thing))
            return thing

        return make

    def alive(self) -> Counter[str]:
        self.made = [one for one in self.made if not isinstance(one[1].mglo, moderngl.InvalidObject)]
        return Counter(name for name, _ in self.made)


def resident() -> float:
    """Return the memory of this process in MiB, after it has returned its free memory."""
    gc.collect()
    window.trim()
    return pages()


def pages() -> float:
    """Return the memory of this process in MiB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    raise AssertionError("no VmRSS")


def test_nothing_of_the_scene_before_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another scene replaces all references to earlier renderers and scenes; a closed viewer leaves only the window's objects."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    watch = Watch(monkeypatch)
    with viewing(write_room(tmp_path), (160, 120), radius_min=8.0, radius_max=40.0) as driver:
        session, actions, options = driver.session, driver.actions, driver.session.options
        driver.settle()
        driver.move(60.0, 60.0)
        options.inspect = options.discs = True
        before: list[weakref.ref[object]] = []
        for name in ("light", "shadow", "atlas", "surface", "image"):
            actions.show(name)
            driver.frame()
            before += [weakref.ref(view) for view in session.views]
        assert driver.display.inspected is not None
        options.frozen = True
        session.split(True)
        driver.frame()
        session.split(False)
        actions.editor.mesh = 0
        actions.editor.set_light(0, replace(actions.editor.scene.lights[0], position=(0.2, 0.5, 0.1)))
        driver.frame()
        options.inspect = options.discs = False
        driver.frame()
        before += [
            weakref.ref(thing)
            for one in session.renderers
            for thing in (one, one.world, one.world.geometry, one.scene, *one.scene.meshes)
        ]
        actions.editor.saved = actions.editor.scene  # the moved light is lost without a question
        actions.open(str(write_room(tmp_path)))
        driver.scene = session.scene  # the driver's own reference
        driver.frame(2)
        gc.collect()
        assert [one() for one in before if one() is not None] == []
    watch.alive()
    own = [driver.wnd.fbo, *driver.wnd.fbo.color_attachments, driver.wnd.fbo.depth_attachment]
    assert [one for _, one in watch.made if all(one is not other for other in own)] == []


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries")
def test_large_arrays_leave_nothing_behind() -> None:
    """Large arrays return their memory, even if they are freed in another order with small arrays between them."""
    program = """
import numpy as np
from irrsplat.app.viewer import window
from tests.app.viewer.test_viewer_leaks import pages
window.return_large_arrays()
before, small = pages(), []
for _ in range(4):
    large = []
    for _ in range(16):
        large.append(np.ones(1 << 20))  # 8 MB
        small.append(np.ones(1000))
    del large[::2], large
print(pages() - before)
"""
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert float(found.stdout) < 16.0, "MiB of 128 that were in use at once"
